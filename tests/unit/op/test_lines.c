/* What reads and writes images in lines, against the same on whole images. */
#include "small_draw.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/conv.h"
#include "v2v3d/op/resample.h"
#include <math.h>
#include <string.h>

enum { IN = 5, OUT = 6, HEIGHT = 24, WIDTH = 90, PIXELS = HEIGHT * WIDTH };

/* Memory that begins as NaN: nothing of it may be seen. */
static struct v2v_lines lines_of(float **memory, int64_t channels, int64_t held)
{
    int64_t floats = v2v_lines_floats(channels, held, WIDTH);
    *memory = v2v_mem_alloc("test", floats, sizeof **memory);
    assert_non_null(*memory);
    for (int64_t i = 0; i < floats; i++) {
        (*memory)[i] = NAN;
    }
    return v2v_lines_view(*memory, channels, held, HEIGHT, WIDTH);
}

static void put(const struct v2v_lines *lines, const float *image, int64_t first, int64_t rows)
{
    for (int64_t y = first; y < first + rows; y++) {
        for (int64_t c = 0; c < lines->channels; c++) {
            memcpy(v2v_lines_at(lines, y) + c * v2v_lines_stride(lines),
                   image + c * PIXELS + y * WIDTH, WIDTH * sizeof *image);
        }
    }
    v2v_lines_frame(lines, first, rows);
}

static void check(const struct v2v_lines *lines, const float *image, int64_t first, int64_t rows)
{
    for (int64_t y = first; y < first + rows; y++) {
        for (int64_t c = 0; c < lines->channels; c++) {
            assert_memory_equal(v2v_lines_at(lines, y) + c * v2v_lines_stride(lines),
                                image + c * PIXELS + y * WIDTH, WIDTH * sizeof *image);
        }
    }
}

static void check_convolution(int kernel)
{
    enum { AT_ONCE = 4, HELD = AT_ONCE + 3 };
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = IN,
                                 .out = OUT,
                                 .height = HEIGHT,
                                 .width = WIDTH,
                                 .kernel = kernel,
                                 .stride = 1,
                                 .slope = 0.1f};
    struct v2v_conv *conv = NULL;
    float *memory[2], *in = small_draw(IN * PIXELS, 1, 1.0),
                      *out = small_draw(OUT * PIXELS, 2, 1.0);
    float *weight = small_draw(OUT * IN * 9, 3, 1.0), *bias = small_draw(OUT, 4, 1.0);
    struct v2v_lines from = lines_of(&memory[0], IN, HELD), to = lines_of(&memory[1], OUT, HELD);
    assert_ok(v2v_conv_create(&conv, &spec));
    assert_true(v2v_conv_takes_lines(conv));
    v2v_conv_set_weights(conv, weight, bias);
    v2v_conv_forward(conv, out, in);
    for (int64_t y = 0, done = 0; done < HEIGHT; y += AT_ONCE) {
        if (y < HEIGHT) {
            put(&from, in, y, AT_ONCE);
        }
        int64_t end = y + AT_ONCE < HEIGHT ? y + AT_ONCE - 1 : HEIGHT;
        int64_t rows = end - done < AT_ONCE ? end - done : AT_ONCE;
        v2v_conv_forward_lines(conv, &to, &from, done, rows);
        check(&to, out, done, rows);
        done += rows;
    }
    v2v_conv_destroy(&conv);
    float *owned[] = {memory[0], memory[1], in, out, weight, bias};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
}

static void convolution_in_a_ring_gives_the_bits_of_the_image(void **unused)
{
    (void)unused;
    check_convolution(1);
    check_convolution(3);
}

static void large_layers_take_no_lines(void **unused)
{
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = 64,
                                 .out = 64,
                                 .height = HEIGHT,
                                 .width = WIDTH,
                                 .kernel = 3,
                                 .stride = 1,
                                 .slope = 1.0f,
                                 .method.backend = V2V_BACKEND_OPENBLAS};
    struct v2v_conv *conv = NULL;
    (void)unused;
    assert_ok(v2v_conv_create(&conv, &spec));
    assert_false(v2v_conv_takes_lines(conv));
    v2v_conv_destroy(&conv);
}

static void resampled_lines_have_the_bits_of_the_image(void **unused)
{
    static const int factors[] = {1, 2, 3};
    float *memory, *image = small_draw(IN * PIXELS, 1, 1.0),
                   *small = small_draw(IN * PIXELS, 2, 1.0);
    float *by_lines = small_draw(IN * PIXELS, 2, 1.0);
    struct v2v_lines lines = lines_of(&memory, IN, HEIGHT + 2);
    (void)unused;
    for (size_t i = 0; i < sizeof factors / sizeof *factors; i++) {
        int f = factors[i];
        put(&lines, image, 0, HEIGHT);
        v2v_avgpool_forward(small, image, IN, HEIGHT, WIDTH, f);
        v2v_avgpool_lines(by_lines, &lines, f, 0, 4);
        v2v_avgpool_lines(by_lines, &lines, f, 4, HEIGHT / f - 4);
        assert_memory_equal(by_lines, small, (size_t)(IN * PIXELS / f / f) * sizeof *small);
        v2v_bilinear_forward(image, small, IN, HEIGHT / f, WIDTH / f, f);
        v2v_bilinear_lines(&lines, small, f, 0, 7);
        v2v_bilinear_lines(&lines, small, f, 7, HEIGHT - 7);
        check(&lines, image, 0, HEIGHT);
    }
    float *owned[] = {memory, image, small, by_lines};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
}

static void sums_are_of_the_given_rows(void **unused)
{
    float *memory[2], *image = small_draw(IN * PIXELS, 1, 1.0),
                      *other = small_draw(IN * PIXELS, 2, 1.0);
    struct v2v_lines sum = lines_of(&memory[0], IN, HEIGHT), x = lines_of(&memory[1], IN, 9);
    (void)unused;
    for (int64_t c = 0; c < IN; c++) {
        for (int64_t y = 0; y < HEIGHT; y++) {
            memcpy(v2v_lines_at(&sum, y) + c * v2v_lines_stride(&sum),
                   image + c * PIXELS + y * WIDTH, WIDTH * sizeof *image);
        }
    }
    put(&x, other, 8, 8);
    v2v_lines_add(&sum, &x, 8, 8);
    for (int64_t i = 0; i < IN * PIXELS; i++) {
        int64_t y = i / WIDTH % HEIGHT;
        image[i] += y >= 8 && y < 16 ? other[i] : 0.0f;
    }
    check(&sum, image, 0, HEIGHT);
    float *owned[] = {memory[0], memory[1], image, other};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(convolution_in_a_ring_gives_the_bits_of_the_image),
        cmocka_unit_test(large_layers_take_no_lines),
        cmocka_unit_test(resampled_lines_have_the_bits_of_the_image),
        cmocka_unit_test(sums_are_of_the_given_rows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
