#include "support.h"

#include "v2v3d/sim/noise.h"

#include <math.h>
#include <string.h>

enum { COUNT = 200000 };
static float clean[COUNT], noisy[COUNT], other[COUNT];

static void fill_clean(float value)
{
    for (int64_t i = 0; i < COUNT; i++) {
        clean[i] = value;
    }
}

/** Mean and variance of noisy - clean. */
static void moments(double *mean, double *variance)
{
    double sum = 0, squares = 0;
    for (int64_t i = 0; i < COUNT; i++) {
        double d = (double)noisy[i] - (double)clean[i];
        sum += d;
        squares += d * d;
    }
    *mean = sum / COUNT;
    *variance = squares / COUNT - *mean * *mean;
}

static void specifications_are_parsed_strictly(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        enum v2v_status rc;
        int kind;
        double amount;
    } cases[] = {
        {"none", V2V_OK, V2V_NOISE_NONE, 0},
        {"gaussian:0.2", V2V_OK, V2V_NOISE_GAUSSIAN, 0.2},
        {"gaussian:0", V2V_OK, V2V_NOISE_GAUSSIAN, 0},
        {"poisson:1000", V2V_OK, V2V_NOISE_POISSON, 1000},
        {"", V2V_E_USAGE, 0, 0},
        {"gaussian", V2V_E_USAGE, 0, 0},
        {"gaussian:", V2V_E_USAGE, 0, 0},
        {"gaussian:-0.1", V2V_E_USAGE, 0, 0},
        {"gaussian:0.1x", V2V_E_USAGE, 0, 0},
        {"gaussian:nan", V2V_E_USAGE, 0, 0},
        {"gaussian:0,1", V2V_E_USAGE, 0, 0},
        {"poisson:0", V2V_E_USAGE, 0, 0},
        {"poisson:inf", V2V_E_USAGE, 0, 0},
        {"Poisson:5", V2V_E_USAGE, 0, 0},
        {"none:1", V2V_E_USAGE, 0, 0},
        {"camera:500", V2V_OK, V2V_NOISE_CAMERA, 500},
        {"camera:500:0.5:200:2", V2V_OK, V2V_NOISE_CAMERA, 500},
        {"camera", V2V_E_USAGE, 0, 0},
        {"camera:", V2V_E_USAGE, 0, 0},
        {"camera:500:", V2V_E_USAGE, 0, 0},
        {"camera:500:0", V2V_E_USAGE, 0, 0},
        {"camera:500:1:65536", V2V_E_USAGE, 0, 0},
        {"camera:500:1:100:-1", V2V_E_USAGE, 0, 0},
        {"camera:500:1:100:1:1", V2V_E_USAGE, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_noise noise;
        enum v2v_status rc = v2v_noise_parse(&noise, cases[i].text);
        if (rc != cases[i].rc) {
            fail_msg("'%s' gives %s", cases[i].text, v2v_status_name(rc));
        }
        if (rc == V2V_OK) {
            assert_int_equal(noise.kind, cases[i].kind);
            assert_true(noise.amount == cases[i].amount);
        }
    }
}

static void level_is_the_percentile_and_darkness_is_refused(void **state)
{
    (void)state;
    struct v2v_noise noise = {.kind = V2V_NOISE_GAUSSIAN, .amount = 0.1};
    float ramp[201];
    for (int i = 0; i <= 200; i++) {
        ramp[i] = (float)i;
    }
    assert_ok(v2v_noise_level(&noise, ramp, 201));
    assert_true(noise.level == 199); /* 99.5 % of 200 steps */
    fill_clean(0);
    assert_int_equal(v2v_noise_level(&noise, clean, COUNT), V2V_E_INPUT);
    clean[7] = 1;
    for (int64_t i = 8; i < COUNT; i++) {
        clean[i] = 1e-7f; /* round-off of a single sample's transform */
    }
    assert_int_equal(v2v_noise_level(&noise, clean, COUNT), V2V_E_INPUT);
    noise.kind = V2V_NOISE_NONE;
    assert_ok(v2v_noise_level(&noise, clean, COUNT));
}

static void gaussian_noise_has_its_mean_and_deviation(void **state)
{
    (void)state;
    const struct v2v_noise noise = {.kind = V2V_NOISE_GAUSSIAN, .amount = 0.2, .level = 5};
    const double sigma = 0.2 * 5;
    double mean, variance;
    fill_clean(3);
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    moments(&mean, &variance);
    /* Five standard deviations of the estimates: sigma/sqrt(n), sigma^2*sqrt(2/n). */
    assert_true(fabs(mean) < 5 * sigma / sqrt(COUNT));
    assert_true(fabs(variance - sigma * sigma) < 5 * sigma * sigma * sqrt(2.0 / COUNT));
}

static void poisson_noise_has_its_mean_and_variance(void **state)
{
    (void)state;
    /* 40 photons at level 5: below and above the samplers' switch at a mean of 30. */
    static const float values[] = {0.5f, 5, 20};
    const struct v2v_noise noise = {.kind = V2V_NOISE_POISSON, .amount = 40, .level = 5};
    for (int i = 0; i < 3; i++) {
        double mean, variance, unit = 5.0 / 40, photons = values[i] / unit;
        fill_clean(values[i]);
        v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
        moments(&mean, &variance);
        /* Of a Poisson number of mean m the estimates deviate by sqrt(m/n) and
         * sqrt((m + 2m^2)/n). */
        double bound = 5 * sqrt((photons + 2 * photons * photons) / COUNT);
        assert_true(fabs(mean / unit) < 5 * sqrt(photons / COUNT));
        assert_true(fabs(variance / (unit * unit) - photons) < bound);
    }
}

static void photons_beyond_what_can_be_drawn_are_refused(void **state)
{
    (void)state;
    struct v2v_noise noise = {.kind = V2V_NOISE_POISSON, .amount = 1e12, .level = 1};
    fill_clean(999);
    assert_ok(v2v_noise_check(&noise, clean, COUNT));
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    fill_clean(1001);
    assert_int_equal(v2v_noise_check(&noise, clean, COUNT), V2V_E_INPUT);
    noise.kind = V2V_NOISE_CAMERA; /* which is full before */
    noise.gain = 1e-6;
    assert_ok(v2v_noise_check(&noise, clean, COUNT));
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    assert_true(noisy[0] == V2V_NOISE_MOST_COUNTS);
}

static void a_camera_is_told_by_up_to_four_numbers(void **state)
{
    (void)state;
    struct v2v_noise noise;
    assert_ok(v2v_noise_parse(&noise, "camera:500"));
    assert_true(noise.gain == 1 && noise.offset == 100 && noise.read == 1.6);
    assert_ok(v2v_noise_parse(&noise, "camera:500:0.5:200:2"));
    assert_true(noise.gain == 0.5 && noise.offset == 200 && noise.read == 2);
}

static void a_cameras_counts_have_their_mean_and_variance(void **state)
{
    (void)state;
    static const float values[] = {0, 0.5f, 5, 20};
    const struct v2v_noise noise = {
        .kind = V2V_NOISE_CAMERA, .amount = 40, .gain = 3, .offset = 100, .read = 1.5, .level = 5};
    for (int i = 0; i < 4; i++) {
        const double photons = values[i] * 40 / 5;
        /* Poisson, read noise, and rounding. */
        const double expected = 9 * (photons + 1.5 * 1.5) + 1.0 / 12;
        double mean, variance;
        fill_clean(values[i]);
        v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
        for (int64_t k = 0; k < COUNT; k++) {
            assert_true(noisy[k] == rintf(noisy[k]));
        }
        v2v_noise_expected(clean, clean, COUNT, &noise);
        assert_true(fabs((double)clean[0] - (100 + 3 * photons)) < 1e-4);
        moments(&mean, &variance);
        /* Five standard deviations of the estimates, as for Poisson numbers. */
        assert_true(fabs(mean) < 5 * sqrt(expected / COUNT));
        assert_true(fabs(variance - expected) <
                    5 * sqrt((81 * photons + 2 * expected * expected) / COUNT));
    }
}

static void a_camera_saturates_on_both_sides(void **state)
{
    (void)state;
    struct v2v_noise noise = {.kind = V2V_NOISE_CAMERA, .amount = 1e6, .gain = 1, .level = 1};
    fill_clean(1);
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    for (int64_t i = 0; i < COUNT; i++) {
        assert_true(noisy[i] == V2V_NOISE_MOST_COUNTS);
    }
    noise.read = 10;
    fill_clean(0);
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    int64_t dark = 0;
    for (int64_t i = 0; i < COUNT; i++) {
        assert_true(noisy[i] >= 0);
        dark += noisy[i] == 0;
    }
    assert_true(dark > COUNT / 2); /* half of the read noise is below 0, and some is rounded */
}

static void darkness_stays_dark_under_poisson_noise(void **state)
{
    (void)state;
    const struct v2v_noise noise = {.kind = V2V_NOISE_POISSON, .amount = 40, .level = 5};
    fill_clean(-1);
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    for (int64_t i = 0; i < COUNT; i++) {
        assert_true(noisy[i] == 0);
    }
}

static void frames_and_seeds_draw_unrelated_noise(void **state)
{
    (void)state;
    static const struct {
        uint64_t seed;
        int64_t t;
    } cases[] = {{5, 1}, {6, 0}};
    const struct v2v_noise noise = {.kind = V2V_NOISE_GAUSSIAN, .amount = 1, .level = 1};
    fill_clean(0);
    v2v_noise_apply(noisy, clean, COUNT, &noise, 5, 0, 0);
    for (int k = 0; k < 2; k++) {
        double product = 0;
        v2v_noise_apply(other, clean, COUNT, &noise, cases[k].seed, cases[k].t, 0);
        for (int64_t i = 0; i < COUNT; i++) {
            product += (double)noisy[i] * (double)other[i];
        }
        assert_true(fabs(product / COUNT) < 5 / sqrt(COUNT)); /* five standard deviations */
    }
}

static void noise_does_not_depend_on_how_samples_are_split(void **state)
{
    (void)state;
    static const char *const texts[] = {"gaussian:0.3", "poisson:100", "camera:100", "none"};
    for (int k = 0; k < 4; k++) {
        struct v2v_noise noise;
        assert_ok(v2v_noise_parse(&noise, texts[k]));
        noise.level = 2;
        fill_clean(1.5f);
        v2v_noise_apply(noisy, clean, COUNT, &noise, 9, 4, 0);
        int64_t cut = 12345;
        v2v_noise_apply(other + cut, clean + cut, COUNT - cut, &noise, 9, 4, cut);
        memcpy(other, clean, (size_t)cut * sizeof *other);
        v2v_noise_apply(other, other, cut, &noise, 9, 4, 0); /* in place */
        assert_memory_equal(noisy, other, sizeof noisy);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(specifications_are_parsed_strictly),
        cmocka_unit_test(level_is_the_percentile_and_darkness_is_refused),
        cmocka_unit_test(gaussian_noise_has_its_mean_and_deviation),
        cmocka_unit_test(poisson_noise_has_its_mean_and_variance),
        cmocka_unit_test(photons_beyond_what_can_be_drawn_are_refused),
        cmocka_unit_test(a_camera_is_told_by_up_to_four_numbers),
        cmocka_unit_test(a_cameras_counts_have_their_mean_and_variance),
        cmocka_unit_test(a_camera_saturates_on_both_sides),
        cmocka_unit_test(darkness_stays_dark_under_poisson_noise),
        cmocka_unit_test(frames_and_seeds_draw_unrelated_noise),
        cmocka_unit_test(noise_does_not_depend_on_how_samples_are_split),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
