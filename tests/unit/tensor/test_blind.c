/* The example of tensor/blind.h: what sees nothing is found, and the dark of few photons, coarse
 * counts and saturated samples are not that; noise is that of the samples that see. */
#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { IMAGES = 4, SIDE = 96, PIXELS = SIDE * SIDE, SAMPLES = IMAGES * PIXELS };

static float whole[SAMPLES], images[SAMPLES], scratch[SAMPLES];
static uint8_t marks[SAMPLES];

/* A broad spot of light of 1 at most, which leaves dark corners. */
static double light_at(int64_t i)
{
    const double y = (double)(i / SIDE % SIDE) - 40.0, x = (double)(i % SIDE) - 50.0;
    return exp(-(y * y + x * x) / 200.0);
}

/* In photons of so much each (0: none), with noise beside them, in counts of so much (0: any). */
static void make(double photon, double noise, double count)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double light = light_at(i);
        const double made =
            photon > 0.0 ? photon * (double)v2v_random_poisson(91, 0, (uint64_t)i, light / photon)
                         : light;
        const double noisy = made + noise * v2v_random_normal(91, 1, (uint64_t)i);
        whole[i] = (float)(count > 0.0 ? count * rint(noisy / count) : noisy);
    }
    memcpy(images, whole, sizeof images);
}

enum mask { APERTURE, OFF_CENTRE, CORNERS, RIM, IMAGE, ROWS, COLUMN, MASKS };

static int is_masked(enum mask mask, int64_t i)
{
    const int64_t v = i / PIXELS, y = i / SIDE % SIDE, x = i % SIDE;
    const double dy = (double)y - 47.5, dx = (double)x - 47.5, move = 4.0 * (double)v;
    switch (mask) {
    case APERTURE:
        return dy * dy + dx * dx > 40.0 * 40.0;
    case OFF_CENTRE:
        return (dy - move) * (dy - move) + dx * dx > 48.0 * 48.0;
    case CORNERS:
        return fabs(dy) + fabs(dx) > 70.0;
    case RIM:
        return y < 9 || x < 9;
    case IMAGE:
        return v == 1;
    case ROWS:
        return y >= 30 && y < 40;
    default:
        return x == 17 && v != 2;
    }
}

static double zero; /* what samples without light are about */

static int64_t find(void)
{
    return v2v_blind_find(marks, images, zero, IMAGES, SIDE, SIDE);
}

/* @param part of the masked samples that may be wrong: counts have the mask's value next to it by
 * chance, next to a column about half as often as there is column */
static void check_masks(const float *values, int count, double part)
{
    for (enum mask mask = 0; mask < MASKS; mask++) {
        for (int k = 0; k < count; k++) {
            int64_t masked = 0, wrong = 0;
            memcpy(images, whole, sizeof images);
            for (int64_t i = 0; i < SAMPLES; i++) {
                images[i] = is_masked(mask, i) ? values[k] : images[i];
                masked += is_masked(mask, i);
            }
            (void)find();
            for (int64_t i = 0; i < SAMPLES; i++) {
                wrong += marks[i] != is_masked(mask, i);
            }
            if (!((double)wrong <= part * (double)masked)) {
                fail_msg("mask %d of %g: %d of %d wrong", (int)mask, (double)values[k], (int)wrong,
                         (int)masked);
            }
        }
    }
}

static void masks_are_found(void **state)
{
    (void)state;
    make(0.0, 0.1, 0.0);
    check_masks((const float[]){0.0f, 0.25f, -2.0f}, 3, 0.0);
    make(0.02, 0.03, 0.0);
    check_masks((const float[]){0.0f, 0.25f, -2.0f}, 3, 0.0);
    make(0.01, 0.016, 0.01); /* a camera of 100 photons: 1.6 counts of read noise */
    check_masks((const float[]){-1.0f}, 1, 0.0);
    check_masks((const float[]){0.0f}, 1, 1.0);
}

static void check_seen(const char *what, double of)
{
    const int64_t found = find();
    if (found != 0) {
        fail_msg("%s, %g: %d samples see nothing", what, of, (int)found);
    }
    for (int64_t i = 0; i < SAMPLES; i++) {
        assert_int_equal(marks[i], 0);
    }
}

/* From one photon where it is brightest to ten thousand: most samples are 0; also less an offset
 * that is none. */
static void the_dark_of_photons_is_seen(void **state)
{
    (void)state;
    static const double photons[] = {1.0, 0.1, 0.01, 0.001, 0.0001};
    for (size_t p = 0; p < sizeof photons / sizeof photons[0]; p++) {
        make(photons[p], 0.0, 0.0);
        check_seen("photons", photons[p]);
        for (int64_t i = 0; i < SAMPLES; i++) {
            images[i] -= 0.5f;
        }
        check_seen("photons below zero", photons[p]);
    }
    for (int64_t i = 0; i < SAMPLES; i++) { /* one photon in a hundred pixels, far from others */
        images[i] = v2v_random_poisson(92, 0, (uint64_t)i, 0.01) > 0 ? 1.0f : 0.0f;
    }
    check_seen("single photons", 0.01);
}

/* Read noise of a tenth of a count to two: the dark is of one value but for a few samples, or many,
 * above and below. */
static void the_dark_of_coarse_counts_is_seen(void **state)
{
    (void)state;
    for (double noise = 0.1; noise < 2.0; noise *= 1.1) {
        make(0.01, 0.01 * noise, 0.01);
        check_seen("counts of photons", noise);
        make(0.0, 0.01 * noise, 0.01);
        check_seen("counts", noise);
    }
}

/* Light of a hundred counts that is smooth over many pixels: counts of one value in rings. */
static void smooth_light_of_coarse_counts_is_seen(void **state)
{
    (void)state;
    for (double noise = 0.03; noise < 1.0; noise *= 1.5) {
        for (double width = 500.0; width < 1e5; width *= 3.0) {
            for (int64_t i = 0; i < SAMPLES; i++) {
                const double light = 100.0 * pow(light_at(i), 200.0 / width);
                images[i] = (float)rint(light + noise * v2v_random_normal(91, 1, (uint64_t)i));
            }
            check_seen("smooth light", noise);
        }
    }
}

/* Photons beside a mask that lies below them. */
static void the_dark_of_photons_is_seen_beside_a_mask(void **state)
{
    (void)state;
    make(0.01, 0.0, 0.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        images[i] = is_masked(CORNERS, i) ? -0.7f : images[i];
    }
    (void)find();
    for (int64_t i = 0; i < SAMPLES; i++) {
        assert_true(!marks[i] || is_masked(CORNERS, i));
    }
}

/* Cut off at both ends. */
static void saturated_and_clipped_samples_are_seen(void **state)
{
    (void)state;
    make(0.0, 0.1, 0.0);
    for (int64_t i = 0; i < SAMPLES; i++) {
        images[i] = fminf(fmaxf(images[i], 0.0f), 0.3f);
    }
    check_seen("cut off", 0.3);
}

static void images_of_one_value_are_seen(void **state)
{
    (void)state;
    for (int64_t i = 0; i < SAMPLES; i++) {
        images[i] = 7.0f;
    }
    check_seen("one value", 7.0);
    for (int64_t i = 0; i < SAMPLES; i++) { /* no other varies */
        images[i] = (float)(i / PIXELS);
    }
    check_seen("one value each", 4.0);
}

/* A mask at the camera's zero, which nothing tells, and the dark well above it. Light that was cut
 * off at zero, or is of photons, or has no noise, lies apart from nothing. */
static void masks_far_below_an_unknown_zero_are_found(void **state)
{
    (void)state;
    zero = (double)NAN;
    make(0.01, 0.016, 0.01);
    for (int64_t i = 0; i < SAMPLES; i++) {
        whole[i] += 1.0f;
    }
    check_masks((const float[]){0.0f}, 1, 0.0);
    for (double noise = 0.0; noise < 0.2; noise += 0.1) {
        make(0.0, noise, 0.0);
        for (int64_t i = 0; i < SAMPLES; i++) {
            images[i] = fmaxf(images[i] - 0.1f, 0.0f);
        }
        check_seen("cut off at 0", noise);
    }
    make(0.01, 0.0, 0.0);
    check_seen("photons", 0.01);
    zero = 0.0;
}

static void what_sees_nothing_becomes_dark_or_what_its_image_sees(void **state)
{
    (void)state;
    float views[] = {1.0f, V2V_BLIND, 4.0f, V2V_BLIND, V2V_BLIND, V2V_BLIND, -2.0f, 0.0f, 5.0f};
    float filled[] = {1.0f, 2.5f, 4.0f, 0.0f, 0.0f, 0.0f, -2.0f, 0.0f, 5.0f};
    float dark[] = {1.0f, 0.0f, 4.0f, 0.0f, 0.0f, 0.0f, -2.0f, 0.0f, 5.0f};
    float copy[9];
    memcpy(copy, views, sizeof views);
    v2v_blind_fill(copy, 3, 3);
    assert_memory_equal(copy, filled, sizeof copy);
    v2v_blind_darken(views, 9);
    assert_memory_equal(views, dark, sizeof views);
}

/* Of the 36,000 differences half at least are left, whose median, as they share samples, is known
 * to 1 % and a little: of which this allows three. */
static void noise_is_of_what_sees(void **state)
{
    (void)state;
    make(0.0, 0.1, 0.0);
    const double without = v2v_noise_of_images(scratch, images, IMAGES, SIDE, SIDE);
    for (enum mask mask = 0; mask < MASKS; mask++) {
        memcpy(images, whole, sizeof images);
        for (int64_t i = 0; i < SAMPLES; i++) {
            images[i] = is_masked(mask, i) ? 0.0f : images[i];
        }
        const int64_t blind = find();
        v2v_blind_leave(images, marks, SAMPLES);
        assert_int_equal(v2v_blind_count(images, SAMPLES), blind);
        const double found = v2v_noise_of_images(scratch, images, IMAGES, SIDE, SIDE);
        const struct v2v_noise_line line =
            v2v_noise_line_of_images(images, IMAGES, SIDE, SIDE, 1.3);
        if (!(fabs(found / without - 1.0) < 0.03 && fabs(line.gain) < 5.0 * line.gain_error)) {
            fail_msg("mask %d: noise %g, not %g; gain %g, +- %g", (int)mask, found, without,
                     line.gain, line.gain_error);
        }
    }
    for (int64_t i = 0; i < SAMPLES; i++) {
        images[i] = V2V_BLIND;
    }
    assert_true(v2v_noise_of_images(scratch, images, IMAGES, SIDE, SIDE) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(masks_are_found),
        cmocka_unit_test(the_dark_of_photons_is_seen),
        cmocka_unit_test(the_dark_of_coarse_counts_is_seen),
        cmocka_unit_test(smooth_light_of_coarse_counts_is_seen),
        cmocka_unit_test(the_dark_of_photons_is_seen_beside_a_mask),
        cmocka_unit_test(saturated_and_clipped_samples_are_seen),
        cmocka_unit_test(images_of_one_value_are_seen),
        cmocka_unit_test(masks_far_below_an_unknown_zero_are_found),
        cmocka_unit_test(what_sees_nothing_becomes_dark_or_what_its_image_sees),
        cmocka_unit_test(noise_is_of_what_sees),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
