/* A whole bench over three views and two slices; its plot. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/bench/bench.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 3, SLICES = 2, SIDE = 7, SIZE = 32 };

static const struct v2v_bench_machine machine = {
    .processor = "a processor", .instructions = "sets", .libraries = "libraries", .threads = 1};

/* One bright pixel a slice, elsewhere in every view. */
static void make_psf(struct v2v_psf_file *psf)
{
    *psf = (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = SIDE, .width = SIDE};
    assert_ok(V2V_ALLOC(psf->data, "test", VIEWS * SLICES * SIDE * SIDE));
    for (int i = 0; i < VIEWS * SLICES; i++) {
        psf->data[i * SIDE * SIDE + (1 + i % 5) * SIDE + (5 - i % 4)] = 1.0f;
    }
}

/* The example of the header. */
static enum v2v_status example(struct v2v_bench_result *result, const struct v2v_config *config,
                               const struct v2v_psf_file *psf, const float *views, FILE *stream)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_bench_job job = {.config = config,
                                .psf = psf,
                                .views = views,
                                .size = SIZE,
                                .step_size = SIZE,
                                .width = 4,
                                .widest = 16,
                                .features = 4,
                                .volume_scale = 1.0,
                                .gain = 1.0,
                                .repeat = 3};
    V2V_TRY(v2v_bench_run(result, &job));
    v2v_bench_print(stream, result, &machine);
done:
    return rc;
}

static int count_lines(FILE *stream)
{
    int lines = 0;
    rewind(stream);
    for (int c = fgetc(stream); c != EOF; c = fgetc(stream)) {
        lines += c == '\n';
    }
    return lines;
}

static void every_variant_is_timed_and_judged(void **state)
{
    static const char *const ids[] = {"default",  "winograd_off",          "merging_off",
                                      "both_off", "openblas_winograd_off", "skip",
                                      "width_16"};
    enum { ROWS = sizeof ids / sizeof ids[0], HEAD = 8, FOOT = 5 };
    struct v2v_bench_result result;
    struct v2v_config config;
    struct v2v_psf_file psf;
    float *views = NULL;
    FILE *stream = tmpfile();
    (void)state;
    assert_non_null(stream);
    v2v_config_defaults(&config);
    make_psf(&psf);
    assert_ok(V2V_ALLOC(views, "test", VIEWS * SIZE * SIZE));
    for (int i = 0; i < VIEWS * SIZE * SIZE; i++) {
        views[i] = 0.1f * (float)(i % 11);
    }
    assert_ok(example(&result, &config, &psf, views, stream));
    assert_int_equal(result.rows, ROWS);
    for (int i = 0; i < ROWS; i++) {
        const struct v2v_bench_row *row = &result.row[i];
        assert_string_equal(row->id, ids[i]);
        assert_int_equal(row->width, i == ROWS - 1 ? 16 : 4);
        /* The bar for float32; equal volumes would mean that nothing was compared. */
        assert_true(row->error[0] > 0.0 && row->error[0] <= 1e-4);
        assert_true(row->error[1] > 0.0 && row->error[1] <= 1e-4);
        assert_true(row->forward_s > 0.0 && row->step_s > 0.0);
        assert_true(row->forward_floor_s > 0.0 && row->step_floor_s > row->forward_floor_s);
        assert_true(row->step_forward_s > 0.0 && row->step_forward_s < row->step_s);
        assert_true(isnan(row->psnr_change));
    }
    assert_true(result.row[0].macs < result.row[3].macs);
    assert_true(result.peak_bytes > 0.0 && result.rates.copy > 0.0);
    assert_int_equal(count_lines(stream), HEAD + ROWS + FOOT);
    fclose(stream);
    v2v_mem_free(views);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

static struct v2v_bench_result plotted(int64_t rows)
{
    struct v2v_bench_result result = {.rows = rows};
    for (int64_t i = 0; i < rows; i++) {
        result.row[i] = (struct v2v_bench_row){.name = "variant",
                                               .forward_s = 0.1 * (double)(1 + i),
                                               .error = {1e-6 * (double)(1 + i * i), 1e-7}};
    }
    return result;
}

static int orange_pixels(const struct v2v_bench_result *result)
{
    static const uint8_t orange[3] = {0xff, 0xa0, 0x30};
    struct v2v_canvas canvas;
    int count = 0;
    assert_ok(v2v_bench_plot(&canvas, result));
    for (int64_t i = 0; i < canvas.height * canvas.width; i++) {
        count += memcmp(canvas.rgb + 3 * i, orange, 3) == 0;
    }
    v2v_canvas_fini(&canvas);
    return count;
}

static void plot_has_a_dot_for_each_row_that_has_a_place(void **state)
{
    enum { ROWS = 5 };
    struct v2v_bench_result result = plotted(1);
    int dot = orange_pixels(&result);
    (void)state;
    assert_true(dot > 0);
    result = plotted(ROWS);
    assert_int_equal(orange_pixels(&result), ROWS * dot);
    result.row[1].error[0] = NAN;
    result.row[2].error[1] = INFINITY;
    result.row[3].error[0] = result.row[3].error[1] = 0.0;
    assert_int_equal(orange_pixels(&result), (ROWS - 3) * dot);
    result = plotted(0);
    assert_int_equal(orange_pixels(&result), 0);
}

/* Last: the request stays for the rest of the program. */
static void a_request_ends_the_bench(void **state)
{
    struct v2v_bench_result result;
    struct v2v_config config;
    struct v2v_psf_file psf;
    float views[1] = {0.0f};
    (void)state;
    v2v_config_defaults(&config);
    make_psf(&psf);
    v2v_stop_request();
    assert_int_equal(example(&result, &config, &psf, views, stdout), V2V_STOPPED);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_variant_is_timed_and_judged),
        cmocka_unit_test(plot_has_a_dot_for_each_row_that_has_a_place),
        cmocka_unit_test(a_request_ends_the_bench),
    };
    /* the same rows on every processor: none in bf16 */
    if (setenv("DNNL_MAX_CPU_ISA", "AVX512_CORE", 1) != 0) {
        return 1;
    }
    return cmocka_run_group_tests(tests, NULL, NULL);
}
