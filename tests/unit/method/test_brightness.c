/* The factor between the brightness of two frames. */
#include "method/brightness.h"
#include "support.h"

#include "v2v3d/base/random.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 2, HEIGHT = 67, WIDTH = 85, SAMPLES = VIEWS * HEIGHT * WIDTH };
enum { PIECES = VIEWS * (HEIGHT / 8) * (WIDTH / 8) };
static const double noise = 0.3;

static float frame[SAMPLES], neighbour[SAMPLES], scene[SAMPLES];
static struct v2v_ratio ratios[PIECES];

static int setup(void **state)
{
    (void)state;
    for (int64_t i = 0; i < SAMPLES; i++) {
        scene[i] = 1.0f + 0.5f * (float)sin((double)(i % WIDTH) / 7.0) +
                   0.4f * (float)cos((double)(i / WIDTH) / 5.0);
    }
    return 0;
}

/* scale * scene, and noise if `draw` is not 0 */
static void make(float *to, double scale, uint64_t draw)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double drawn = draw > 0 ? noise * v2v_random_normal(17, draw, (uint64_t)i) : 0.0;
        to[i] = (float)(scale * (double)scene[i] + drawn);
    }
}

static double factor(void)
{
    return v2v_brightness_factor(ratios, frame, neighbour, VIEWS, HEIGHT, WIDTH, noise);
}

static void a_multiple_is_found_to_rounding(void **state)
{
    (void)state;
    assert_int_equal(v2v_brightness_pieces(VIEWS, HEIGHT, WIDTH), PIECES);
    make(frame, 1.0, 0);
    for (double scale = 0.26; scale < 4.0; scale *= 1.3) {
        make(neighbour, scale, 0);
        assert_float_equal(factor() * scale, 1.0, test_rounding(3));
    }
}

/* A median is known to 1.25 times what the mean is, of noise in both frames. The bias of the ratio
 * of a piece, of 64 samples of 1 in the mean, is the square of its noise at most. */
static void noise_does_not_move_it(void **state)
{
    (void)state;
    static const double scales[] = {0.5, 0.9, 1.0, 1.1, 2.0};
    for (uint64_t s = 0; s < 5; s++) {
        make(frame, scales[s], 1 + 2 * s);
        make(neighbour, 1.0, 2 + 2 * s);
        const double of_sum = noise * sqrt(1.0 + scales[s] * scales[s]) / sqrt(PIECES * 64.0);
        assert_true(fabs(factor() - scales[s]) < 5.0 * 1.25 * of_sum + noise * noise / 64.0);
    }
}

static void a_part_that_changes_otherwise_does_not_move_it(void **state)
{
    (void)state;
    make(frame, 1.0, 1);
    make(neighbour, 0.8, 2);
    for (int64_t i = 0; i < SAMPLES; i++) {
        frame[i] *= i % WIDTH < WIDTH / 8 ? 2.0f : 1.0f; /* 0.3 of the light now */
    }
    assert_true(fabs(factor() - 1.25) < 0.1);
}

static void what_is_dark_in_one_of_both_has_no_factor(void **state)
{
    (void)state;
    static const double scales[] = {0.0, 1.0};
    for (int s = 0; s < 2; s++) {
        make(frame, scales[s], 3);
        make(neighbour, scales[1 - s], 4);
        assert_true(factor() == 1.0);
    }
    make(frame, 0.0, 5);
    make(neighbour, 0.0, 6);
    assert_true(factor() == 1.0);
}

/* 15 bright squares of 8 x 8, then 16. */
static void a_few_pieces_tell_nothing(void **state)
{
    (void)state;
    for (int count = 15; count <= 16; count++) {
        memset(frame, 0, sizeof frame);
        memset(neighbour, 0, sizeof neighbour);
        for (int64_t i = 0; i < HEIGHT * WIDTH; i++) {
            const int64_t row = i / WIDTH / 8, column = i % WIDTH / 8;
            if (column < WIDTH / 8 && row * (WIDTH / 8) + column < count) {
                frame[i] = 2.0f;
                neighbour[i] = 4.0f;
            }
        }
        assert_true(factor() == (count < 16 ? 1.0 : 0.5));
    }
}

static void what_is_not_finite_is_left_out(void **state)
{
    (void)state;
    make(frame, 1.0, 0);
    make(neighbour, 2.0, 0);
    neighbour[3] = NAN;
    neighbour[40 * WIDTH + 9] = INFINITY;
    assert_float_equal(factor(), 0.5, test_rounding(3));
    for (int64_t i = 0; i < SAMPLES; i++) {
        neighbour[i] = NAN;
    }
    assert_true(factor() == 1.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_multiple_is_found_to_rounding),
        cmocka_unit_test(noise_does_not_move_it),
        cmocka_unit_test(a_part_that_changes_otherwise_does_not_move_it),
        cmocka_unit_test(what_is_dark_in_one_of_both_has_no_factor),
        cmocka_unit_test(a_few_pieces_tell_nothing),
        cmocka_unit_test(what_is_not_finite_is_left_out),
    };
    return cmocka_run_group_tests(tests, setup, NULL);
}
