/* Where calibrate looks: at the square that varies most, with its margin, and at the frame. */
#include "method/calibrator.h"
#include "support.h"

#include "v2v3d/base/memory.h"

enum { VIEWS = 7, HEIGHT = 300, WIDTH = 120, PIXELS = HEIGHT * WIDTH, FLASH = 250, SIDE = 208 };

static float views[VIEWS * PIXELS];

/* View v is v, but for light in the first one's row FLASH. */
static void begin(struct v2v_calibrator *calibrator)
{
    static const struct v2v_psf_file psf = {.views = VIEWS, .slices = 3, .height = 5, .width = 5};
    static struct v2v_config config;
    static const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    v2v_config_defaults(&config);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(i / PIXELS);
    }
    for (int64_t x = 0; x < WIDTH; x++) {
        views[FLASH * WIDTH + x] = (float)(x % 2);
    }
    *calibrator = (struct v2v_calibrator){.problem = &problem, .views = views};
    assert_ok(v2v_calibrator_init(calibrator));
}

static void a_look_is_where_view_0_varies_most(void **state)
{
    (void)state;
    struct v2v_calibrator calibrator;
    begin(&calibrator);
    v2v_calibrator_go(&calibrator, SIDE);
    assert_int_equal(calibrator.height, SIDE);
    assert_int_equal(calibrator.width, WIDTH);
    const struct v2v_part at = calibrator.place.rows;
    assert_true(at.first >= 0 && at.first + at.count <= HEIGHT);
    assert_int_equal(calibrator.busiest.rows.first, at.first + calibrator.rows.first);
    assert_int_equal(calibrator.busiest.rows.count, calibrator.rows.count);
    assert_int_equal(calibrator.busiest.columns.count, calibrator.columns.count);
    const int64_t row = FLASH - at.first;
    assert_true(row >= calibrator.rows.first &&
                row < calibrator.rows.first + calibrator.rows.count);
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t x = 0; x < WIDTH; x++) {
            assert_true(calibrator.recorded[(v * SIDE + row) * WIDTH + x] ==
                        (v == 0 ? (float)(x % 2) : (float)v));
        }
    }
    v2v_calibrator_go(&calibrator, 0);
    assert_int_equal(calibrator.pixels, PIXELS);
    assert_memory_equal(calibrator.recorded, views, sizeof views);
    v2v_calibrator_fini(&calibrator);
}

static void cost_counts_iterations_of_the_whole_frame(void **state)
{
    (void)state;
    struct v2v_calibrator calibrator;
    const struct v2v_look thirds = {0, 1, 20, 3, 0}, pairs = {0, 1, 20, 1000, 0},
                          small = {SIDE, 1, 20, 3, 0};
    begin(&calibrator);
    assert_true(v2v_calibrator_cost(&calibrator, &thirds) == 3 * 20.0);
    assert_true(v2v_calibrator_cost(&calibrator, &pairs) == 4 * 20.0); /* 7 views by two */
    assert_float_equal(v2v_calibrator_cost(&calibrator, &small), 3 * 20.0 * SIDE / HEIGHT, 1e-4);
    calibrator.count = 5; /* few: one at a time */
    assert_true(v2v_calibrator_cost(&calibrator, &thirds) == 5 * 20.0);
    calibrator.count = VIEWS;
    v2v_calibrator_fini(&calibrator);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_look_is_where_view_0_varies_most),
        cmocka_unit_test(cost_counts_iterations_of_the_whole_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
