/* How bright and noisy frames are, and which are outside of what a network was trained on. */
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/level.h"

#include <math.h>
#include <stdio.h>

enum { VIEWS = 2, SIDE = 48, SAMPLES = VIEWS * SIDE * SIDE, FRAMES = 3 };

static float views[SAMPLES], scratch[SAMPLES];

/* Noise of a quarter of the mean. */
static void fill(float *x, double mean, uint64_t seed)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        x[i] = (float)(mean + 0.25 * mean * v2v_random_normal(seed, 0, (uint64_t)i));
    }
}

/* Tolerances are five standard errors of 4608 normal samples: 1 / sqrt(N) of sigma for the mean,
 * 1.2 / sqrt(N) for sigma by the median; of the percentile sqrt(p / N) / density(3.09) = 0.14. */
static void a_frame_of_known_noise_has_its_figures(void **state)
{
    (void)state;
    double level[V2V_LEVEL_FIGURES];
    const double sigma = 0.5, error = 5.0 / sqrt((double)SAMPLES);
    fill(views, 2.0, 3);
    v2v_level_of_frame(level, scratch, views, VIEWS, SIDE, SIDE);
    assert_true(fabs(level[V2V_LEVEL_MEAN] - 2.0) < error * sigma);
    assert_true(fabs(level[V2V_LEVEL_NOISE] - sigma) < 1.2 * error * sigma);
    assert_true(fabs(level[V2V_LEVEL_PEAK] - (2.0 + 3.09 * sigma)) < 5.0 * 0.14 * sigma);
    assert_true(level[V2V_LEVEL_RATIO] == level[V2V_LEVEL_NOISE] / level[V2V_LEVEL_MEAN]);
}

static void brightness_changes_all_but_the_ratio(void **state)
{
    (void)state;
    double level[V2V_LEVEL_FIGURES], brighter[V2V_LEVEL_FIGURES];
    fill(views, 2.0, 3);
    v2v_level_of_frame(level, scratch, views, VIEWS, SIDE, SIDE);
    for (int64_t i = 0; i < SAMPLES; i++) {
        views[i] *= 8.0f; /* rounds nowhere */
    }
    v2v_level_of_frame(brighter, scratch, views, VIEWS, SIDE, SIDE);
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        assert_true(brighter[f] == (f == V2V_LEVEL_RATIO ? 1.0 : 8.0) * level[f]);
    }
}

static void a_dark_or_broken_frame_has_none(void **state)
{
    (void)state;
    static const float first[] = {0.0f, NAN, INFINITY};
    double level[V2V_LEVEL_FIGURES];
    for (int k = 0; k < 3; k++) {
        fill(views, 0.0, 3);
        views[0] = first[k];
        v2v_level_of_frame(level, scratch, views, VIEWS, SIDE, SIDE);
        for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
            assert_true(isnan(level[f]));
        }
    }
}

/* Frames of these means. */
static struct v2v_recording *recording_of(const double means[FRAMES])
{
    static double values[FRAMES * SAMPLES];
    struct v2v_recording *recording = NULL;
    char path[512];
    for (int64_t t = 0; t < FRAMES; t++) {
        fill(views, means[t], (uint64_t)t);
        for (int64_t i = 0; i < SAMPLES; i++) {
            values[t * SAMPLES + i] = (double)views[i];
        }
    }
    snprintf(path, sizeof path, "%s/rec.h5", test_folder(NULL));
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .type = TEST_H5_F32,
                                              .rank = 4,
                                              .shape = {FRAMES, VIEWS, SIDE, SIDE},
                                              .values = values});
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    return recording;
}

static void a_range_is_of_all_frames_with_light(void **state)
{
    (void)state;
    static const double means[FRAMES] = {3.0, 0.0, 1.0};
    const struct v2v_scaling scaling = {.gain = 0.5};
    struct v2v_level_range range = {0};
    double level[V2V_LEVEL_FIGURES];
    struct v2v_recording *recording = recording_of(means);
    assert_ok(v2v_level_range_add(&range, recording, &scaling, NULL));
    assert_int_equal(range.frames, 2);
    for (int64_t t = 0; t < FRAMES; t += 2) {
        fill(views, means[t], (uint64_t)t);
        v2v_scaling_apply(&scaling, views, SAMPLES);
        v2v_level_of_frame(level, scratch, views, VIEWS, SIDE, SIDE);
        for (int f = 0; f < V2V_LEVEL_RATIO; f++) {
            assert_true(level[f] == (t == 0 ? range.most : range.least)[f]);
        }
    }
    v2v_recording_close(&recording);
}

static void the_frame_farthest_outside_is_found(void **state)
{
    (void)state;
    static const double trained[FRAMES] = {2.0, 3.0, 2.5}, seen[FRAMES] = {1.0, 0.0, 12.0};
    const struct v2v_scaling scaling = {.gain = 1.0};
    struct v2v_level_range range = {0};
    struct v2v_level_outlier outlier;
    struct v2v_recording *recording = recording_of(trained);
    assert_ok(v2v_level_range_add(&range, recording, &scaling, NULL));
    assert_ok(v2v_level_judge(&outlier, &range, 0, recording, &scaling, NULL));
    assert_true(outlier.factor == 1.0);
    v2v_recording_close(&recording);

    recording = recording_of(seen);
    assert_ok(v2v_level_judge(&outlier, &range, 0, recording, &scaling, NULL));
    assert_int_equal(outlier.frame, 2);
    assert_true(fabs(outlier.factor - 4.0) < 0.4); /* the figures' errors, above */
    assert_true(outlier.factor == outlier.value / range.most[outlier.figure]);
    /* the same noise of the mean: nothing that a homogeneous network would see */
    assert_ok(v2v_level_judge(&outlier, &range, 1, recording, &scaling, NULL));
    assert_true(outlier.factor < 1.1);
    /* the dimmest frame, when the brightest is no more */
    const struct v2v_scaling dimmer = {.gain = 0.25};
    assert_ok(v2v_level_judge(&outlier, &range, 0, recording, &dimmer, NULL));
    assert_int_equal(outlier.frame, 0);
    assert_true(fabs(outlier.factor - 8.0) < 0.8);
    /* of old files */
    range.frames = 0;
    assert_ok(v2v_level_judge(&outlier, &range, 0, recording, &scaling, NULL));
    assert_true(outlier.factor == 1.0);
    v2v_recording_close(&recording);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_frame_of_known_noise_has_its_figures),
        cmocka_unit_test(brightness_changes_all_but_the_ratio),
        cmocka_unit_test(a_dark_or_broken_frame_has_none),
        cmocka_unit_test(a_range_is_of_all_frames_with_light),
        cmocka_unit_test(the_frame_farthest_outside_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
