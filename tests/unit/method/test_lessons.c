/* Frames of which the volume is known, made of a recording. */
#include "method/lessons.h"
#include "small_draw.h"
#include "small_optics.h"

#include "v2v3d/io/recording.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/projector.h"

#include <stdio.h>
#include <string.h>

enum { SIDE = 32, PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, FEATURES = 3, FRAMES = 4 };
enum { FLOATS = (FEATURES + 1) * VOXELS };

static struct v2v_config config;
static struct v2v_psf_file psf;
static struct v2v_recording *recording;

/* A corner of a view, which sees nothing: some value below zero. */
enum { MASKED_VIEW = 1, MASKED_SIDE = 14 };

static void mask(float *views, float value)
{
    for (int i = 0; i < MASKED_SIDE * MASKED_SIDE; i++) {
        views[MASKED_VIEW * PIXELS + i / MASKED_SIDE * SIDE + i % MASKED_SIDE] = value;
    }
}

/* Boxes and their views, the second frame without anything; the others as the first, masked. */
static void record(void)
{
    static float volume[VOXELS], views[FRAMES][VIEWS * PIXELS];
    char path[512];
    struct v2v_projector *projector = NULL;
    struct v2v_recording_writer *writer = NULL;
    const struct v2v_recording_info info = {
        .frames = FRAMES, .views = VIEWS, .height = SIDE, .width = SIDE};
    const struct v2v_input_settings input = {.views = VIEWS};
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = (i / 5 + i / SIDE / 7 + i / PIXELS) % 4 == 0 ? 1.0f : 0.0f;
    }
    assert_ok(v2v_projector_create(&projector, &psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views[0], volume, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    for (int i = 0; i < VIEWS * PIXELS; i++) {
        views[0][i] += (float)(0.1 * v2v_random_normal(41, 0, (uint64_t)i));
        views[2][i] = views[3][i] = views[0][i];
    }
    mask(views[2], -0.25f);
    mask(views[3], -4.0f);
    snprintf(path, sizeof path, "%s/recording.h5", test_folder(NULL));
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    for (int t = 0; t < FRAMES; t++) {
        assert_ok(v2v_recording_write(writer, views[t], t, 0, VIEWS));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&recording, path, &input, NULL));
}

static int setup(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    psf = small_psf();
    record();
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_recording_close(&recording);
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

static void make(float *images, double gain, int64_t t, int64_t number)
{
    struct v2v_lessons *lessons = NULL;
    const struct v2v_scaling scaling = {.gain = gain};
    assert_int_equal(v2v_lessons_images(SLICES), FEATURES * SLICES + SLICES);
    assert_ok(v2v_lessons_create(&lessons, &config, &psf));
    assert_ok(v2v_lessons_make(lessons, images, recording, &scaling, t, number));
    v2v_lessons_destroy(&lessons);
}

static double squares(const float *a, const float *b)
{
    double sum = 0.0;
    for (int i = 0; i < VOXELS; i++) {
        const double d = (double)a[i] - (b != NULL ? (double)b[i] : 0.0);
        sum += d * d;
    }
    return sum;
}

/* Total variation's volume of the frame as recorded. */
static void estimate(float *volume)
{
    float *views = small_draw(VIEWS * PIXELS, 1, 1.0);
    struct v2v_estimator *estimator = NULL;
    const struct v2v_estimator_ops *ops = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    assert_ok(v2v_recording_read(recording, views, 0));
    assert_ok(v2v_estimator_find(&ops, "tv"));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    assert_ok(ops->run(estimator, &volume, views, NULL));
    v2v_estimator_destroy(&estimator);
    v2v_mem_free(views);
}

/* The error of total variation is 1 in the mean square, and the volume behind a lesson that one's,
 * mirrored along two axes or none. */
static void the_known_volume_is_the_frames_own_mirrored(void **state)
{
    (void)state;
    static const int flip[][3] = {{0, 0, 0}, {0, 1, 1}, {1, 0, 1}, {1, 1, 0}}; /* z, y, x */
    static float images[FLOATS], own[VOXELS], expected[VOXELS];
    estimate(own);
    for (int64_t number = 0; number < 4; number++) {
        const int *f = flip[number];
        make(images, 1.0, 0, number);
        const float *known = images + FEATURES * VOXELS;
        const double factor = sqrt(squares(known, NULL) / squares(own, NULL));
        for (int i = 0; i < VOXELS; i++) {
            const int z = i / PIXELS, y = i / SIDE % SIDE, x = i % SIDE;
            const int from =
                ((f[0] ? SLICES - 1 - z : z) * SIDE + (f[1] ? SIDE - 1 - y : y)) * SIDE +
                (f[2] ? SIDE - 1 - x : x);
            expected[i] = (float)(own[from] * factor);
        }
        assert_true(squares(known, expected) <= 1e-10 * squares(known, NULL));
        const double missed = squares(images, known) / VOXELS;
        assert_true(fabs(missed - 1.0) <= 1e-5);
    }
}

static void a_number_always_gives_the_same_lesson(void **state)
{
    (void)state;
    static float one[FLOATS], again[FLOATS];
    make(one, 1.0, 0, 4);
    make(again, 1.0, 0, 4);
    assert_memory_equal(one, again, sizeof one);
    make(again, 1.0, 0, 8); /* mirrored likewise, of other noise */
    assert_memory_not_equal(one, again, VOXELS * sizeof *one);
}

/* Scales that are no power of two round otherwise; total variation ends by a tolerance. */
static void brightness_does_not_count(void **state)
{
    (void)state;
    static float one[FLOATS], other[FLOATS];
    make(one, 1.0, 0, 1);
    make(other, 1024.0, 0, 1);
    assert_memory_equal(one, other, sizeof one);
    make(other, 0.1, 0, 1);
    assert_true(squares(one, other) <= 1e-8 * squares(one, NULL));
}

/* .. nor does what stands in place of samples that see nothing. */
static void blind_samples_do_not_count(void **state)
{
    (void)state;
    static float seen[FLOATS], one[FLOATS], other[FLOATS];
    make(seen, 1.0, 0, 1);
    make(one, 1.0, 2, 1);
    make(other, 1.0, 3, 1);
    assert_memory_equal(one, other, sizeof one);
    const double apart = squares(one, seen) / squares(seen, NULL);
    print_message("beside the frame without a mask: %.3g\n", apart);
    assert_true(apart > 0.0 && apart < 0.5);
}

static void of_a_dark_frame_nothing_is_learnt(void **state)
{
    (void)state;
    static float images[FLOATS];
    make(images, 1.0, 1, 2);
    for (int i = 0; i < FLOATS; i++) {
        assert_true(images[i] == 0.0f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_known_volume_is_the_frames_own_mirrored),
        cmocka_unit_test(a_number_always_gives_the_same_lesson),
        cmocka_unit_test(brightness_does_not_count),
        cmocka_unit_test(blind_samples_do_not_count),
        cmocka_unit_test(of_a_dark_frame_nothing_is_learnt),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
