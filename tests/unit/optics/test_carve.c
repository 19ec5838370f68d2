/* Space carving: light is where the shifted views agree. */
#include "small_shifts.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/carve.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 8, SLICES = 5, HEIGHT = 62, WIDTH = 90, PIXELS = HEIGHT * WIDTH };
enum { ROWS = (HEIGHT + 3) / 4, COLUMNS = (WIDTH + 3) / 4 };

static float views[VIEWS * PIXELS], light[ROWS * COLUMNS];

static void fill_background(double mean, double noise)
{
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(mean + noise * v2v_random_normal(3, 1, (uint64_t)i));
    }
}

/* A square of 5 x 5 pixels of light 1 that sits at (y,x) in slice z, as the views see it. */
static void add_square(const struct v2v_shifts *shifts, int64_t z, int64_t y, int64_t x,
                       int64_t first_view, int64_t last_view)
{
    for (int64_t v = first_view; v < last_view; v++) {
        int64_t i = v * SLICES + z;
        for (int64_t k = 0; k < 25; k++) {
            int64_t row = y + shifts->dy[i] + k / 5 - 2, column = x + shifts->dx[i] + k % 5 - 2;
            views[(v * HEIGHT + row) * WIDTH + column] += 1.0f;
        }
    }
}

static double carve(const struct v2v_shifts *shifts)
{
    struct v2v_carve *carve = NULL;
    assert_ok(v2v_carve_create(&carve, shifts, HEIGHT, WIDTH));
    double noise = v2v_carve_light(carve, light, views);
    v2v_carve_destroy(&carve);
    return noise;
}

static int64_t brightest_tile(void)
{
    int64_t best = 0;
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        best = light[i] > light[best] ? i : best;
    }
    return best;
}

static void light_that_all_views_show_is_found_in_any_slice(void **state)
{
    (void)state;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    for (int64_t z = 0; z < SLICES; z++) {
        fill_background(3.0, 0.0);
        add_square(&shifts, z, 30, 42, 0, VIEWS);
        carve(&shifts);
        assert_int_equal(brightest_tile(), 30 / 4 * COLUMNS + 42 / 4);
        assert_true(fabs((double)light[brightest_tile()] - 1.0) <= 1e-5);
        assert_true(fabs((double)light[0]) <= 1e-5);
    }
    v2v_shifts_fini(&shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

/* What is added everywhere is no background of it, and what is taken away is not added. */
static void light_of_a_difference_is_counted_from_zero(void **state)
{
    (void)state;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    struct v2v_carve *carve = NULL;
    fill_background(0.25, 0.0);
    add_square(&shifts, 3, 30, 42, 0, VIEWS);
    assert_ok(v2v_carve_create(&carve, &shifts, HEIGHT, WIDTH));
    v2v_carve_gain(carve, light, views);
    assert_int_equal(brightest_tile(), 30 / 4 * COLUMNS + 42 / 4);
    assert_true(fabs((double)light[brightest_tile()] - 1.25) <= 1e-5);
    assert_true(fabs((double)light[0] - 0.25) <= 1e-5);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = -views[i];
    }
    v2v_carve_gain(carve, light, views);
    assert_true((double)light[brightest_tile()] <= -0.25 + 1e-5);
    v2v_carve_destroy(&carve);
    v2v_shifts_fini(&shifts);
}

/* Half of the views, four of eight, are left out. */
static void light_that_half_the_views_show_is_none(void **state)
{
    (void)state;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    fill_background(3.0, 0.0);
    add_square(&shifts, 2, 30, 42, 2, 6);
    carve(&shifts);
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        assert_true(fabs((double)light[i]) <= 1e-5);
    }
    v2v_shifts_fini(&shifts);
}

static void noise_is_measured_and_seldom_looks_like_light(void **state)
{
    (void)state;
    int64_t above = 0;
    double sum = 0.0;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    fill_background(0.0, 0.3);
    double noise = carve(&shifts), expected = 0.3 / sqrt(VIEWS) / V2V_CARVE_BOX;
    print_message("noise %.5f, expected %.5f\n", noise, expected);
    /* medians of 5400 values a view err by 1.2533 / sqrt(5400) of the deviation each, in the mean
     * over 8 views by 0.6 %, neighbouring differences being alike: 1.5 times; four deviations */
    assert_true(fabs(noise / expected - 1.0) <= 4.0 * 0.006 * 1.5);
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        above += (double)light[i] > 3.0 * noise;
        sum += (double)light[i];
    }
    assert_true(above <= ROWS * COLUMNS / 100);
    assert_true(fabs(sum) < ROWS * COLUMNS * noise); /* nor does the background */
    v2v_shifts_fini(&shifts);
}

static void scaled_views_have_scaled_light(void **state)
{
    (void)state;
    static float first[ROWS * COLUMNS];
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    fill_background(0.2, 0.05);
    add_square(&shifts, 1, 20, 60, 0, VIEWS);
    double noise = carve(&shifts);
    memcpy(first, light, sizeof first);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] *= 0x1p-20f; /* exact */
    }
    assert_true(fabs(carve(&shifts) / (noise * 0x1p-20) - 1.0) <= 1e-6);
    for (int64_t i = 0; i < ROWS * COLUMNS; i++) {
        assert_true(fabs((double)light[i] * 0x1p20 - (double)first[i]) <= 1e-6);
    }
    v2v_shifts_fini(&shifts);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(light_that_all_views_show_is_found_in_any_slice),
        cmocka_unit_test(light_of_a_difference_is_counted_from_zero),
        cmocka_unit_test(light_that_half_the_views_show_is_none),
        cmocka_unit_test(noise_is_measured_and_seldom_looks_like_light),
        cmocka_unit_test(scaled_views_have_scaled_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
