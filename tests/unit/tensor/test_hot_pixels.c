#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/tensor/hot_pixels.h"

#include <math.h>
#include <string.h>

enum { IMAGES = 3, HEIGHT = 160, WIDTH = 192, PIXELS = HEIGHT * WIDTH, SAMPLES = IMAGES * PIXELS };

static float images[SAMPLES], whole[SAMPLES], scratch[V2V_HOT_PIXELS_SCRATCH];

/* Spots of light, 100 bright, as narrow as a sharpness of 0.31 allows, on `base`, and noise. */
static void draw(double base, double noise)
{
    const double spot[3][3] = {{20.0, 60.0, 20.0}, {60.0, 100.0, 60.0}, {20.0, 60.0, 20.0}};
    for (int64_t i = 0; i < SAMPLES; i++) {
        const int64_t y = i / WIDTH % HEIGHT % 8, x = i % WIDTH % 8;
        const double light = y >= 3 && y < 6 && x >= 3 && x < 6 ? spot[y - 3][x - 3] : 0.0;
        images[i] = whole[i] =
            (float)(base + light + noise * v2v_random_normal(11, 0, (uint64_t)i));
    }
}

static int64_t mend(double sharpness)
{
    return v2v_hot_pixels_mend(images, scratch, IMAGES, HEIGHT, WIDTH, sharpness).hot;
}

static void set(int64_t image, int64_t y, int64_t x, double value)
{
    images[image * PIXELS + y * WIDTH + x] += (float)value;
}

/* Beside others, too, in corners, and whatever the camera's zero is. */
static void hot_pixels_become_their_neighbours_median(void **state)
{
    (void)state;
    static const double bases[] = {0.0, 100.0, -20.0, 32767.0};
    for (size_t k = 0; k < sizeof bases / sizeof *bases; k++) {
        draw(bases[k], 2.0);
        assert_int_equal(mend(0.31), 0);
        assert_memory_equal(images, whole, sizeof images);
        set(0, 8, 8, 400.0);
        set(0, 8, 9, 300.0);
        set(1, 0, 0, 1e4);
        set(2, HEIGHT - 1, WIDTH - 1, 500.0);
        set(2, 4, 4, 2000.0); /* in the middle of a spot */
        assert_int_equal(mend(0.31), 5);
        for (int64_t i = 0; i < SAMPLES; i++) {
            const int in_spot = i == 2 * PIXELS + 4 * WIDTH + 4;
            if (images[i] != whole[i]) {
                /* the median of at least three of noise 2; of a spot's flank 40, not 100 */
                assert_true(fabs((double)images[i] - (double)whole[i]) < (in_spot ? 70.0 : 12.0));
            }
        }
    }
}

static int64_t mend_cold(void)
{
    const struct v2v_mended mended =
        v2v_hot_pixels_mend(images, scratch, IMAGES, HEIGHT, WIDTH, INFINITY);
    assert_int_equal(mended.hot, 0);
    return mended.cold;
}

/* By itself and in pairs, in corners and spots, whatever PSFs and the camera's zero are. */
static void cold_pixels_become_their_neighbours_median(void **state)
{
    (void)state;
    static const double bases[] = {0.0, 100.0, -20.0, 32767.0};
    for (size_t k = 0; k < sizeof bases / sizeof *bases; k++) {
        draw(bases[k], 2.0);
        assert_int_equal(mend_cold(), 0);
        assert_memory_equal(images, whole, sizeof images);
        set(0, 8, 8, -40.0);
        set(0, 8, 9, -50.0);
        set(1, 0, 0, -1e6);
        set(2, HEIGHT - 1, WIDTH - 1, -500.0);
        set(2, 4, 4, -2000.0);
        for (int64_t i = 0; i < 31; i++) {
            set(1, 14 + i / 6, 14 + i % 6, -300.0 - 5.0 * (double)i);
        }
        assert_int_equal(mend_cold(), 36);
        for (int64_t i = 0; i < SAMPLES; i++) {
            /* six deviations of the noise; in a spot all of its light, 100, and three */
            const int is_light = (double)whole[i] - bases[k] > 10.0;
            if (images[i] != whole[i]) {
                assert_true(fabs((double)images[i] - (double)whole[i]) < (is_light ? 106.0 : 12.0));
            }
        }
    }
}

/* Beside one, light is not hot. */
static void light_beside_cold_pixels_stays(void **state)
{
    (void)state;
    draw(0.0, 2.0);
    set(0, 4, 5, -1e4);
    set(1, 5, 4, -3e4);
    const struct v2v_mended mended =
        v2v_hot_pixels_mend(images, scratch, IMAGES, HEIGHT, WIDTH, 0.31);
    assert_int_equal(mended.hot, 0);
    assert_int_equal(mended.cold, 2);
    assert_true(images[4 * WIDTH + 4] == whole[4 * WIDTH + 4]);
    assert_true(images[PIXELS + 4 * WIDTH + 4] == whole[PIXELS + 4 * WIDTH + 4]);
}

/* Up to a hundredth of a frame. */
static void many_cold_pixels_are_found(void **state)
{
    (void)state;
    int64_t many = 0;
    draw(100.0, 2.0);
    for (int64_t i = 37; i < SAMPLES; i += 151) {
        images[i] = 0.0f;
        many++;
    }
    assert_int_equal(mend_cold(), many);
}

/* What noise goes down to, parts and rows of a view that see nothing, and holes in light. */
static void what_is_dark_otherwise_stays(void **state)
{
    (void)state;
    draw(0.0, 2.0);
    set(0, 8, 8, -10.0);
    for (int64_t x = 0; x < 32; x++) {
        set(1, 20, x, -400.0);
        set(2, 20 + x / 8, 16 + x % 8, -400.0);
    }
    memcpy(whole, images, sizeof whole);
    assert_int_equal(mend_cold(), 0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        images[i] = whole[i] = 100.0f + 2.0f * (float)v2v_random_normal(3, 0, (uint64_t)i);
    }
    for (int64_t i = 0; i < 9; i++) {
        const float light[] = {0.8f, 0.6f, 0.8f, 0.6f, 0.4f};
        images[(10 + i / 3) * WIDTH + 10 + i % 3] *= light[i < 5 ? i : 8 - i];
    }
    memcpy(whole, images, sizeof whole);
    assert_int_equal(mend_cold(), 0);
    assert_memory_equal(images, whole, sizeof images);
}

/* Bright points that the optics can make stay, and what is not far above light and noise. */
static void what_light_can_make_stays(void **state)
{
    (void)state;
    draw(0.0, 2.0);
    set(0, 2, 4, 20.0);
    memcpy(whole, images, sizeof whole);
    assert_int_equal(mend(0.31), 0);
    set(0, 2, 4, 400.0);
    memcpy(whole, images, sizeof whole);
    assert_int_equal(mend(INFINITY), 0); /* a PSF of one pixel */
    assert_int_equal(mend(50.0), 0);
    assert_memory_equal(images, whole, sizeof images);
}

/* Of few photons most pixels have none, and one alone is no hot pixel; one of 40 counts is. */
static void single_photons_stay(void **state)
{
    (void)state;
    static const double scales[] = {1.0, 7.5, 1e-6};
    for (size_t k = 0; k < sizeof scales / sizeof *scales; k++) {
        int64_t photons = 0;
        draw(0.0, 0.0);
        for (int64_t i = 0; i < SAMPLES; i++) {
            const int64_t n =
                v2v_random_poisson(5, 1, (uint64_t)i, 0.01 + 0.005 * (double)whole[i]);
            images[i] = whole[i] = (float)(scales[k] * (double)n);
            photons += n;
        }
        assert_true(photons > SAMPLES / 100 && photons < SAMPLES / 5);
        assert_int_equal(mend(0.31), 0);
        assert_memory_equal(images, whole, sizeof images);
        set(0, 8, 8, 40.0 * scales[k]);
        assert_int_equal(mend(0.31), 1);
    }
}

/* A frame that is dark but for a pixel has no light to compare it with. */
static void nothing_is_compared_with_the_dark(void **state)
{
    (void)state;
    memset(images, 0, sizeof images);
    set(0, 8, 8, 400.0);
    assert_int_equal(mend(0.31), 0);
    assert_true(images[8 * WIDTH + 8] == 400.0f);
    assert_int_equal(v2v_hot_pixels_mend(images, scratch, 1, 1, 1, 0.31).hot, 0);
    assert_int_equal(v2v_hot_pixels_mend(images, scratch, 2, 1, 2, 0.31).hot, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hot_pixels_become_their_neighbours_median),
        cmocka_unit_test(cold_pixels_become_their_neighbours_median),
        cmocka_unit_test(light_beside_cold_pixels_stays),
        cmocka_unit_test(many_cold_pixels_are_found),
        cmocka_unit_test(what_is_dark_otherwise_stays),
        cmocka_unit_test(single_photons_stay),
        cmocka_unit_test(what_light_can_make_stays),
        cmocka_unit_test(nothing_is_compared_with_the_dark),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
