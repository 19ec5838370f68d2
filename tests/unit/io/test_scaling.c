#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/scaling.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static char path[512];

/* A recording of two frames of one view. */
static struct v2v_recording *recording_as(enum test_h5_type type, const double values[8])
{
    struct v2v_recording *recording = NULL;
    snprintf(path, sizeof path, "%s/rec.h5", test_folder(NULL));
    test_h5_make(
        path,
        &(struct test_h5_spec){
            .dataset = "/views", .type = type, .rank = 4, .shape = {2, 1, 2, 2}, .values = values});
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    return recording;
}

static struct v2v_recording *recording_of(const double values[8])
{
    return recording_as(TEST_H5_U16, values);
}

static const double dim[8] = {0, 1, 2, 3, 4, 5, 6, 19};       /* mean 5 */
static const double peaked[8] = {0, 0, 0, 0, 0, 0, 0, 40000}; /* mean 5000, all 16 bits used */
static const double raised[8] = {32767, 32767, 32767, 32767, 32767, 32767, 32767, 32767 + 8};

/* Bright all over, but never as dark as signed counts are: nothing says that its zero is 32767. */
static const double glaring[8] = {9000, 9000, 9000, 9000, 60000, 60000, 60000, 60000};

static void offset_and_gain_follow_their_modes(void **state)
{
    (void)state;
    static const struct {
        const double *values;
        struct v2v_number offset, gain;
        double expected_offset, expected_gain;
    } cases[] = {
        {dim, {V2V_NUMBER_AUTO, 0}, {V2V_NUMBER_AUTO, 0}, 0, 0.04},
        {raised, {V2V_NUMBER_AUTO, 0}, {V2V_NUMBER_AUTO, 0}, 32767, 0.2},
        {peaked, {V2V_NUMBER_AUTO, 0}, {V2V_NUMBER_AUTO, 0}, 0, 4e-5},
        {glaring, {V2V_NUMBER_AUTO, 0}, {V2V_NUMBER_NONE, 0}, 0, 1},
        {raised, {V2V_NUMBER_NONE, 0}, {V2V_NUMBER_AUTO, 0}, 0, 0.2 / 32768},
        {raised, {V2V_NUMBER_AUTO, 0}, {V2V_NUMBER_NONE, 0}, 32767, 1},
        {dim, {V2V_NUMBER_GIVEN, 3}, {V2V_NUMBER_AUTO, 0}, 3, 0.1},
        {dim, {V2V_NUMBER_GIVEN, 3}, {V2V_NUMBER_GIVEN, 7}, 3, 7},
        {dim, {V2V_NUMBER_NONE, 9}, {V2V_NUMBER_NONE, 9}, 0, 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_input_settings settings = {.offset = cases[i].offset,
                                                    .gain = cases[i].gain};
        struct v2v_recording *recording = recording_of(cases[i].values);
        struct v2v_scaling scaling;
        assert_ok(v2v_scaling_decide(&scaling, recording, &settings, NULL));
        assert_true(scaling.offset == cases[i].expected_offset);
        assert_int_equal(scaling.is_guessed,
                         scaling.offset == 32767.0); /* none is given or stated */
        /* the mean: two divisions a frame and a sum of two frames, each rounding 2^-53, of a
         * mean up to 32768 times the one after the offset; gain: one more */
        assert_true(fabs(scaling.gain - cases[i].expected_gain) <=
                    8 * 32768 * 0x1p-53 * cases[i].expected_gain);
        v2v_recording_close(&recording);
    }
}

/* Of the first frame, where auto finds nothing to subtract; nothing is as bright there as 100 times
 * its only square. */
static void a_pedestal_is_told_where_nothing_is_said_of_one(void **state)
{
    (void)state;
    static const double bare[8] = {102, 102, 102, 102, 0, 0, 0, 0};
    static const struct {
        const double *values;
        struct v2v_number offset;
        double expected;
    } cases[] = {
        {bare, {V2V_NUMBER_AUTO, 0}, 102}, {bare, {V2V_NUMBER_NONE, 0}, 0},
        {bare, {V2V_NUMBER_GIVEN, 90}, 0}, {raised, {V2V_NUMBER_AUTO, 0}, 0},
        {peaked, {V2V_NUMBER_AUTO, 0}, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_input_settings settings = {.offset = cases[i].offset};
        struct v2v_recording *recording = recording_of(cases[i].values);
        struct v2v_scaling scaling;
        const enum v2v_status rc = v2v_scaling_decide(&scaling, recording, &settings, NULL);
        assert_true(rc == V2V_OK || cases[i].offset.mode == V2V_NUMBER_GIVEN);
        assert_true(scaling.pedestal == cases[i].expected);
        v2v_recording_close(&recording);
    }
}

/* Half of both frames behind a mask at 0, beside a dark of 100, noise of 4 counts and light of 30
 * in a quarter: the mean of what is seen is 15 above the dark, and no less behind the mask. */
static void a_mask_has_no_part_in_gain_and_pedestal(void **state)
{
    (void)state;
    enum { TALL = 64, WIDE = 64, COUNT = 2 * TALL * WIDE };
    static double values[COUNT];
    double sum = 0.0;
    for (int64_t i = 0; i < COUNT; i++) {
        const int64_t x = i % WIDE;
        const double light = x >= 48 ? 30.0 : 0.0;
        values[i] =
            x < WIDE / 2 ? 0.0 : rint(100.0 + light + 4.0 * v2v_random_normal(7, 0, (uint64_t)i));
        sum += values[i];
    }
    const double mean = sum / (COUNT / 2) - 100.0;
    struct v2v_recording *recording = NULL;
    struct v2v_scaling scaling;
    snprintf(path, sizeof path, "%s/masked.h5", test_folder(NULL));
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .type = TEST_H5_U16,
                                              .rank = 4,
                                              .shape = {2, 1, TALL, WIDE},
                                              .values = values});
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    const struct v2v_input_settings told = {.offset = {V2V_NUMBER_GIVEN, 100.0}};
    assert_ok(v2v_scaling_decide(&scaling, recording, &told, NULL));
    assert_true(fabs(scaling.gain * mean / 0.2 - 1.0) < 1e-12);
    assert_ok(v2v_scaling_decide(&scaling, recording, &(struct v2v_input_settings){0}, NULL));
    assert_true(fabs(scaling.pedestal - 100.0) < 2.0);
    v2v_recording_close(&recording);
}

static void a_stated_offset_goes_before_the_guess(void **state)
{
    (void)state;
    struct v2v_recording *recording = recording_of(raised);
    const struct v2v_input_settings settings = {0};
    struct v2v_scaling scaling;
    v2v_recording_close(&recording);
    test_h5_numbers(path, "/views", "offset", (double[]){32764}, 1);
    assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
    assert_ok(v2v_scaling_decide(&scaling, recording, &settings, NULL));
    assert_true(scaling.offset == 32764.0);
    assert_true(fabs(scaling.gain - 0.05) <= 8 * 32768 * 0x1p-53 * 0.05);
    v2v_recording_close(&recording);
}

static void an_image_without_light_has_no_auto_gain(void **state)
{
    (void)state;
    static const double dark[8] = {0};
    struct v2v_scaling scaling;
    struct v2v_recording *recording = recording_of(dark);
    assert_int_equal(v2v_scaling_decide(&scaling, recording, &(struct v2v_input_settings){0}, NULL),
                     V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "mean is 0"));
    v2v_recording_close(&recording);
}

static void samples_above_16_bits_are_no_camera_counts(void **state)
{
    (void)state;
    static const double bright[8] = {40000, 40000, 40000, 40000, 40000, 40000, 40000, 65536};
    struct v2v_recording *recording = recording_as(TEST_H5_F32, bright);
    struct v2v_scaling scaling;
    assert_ok(v2v_scaling_decide(&scaling, recording, &(struct v2v_input_settings){0}, NULL));
    assert_true(scaling.offset == 0.0);
    v2v_recording_close(&recording);
}

/* What a subtracted background leaves: its sign is rounding's. */
static void a_mean_that_rounding_left_has_no_auto_gain(void **state)
{
    (void)state;
    static const double level[8] = {-3, -2, -1, 0, 0, 1, 2, 3 + 8e-6};
    struct v2v_recording *recording = recording_as(TEST_H5_F32, level);
    struct v2v_scaling scaling;
    const struct v2v_input_settings lifted = {.offset = {V2V_NUMBER_GIVEN, -1.0}};
    assert_int_equal(v2v_scaling_decide(&scaling, recording, &(struct v2v_input_settings){0}, NULL),
                     V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "no gain makes it 0.2"));
    assert_ok(v2v_scaling_decide(&scaling, recording, &lifted, NULL));
    assert_true(fabs(scaling.gain - 0.2) < 1e-6);
    v2v_recording_close(&recording);
}

static void a_gain_beyond_float32_is_refused(void **state)
{
    (void)state;
    static const double faint[8] = {1e-40, 1e-40, 1e-40, 1e-40, 1e-40, 1e-40, 1e-40, 1e-40};
    struct v2v_recording *recording = recording_as(TEST_H5_F32, faint);
    struct v2v_scaling scaling;
    assert_int_equal(v2v_scaling_decide(&scaling, recording, &(struct v2v_input_settings){0}, NULL),
                     V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "no gain makes it 0.2"));
    v2v_recording_close(&recording);
}

static void applying_subtracts_then_multiplies(void **state)
{
    (void)state;
    float x[3] = {32767.0f, 32769.0f, 0.0f};
    v2v_scaling_apply(&(struct v2v_scaling){.offset = 32767.0, .gain = 0.5}, x, 3);
    assert_true(x[0] == 0.0f && x[1] == 1.0f && x[2] == -16383.5f);
}

enum { LEVEL_VIEWS = 3, LEVEL_SIDE = 40, LEVEL_PIXELS = LEVEL_SIDE * LEVEL_SIDE };
enum { LEVEL_SAMPLES = LEVEL_VIEWS * LEVEL_PIXELS };

static float frame[LEVEL_SAMPLES], levelled[LEVEL_SAMPLES], image[LEVEL_PIXELS];

static double level_of(double mean, double noise, double scale)
{
    for (int64_t i = 0; i < LEVEL_SAMPLES; i++) {
        const double value = mean + noise * v2v_random_normal(8, 1, (uint64_t)i);
        frame[i] = (float)(scale * value);
    }
    return v2v_scaling_level(frame, image, LEVEL_VIEWS, LEVEL_SIDE, LEVEL_SIDE);
}

static double mean_of_frame(void)
{
    double sum = 0.0;
    for (int64_t i = 0; i < LEVEL_SAMPLES; i++) {
        sum += (double)frame[i];
    }
    return sum / LEVEL_SAMPLES;
}

/* A product in float32 rounds 2^-24; so does each sample that was scaled before. */
static void a_level_takes_any_brightness_out(void **state)
{
    (void)state;
    const double factor = level_of(0.7, 0.1, 1.0);
    assert_true(fabs(mean_of_frame() - 0.2) <= 0x1p-24);
    memcpy(levelled, frame, sizeof frame);
    for (int power = -40; power <= 35; power += 5) {
        const double scale = pow(10.0, power), own = level_of(0.7, 0.1, scale);
        assert_true(fabs(own * scale - factor) <= 0x1p-20 * factor || power < -37);
        for (int64_t i = 0; i < LEVEL_SAMPLES && power >= -35; i++) {
            assert_true(fabs((double)frame[i] - (double)levelled[i]) <=
                        2 * 0x1p-22 * fabs((double)levelled[i]));
        }
    }
}

/* 4800 samples of white noise: a mean of 0.014 deviations, and their median difference, known to
 * 3 % (1.17 / sqrt of 1521, of which there are three views, dependent ones). */
static void noise_alone_is_not_brought_up_to_the_level_of_light(void **state)
{
    (void)state;
    const double factor = level_of(0.0, 3.0, 1.0);
    assert_true(fabs(factor * 3.0 - 2.0) <= 0.2);
    assert_true(fabs(level_of(0.0, 30.0, 1.0) * 30.0 - factor * 3.0) <= 0x1p-20);
}

static void what_has_no_level_is_left_as_it_is(void **state)
{
    (void)state;
    assert_true(level_of(0.0, 0.0, 1.0) == 1.0);
    assert_true(frame[7] == 0.0f);
    assert_true(level_of(1.0, 0.1, NAN) == 1.0);
    assert_true(level_of(1.0, 0.0, 1.0) == 0.2); /* flat */
    frame[11] = INFINITY;
    assert_true(v2v_scaling_level(frame, image, LEVEL_VIEWS, LEVEL_SIDE, LEVEL_SIDE) == 1.0);
    assert_true(frame[12] == 0.2f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_level_takes_any_brightness_out),
        cmocka_unit_test(noise_alone_is_not_brought_up_to_the_level_of_light),
        cmocka_unit_test(what_has_no_level_is_left_as_it_is),
        cmocka_unit_test(offset_and_gain_follow_their_modes),
        cmocka_unit_test(a_pedestal_is_told_where_nothing_is_said_of_one),
        cmocka_unit_test(a_mask_has_no_part_in_gain_and_pedestal),
        cmocka_unit_test(a_stated_offset_goes_before_the_guess),
        cmocka_unit_test(an_image_without_light_has_no_auto_gain),
        cmocka_unit_test(samples_above_16_bits_are_no_camera_counts),
        cmocka_unit_test(a_mean_that_rounding_left_has_no_auto_gain),
        cmocka_unit_test(a_gain_beyond_float32_is_refused),
        cmocka_unit_test(applying_subtracts_then_multiplies),
    };
    return cmocka_run_group_tests_name("scaling", tests, NULL, NULL);
}
