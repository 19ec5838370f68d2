/* Figures of views left out: what they say of views that are known, on any number of ranks. */
#include "small_optics.h"
#include "small_recording.h"

#include "v2v3d/base/random.h"
#include "v2v3d/eval/consistency.h"
#include "v2v3d/optics/projector.h"

#include <stdio.h>

enum { HEIGHT = 72, WIDTH = 60, FRAMES = 5, PIXELS = HEIGHT * WIDTH };
enum { SAMPLES = VIEWS * PIXELS, VOXELS = SLICES * PIXELS };
static const double sigma = 0.02;
static const struct v2v_recording_info shape = {
    .frames = FRAMES, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
static const struct v2v_scaling scaling = {.offset = 100.0, .gain = 1.0};

static struct v2v_config config;
static struct v2v_psf_file psf;
static float frames[FRAMES][SAMPLES];

/* Spots of several brightnesses, others in every frame. */
static void fill_views(float *views, int t)
{
    static float volume[VOXELS];
    struct v2v_projector *projector = NULL;
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = 0.0f;
    }
    for (int s = 0; s < 60; s++) {
        const uint64_t n = (uint64_t)(4 * (t * 60 + s));
        const int64_t z = v2v_random_below(21, 0, n, SLICES);
        const int64_t y = 8 + v2v_random_below(21, 0, n + 1, HEIGHT - 16);
        const int64_t x = 8 + v2v_random_below(21, 0, n + 2, WIDTH - 16);
        volume[(z * HEIGHT + y) * WIDTH + x] =
            (float)(20.0 + 60.0 * v2v_random_uniform(21, 0, n + 3));
    }
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    for (int i = 0; i < SAMPLES; i++) {
        views[i] += (float)(100.0 + sigma * v2v_random_normal(22, (uint64_t)t, (uint64_t)i));
    }
}

static int setup(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    psf = small_psf();
    for (int t = 0; t < FRAMES; t++) {
        fill_views(frames[t], t);
    }
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

/** The example of the header. */
static enum v2v_status example(struct v2v_consistency *kept, const struct v2v_consistency_job *job,
                               struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_consistency consistency = {0};
    V2V_TRY(v2v_consistency_of(&consistency, job, world));
    if (v2v_comm_rank(world) == 0) {
        printf("%.3f of the views left out is missed\n", consistency.heldout[0]);
    }
    *kept = consistency;
    consistency = (struct v2v_consistency){0};
done:
    v2v_consistency_fini(&consistency);
    return rc;
}

static struct v2v_consistency judge(struct v2v_recording *recording, int64_t count,
                                    struct v2v_volume_writer *writer, struct v2v_comm *world)
{
    struct v2v_consistency found = {0};
    const struct v2v_consistency_job job = {.config = &config,
                                            .psf = &psf,
                                            .recording = recording,
                                            .scaling = &scaling,
                                            .frames = count,
                                            .writer = writer};
    assert_ok(example(&found, &job, world));
    return found;
}

static double distance(const struct v2v_consistency *found, int64_t i, int64_t v)
{
    const double *shift = found->shift + 2 * (i * VIEWS + v);
    return sqrt(shift[0] * shift[0] + shift[1] * shift[1]);
}

static void frames_are_spread_over_the_recording(void **state)
{
    (void)state;
    assert_int_equal(v2v_consistency_frame(0, 1, 1), 0);
    assert_int_equal(v2v_consistency_frame(0, 1, 100), 50);
    for (int64_t i = 0; i < 7; i++) {
        assert_int_equal(v2v_consistency_frame(i, 7, 7), i);
    }
    assert_int_equal(v2v_consistency_frame(3, 4, 100), 87);
}

/* Ranks take frames, share one frame, or are left over: all of them know the same figures, those
 * that each finds for itself. The volumes' ways of cutting round their sums to 1e-5 at most
 * (mpi.method.deconvolution); what is missed is 0.05 or more of the views. */
static void any_number_of_ranks_finds_the_same(void **state)
{
    (void)state;
    const char *folder = test_folder(test_world());
    struct v2v_recording *recording = small_recording(folder, &frames[0][0], &shape);
    for (int64_t count = 1; count <= 3; count += 2) {
        struct v2v_consistency alone = judge(recording, count, NULL, NULL);
        struct v2v_consistency found = judge(recording, count, NULL, test_world());
        assert_int_equal(found.frames, count);
        for (int64_t i = 0; i < count; i++) {
            assert_int_equal(found.frame[i], v2v_consistency_frame(i, count, FRAMES));
        }
        const int64_t figures = count * (4 + 4 * VIEWS + SLICES);
        for (int64_t k = 0; k < figures; k++) {
            const double a = alone.memory[k], b = found.memory[k];
            if (!(fabs(a - b) <= 1e-3 * (1.0 + fabs(a)))) {
                fail_msg("%d frames, figure %d: %g and %g", (int)count, (int)k, a, b);
            }
        }
        v2v_consistency_fini(&alone);
        v2v_consistency_fini(&found);
    }
    v2v_recording_close(&recording);
}

/* Of a sample, less the offset, in the root mean square. */
static double light_of(const float *views)
{
    double squares = 0.0;
    for (int i = 0; i < SAMPLES; i++) {
        squares += ((double)views[i] - 100.0) * ((double)views[i] - 100.0);
    }
    return sqrt(squares / SAMPLES);
}

/* A view is missed by its noise at least, and by all of its light at most. */
static void views_in_register_are_predicted(void **state)
{
    (void)state;
    struct v2v_recording *recording =
        small_recording(test_folder(test_world()), &frames[0][0], &shape);
    struct v2v_consistency found = judge(recording, FRAMES, NULL, test_world());
    for (int64_t i = 0; i < FRAMES; i++) {
        const double missed = found.heldout[i] * light_of(frames[i]);
        assert_true(missed > 0.97 * sigma && found.heldout[i] < 0.5); /* known to 1 % */
        /* spots as sharp as pixels count as noise, too */
        assert_true(found.heldout_sigmas[i] > 0.8 && found.heldout_sigmas[i] < missed / sigma);
        assert_true(found.disagreement[i] > 0.0 && found.disagreement[i] < 1.0);
        assert_true(found.resolution[i] >= 2.0 && found.resolution[i] < 10.0);
        for (int64_t v = 0; v < VIEWS; v++) {
            if (!(distance(&found, i, v) < 0.5)) {
                fail_msg("frame %d, view %d: %g pixels off", (int)i, (int)v,
                         distance(&found, i, v));
            }
        }
    }
    v2v_consistency_fini(&found);
    v2v_recording_close(&recording);
}

static void a_view_that_was_moved_is_found(void **state)
{
    (void)state;
    enum { FRAME = FRAMES / 2, VIEW = 2, BY = 2 };
    static float moved[PIXELS];
    float *view = frames[FRAME] + VIEW * PIXELS;
    for (int i = 0; i < PIXELS; i++) {
        moved[(i + BY * WIDTH) % PIXELS] = view[i];
    }
    for (int i = 0; i < PIXELS; i++) {
        view[i] = moved[i];
    }
    struct v2v_recording *recording =
        small_recording(test_folder(test_world()), &frames[0][0], &shape);
    struct v2v_consistency found = judge(recording, 1, NULL, test_world());
    const double *shift = found.shift + (ptrdiff_t)(2 * VIEW);
    if (!(fabs(shift[0] - BY) < 0.5 && fabs(shift[1]) < 0.5)) {
        fail_msg("%g, %g pixels off", shift[0], shift[1]);
    }
    for (int64_t v = 0; v < VIEWS; v++) {
        assert_true(distance(&found, 0, v) <= distance(&found, 0, VIEW));
    }
    v2v_consistency_fini(&found);
    v2v_recording_close(&recording);
}

/* The file has the frames judged, and no others. */
static void uncertainties_are_written(void **state)
{
    (void)state;
    char path[1024];
    float slice[PIXELS];
    const char *folder = test_folder(test_world());
    struct v2v_recording *recording = small_recording(folder, &frames[0][0], &shape);
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = HEIGHT, .width = WIDTH};
    snprintf(path, sizeof path, "%s/uncertainty.h5", folder);
    assert_ok(v2v_volume_create(&writer, path, &info,
                                1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_UNCERTAINTY, NULL, 0,
                                test_world()));
    struct v2v_consistency found = judge(recording, 2, writer, test_world());
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&volume, path, &(struct v2v_input_settings){.slices = SLICES},
                              test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        const int judged = t == found.frame[0] || t == found.frame[1];
        const enum v2v_status rc = v2v_volume_read(volume, slice, t, 1, 1);
        assert_int_equal(rc, judged ? V2V_OK : V2V_E_INPUT);
    }
    v2v_volume_close(&volume);
    if (v2v_comm_rank(test_world()) == 0) {
        double of_mean = 0.0, of_difference = 0.0;
        int64_t count = 0;
        double *map = test_h5_read(path, "/uncertainty", &count);
        double *mean = test_h5_read(path, "/volume", NULL);
        const int64_t first = found.frame[0] * VOXELS;
        assert_int_equal(count, (int64_t)FRAMES * VOXELS);
        for (int64_t i = first; i < first + VOXELS; i++) {
            assert_true(map[i] >= 0.0);
            of_difference += map[i] * map[i];
            of_mean += mean[i] * mean[i];
        }
        /* variance and squared bias: at least the first, which is the halves' disagreement, but
         * for c instead of (a + b) / 2 below, and for windows; those keep sums of squares but for
         * light at a slice's edge, and these volumes are nearly dark there */
        const double ratio = sqrt(of_difference / of_mean);
        assert_true(ratio > 0.8 * found.disagreement[0] && ratio < 1.0);
        test_release(map);
        test_release(mean);
    }
    v2v_par_barrier(test_world());
    v2v_consistency_fini(&found);
    v2v_recording_close(&recording);
}

static void one_view_has_no_figures(void **state)
{
    (void)state;
    struct v2v_recording *recording =
        small_recording(test_folder(test_world()), &frames[0][0], &shape);
    struct v2v_psf_file one = psf;
    struct v2v_consistency found;
    one.views = 1;
    const struct v2v_consistency_job job = {
        .config = &config, .psf = &one, .recording = recording, .scaling = &scaling, .frames = 1};
    assert_ok(v2v_consistency_of(&found, &job, test_world()));
    assert_int_equal(found.frames, 0);
    v2v_consistency_fini(&found);
    v2v_recording_close(&recording);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frames_are_spread_over_the_recording),
        cmocka_unit_test_setup_teardown(any_number_of_ranks_finds_the_same, setup, teardown),
        cmocka_unit_test_setup_teardown(views_in_register_are_predicted, setup, teardown),
        cmocka_unit_test_setup_teardown(a_view_that_was_moved_is_found, setup, teardown),
        cmocka_unit_test_setup_teardown(uncertainties_are_written, setup, teardown),
        cmocka_unit_test_setup_teardown(one_view_has_no_figures, setup, teardown),
    };
    return test_mpi_main(tests, argc, argv);
}
