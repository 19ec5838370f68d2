/* What a view is made of where it is left out. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/examples.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { HEIGHT = 24, WIDTH = 28, PIXELS = HEIGHT * WIDTH, MOST_VIEWS = 9, PLANES = 5 };

static float frames[MOST_VIEWS * PIXELS], images[(2 * PLANES + 1) * PIXELS];
static float others[(2 * PLANES + 1) * PIXELS];

/* Disparities 4, 3, 2, 1, 0. */
static struct v2v_config config_of(const char *cameras)
{
    struct v2v_config config;
    v2v_config_defaults(&config);
    config.synthesis.planes = PLANES;
    config.synthesis.nearest = 4;
    config.synthesis.farthest = 0;
    snprintf(config.synthesis.cameras, sizeof config.synthesis.cameras, "%s", cameras);
    return config;
}

static struct v2v_examples *create(const struct v2v_config *config, const struct v2v_psf_file *psf)
{
    struct v2v_examples *examples = NULL;
    assert_ok(v2v_examples_create(&examples, &v2v_examples_left_out_view, config, psf));
    assert_int_equal(examples->inputs, 2 * PLANES);
    assert_int_equal(examples->outputs, 1);
    return examples;
}

static void inputs(float *to, const struct v2v_examples *examples, int64_t v)
{
    examples->ops->inputs_of_view(examples, to, frames, v, HEIGHT, WIDTH);
}

static float texture(int64_t y, int64_t x)
{
    return (float)v2v_random_uniform(3, (uint64_t)(y + 100), (uint64_t)(x + 100));
}

/* A plane of disparity 2 before nine cameras; the middle one's neighbours are 2 pixels off. */
static void at_the_disparity_of_a_plane_the_others_agree_and_show_the_view(void **state)
{
    (void)state;
    enum { DISPARITY = 2, SWEPT = 2, MARGIN = DISPARITY };
    const struct v2v_config config = config_of("");
    const struct v2v_psf_file psf = {.views = 9};
    struct v2v_examples *examples = create(&config, &psf);
    for (int64_t i = 0; i < 9 * PIXELS; i++) {
        const int64_t v = i / PIXELS, y = i / WIDTH % HEIGHT, x = i % WIDTH;
        frames[i] = texture(y + DISPARITY * (v / 3 - 1), x + DISPARITY * (v % 3 - 1));
    }
    inputs(images, examples, 4);
    for (int64_t y = MARGIN; y < HEIGHT - MARGIN; y++) {
        for (int64_t x = MARGIN; x < WIDTH - MARGIN; x++) {
            const int64_t at = y * WIDTH + x;
            for (int64_t i = 0; i < PLANES; i++) {
                const float mean = images[2 * i * PIXELS + at];
                const float deviation = images[(2 * i + 1) * PIXELS + at];
                assert_true((deviation == 0.0f) == (i == SWEPT));
                assert_true((mean == frames[4 * PIXELS + at]) == (i == SWEPT));
            }
        }
    }
    v2v_examples_destroy(&examples);
}

/* A ramp is moved exactly; beyond the frame its edge goes on. Terms below 4, three roundings. */
static void views_are_moved_by_parts_of_a_pixel(void **state)
{
    (void)state;
    const struct v2v_config config = config_of("0 0, -0.125 0.375");
    const struct v2v_psf_file psf = {.views = 2};
    struct v2v_examples *examples = create(&config, &psf);
    for (int64_t i = 0; i < PIXELS; i++) {
        frames[i] = -1.0f;
        frames[PIXELS + i] = 0.0625f * (float)(i / WIDTH) + 0.03125f * (float)(i % WIDTH);
    }
    inputs(images, examples, 0);
    for (int64_t i = 0; i < PLANES; i++) {
        const double disparity = (double)(4 - i);
        for (int64_t k = 0; k < PIXELS; k++) {
            const double y = fmin((double)(k / WIDTH) + 0.125 * disparity, HEIGHT - 1);
            const double x = fmax((double)(k % WIDTH) - 0.375 * disparity, 0);
            const double is = (double)images[2 * i * PIXELS + k];
            assert_true(fabs(is - 0.0625 * y - 0.03125 * x) <= 3 * 4 * 0x1p-24);
            assert_true(images[(2 * i + 1) * PIXELS + k] == 0.0f); /* of one view alone */
        }
    }
    v2v_examples_destroy(&examples);
}

/* Of 1, 3 and 8: 4, and the root of (9 + 1 + 16) / 3; cameras are a unit apart. */
static void mean_and_deviation_are_those_of_the_others(void **state)
{
    (void)state;
    static const float level[4] = {1.0f, 100.0f, 3.0f, 8.0f};
    const struct v2v_config config = config_of("");
    const struct v2v_psf_file psf = {.views = 4};
    struct v2v_examples *examples = create(&config, &psf);
    for (int64_t i = 0; i < 4 * PIXELS; i++) {
        frames[i] = level[i / PIXELS];
    }
    inputs(images, examples, 1);
    for (int64_t y = 4; y < HEIGHT - 4; y++) { /* of the nearest plane all see that */
        for (int64_t x = 4; x < WIDTH - 4; x++) {
            const int64_t i = y * WIDTH + x;
            assert_true(fabsf(images[i] - 4.0f) <= 4 * 8 * 0x1p-24f);
            assert_true(fabsf(images[PIXELS + i] - sqrtf(26.0f / 3.0f)) <= 8 * 8 * 0x1p-24f);
        }
    }
    v2v_examples_destroy(&examples);
}

/* The third view shows nothing of the first one's left 4 pixels, on the nearest plane. */
static void views_count_where_they_show_the_place(void **state)
{
    (void)state;
    const struct v2v_config config = config_of("0 0, 0 0, 0 1");
    const struct v2v_psf_file psf = {.views = 3};
    struct v2v_examples *examples = create(&config, &psf);
    for (int64_t i = 0; i < 3 * PIXELS; i++) {
        frames[i] = i < 2 * PIXELS ? 1.0f : 3.0f;
    }
    inputs(images, examples, 0);
    for (int64_t i = 0; i < PIXELS; i++) {
        const float mean = i % WIDTH < 4 ? 1.0f : 2.0f, deviation = i % WIDTH < 4 ? 0.0f : 1.0f;
        assert_true(fabsf(images[i] - mean) < 0.01f);
        assert_true(fabsf(images[PIXELS + i] - deviation) < 0.1f);
    }
    v2v_examples_destroy(&examples);
}

static void a_view_is_not_among_what_it_is_made_of(void **state)
{
    (void)state;
    const struct v2v_config config = config_of("");
    const struct v2v_psf_file psf = {.views = 6};
    struct v2v_examples *examples = create(&config, &psf);
    for (int64_t v = 0; v < 6; v++) {
        for (int64_t i = 0; i < 6 * PIXELS; i++) {
            frames[i] = (float)v2v_random_normal(4, 1, (uint64_t)i);
        }
        inputs(images, examples, v);
        for (int64_t u = 0; u < 6; u++) {
            for (int64_t i = 0; i < PIXELS; i++) {
                frames[u * PIXELS + i] += 1.0f;
            }
            inputs(others, examples, v);
            assert_true((memcmp(images, others, 2 * PLANES * PIXELS * sizeof *images) == 0) ==
                        (u == v));
            for (int64_t i = 0; i < PIXELS; i++) {
                frames[u * PIXELS + i] = (float)v2v_random_normal(4, 1, (uint64_t)(u * PIXELS + i));
            }
        }
    }
    v2v_examples_destroy(&examples);
}

static void an_example_is_what_the_others_show_and_the_view_scaled(void **state)
{
    (void)state;
    enum { VIEWS = 3 };
    const struct v2v_config config = config_of("");
    const struct v2v_psf_file psf = {.views = VIEWS};
    const struct v2v_recording_info info = {
        .frames = 2, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    const struct v2v_input_settings input = {.views = VIEWS};
    struct v2v_recording_writer *writer = NULL;
    struct v2v_example_source source = {.scaling = {.offset = 0.5, .gain = 2.0}};
    struct v2v_examples *examples = create(&config, &psf);
    char path[512];
    snprintf(path, sizeof path, "%s/recording.h5", test_folder(NULL));
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    for (int64_t t = 0; t < 2; t++) {
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            frames[i] = (float)v2v_random_normal(4, (uint64_t)t, (uint64_t)i);
        }
        assert_ok(v2v_recording_write(writer, frames, t, 0, VIEWS));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&source.recording, path, &input, NULL));
    assert_ok(examples->ops->make(examples, images, &source, 1, 2));
    v2v_scaling_apply(&source.scaling, frames, VIEWS * PIXELS); /* which still are frame 1 */
    inputs(others, examples, 2);
    assert_memory_equal(images, others, 2 * PLANES * PIXELS * sizeof *images);
    assert_memory_equal(images + 2 * PLANES * PIXELS, frames + 2 * PIXELS, PIXELS * sizeof *images);
    v2v_recording_close(&source.recording);
    v2v_examples_destroy(&examples);
    assert_int_equal(v2v_mem_held(), 0);
}

static void what_cannot_be_swept_is_refused(void **state)
{
    (void)state;
    struct v2v_examples *examples = NULL;
    const struct v2v_config grid = config_of(""), three = config_of("0 0, 0 1, 0 2");
    const struct v2v_psf_file one = {.views = 1}, four = {.views = 4};
    const struct v2v_examples_ops *ops = &v2v_examples_left_out_view;
    assert_int_equal(v2v_examples_create(&examples, ops, &grid, &one), V2V_E_INPUT);
    assert_null(examples);
    assert_int_equal(v2v_examples_create(&examples, ops, &three, &four), V2V_E_CONFIG);
    assert_null(examples);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(at_the_disparity_of_a_plane_the_others_agree_and_show_the_view),
        cmocka_unit_test(views_are_moved_by_parts_of_a_pixel),
        cmocka_unit_test(mean_and_deviation_are_those_of_the_others),
        cmocka_unit_test(views_count_where_they_show_the_place),
        cmocka_unit_test(a_view_is_not_among_what_it_is_made_of),
        cmocka_unit_test(an_example_is_what_the_others_show_and_the_view_scaled),
        cmocka_unit_test(what_cannot_be_swept_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
