/* Means of squares, and smoothing, against sums by hand. */
#include "support.h"

#include "v2v3d/tensor/coarse.h"

#include <math.h>
#include <string.h>

enum {
    COUNT = 2,
    HEIGHT = 7,
    WIDTH = 10,
    PIXELS = HEIGHT * WIDTH,
    SIDE = 4,
    ROWS = 2,
    COLUMNS = 3
};

/* Whole numbers: their sums, and means of 16, 12, 8 and 6, are exact or rounded once. */
static float value(int k, int y, int x)
{
    return (float)(100 * k + 10 * y + x);
}

static void fill(float *images)
{
    for (int i = 0; i < COUNT * PIXELS; i++) {
        images[i] = value(i / PIXELS, i / WIDTH % HEIGHT, i % WIDTH);
    }
}

static void squares_are_means_of_their_pixels(void **state)
{
    (void)state;
    float from[COUNT * PIXELS], to[COUNT * ROWS * COLUMNS];
    fill(from);
    v2v_coarse_images(to, from, COUNT, HEIGHT, WIDTH, SIDE, 0.5f);
    for (int i = 0; i < COUNT * ROWS * COLUMNS; i++) {
        const int k = i / (ROWS * COLUMNS), first = SIDE * (i / COLUMNS % ROWS);
        const int left = SIDE * (i % COLUMNS);
        double sum = 0.0;
        int pixels = 0;
        for (int y = first; y < first + SIDE && y < HEIGHT; y++) {
            for (int x = left; x < left + SIDE && x < WIDTH; x++, pixels++) {
                sum += (double)value(k, y, x);
            }
        }
        assert_true(fabs((double)to[i] - 0.5 * sum / pixels) <= 2e-7 * sum);
    }
}

static void what_is_not_finite_counts_as_nothing(void **state)
{
    (void)state;
    float from[PIXELS] = {NAN, 4.0f, INFINITY, -INFINITY}, to[ROWS * COLUMNS];
    v2v_coarse_images(to, from, 1, HEIGHT, WIDTH, SIDE, 1.0f);
    assert_true(to[0] == 0.25f && to[1] == 0.0f);
}

/* A slope stays but at the edges, where it is a quarter of a step nearer to what is inside. */
static void a_slope_stays_as_it_is(void **state)
{
    (void)state;
    float images[COUNT * PIXELS];
    fill(images);
    v2v_soften_images(images, COUNT, HEIGHT, WIDTH);
    for (int i = 0; i < COUNT * PIXELS; i++) {
        const int y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const double along_y = y == 0 ? 2.5 : y == HEIGHT - 1 ? -2.5 : 0.0;
        const double along_x = x == 0 ? 0.25 : x == WIDTH - 1 ? -0.25 : 0.0;
        assert_true((double)images[i] == (double)value(i / PIXELS, y, x) + along_y + along_x);
    }
}

static void a_point_becomes_the_taps(void **state)
{
    (void)state;
    float image[PIXELS] = {0};
    image[3 * WIDTH + 5] = 16.0f;
    v2v_soften_images(image, 1, HEIGHT, WIDTH);
    for (int i = 0; i < PIXELS; i++) {
        const int y = i / WIDTH - 3, x = i % WIDTH - 5;
        const float expected = y * y > 1 || x * x > 1 ? 0.0f : (float)((2 - y * y) * (2 - x * x));
        assert_true(image[i] == expected);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(squares_are_means_of_their_pixels),
        cmocka_unit_test(what_is_not_finite_counts_as_nothing),
        cmocka_unit_test(a_slope_stays_as_it_is),
        cmocka_unit_test(a_point_becomes_the_taps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
