#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/sim/recording.h"

#include <stdio.h>
#include <string.h>

/* More views than ranks and fewer, slices that 2, 3, 4 ranks don't share evenly, more frames than
 * the volume has. */
enum { VIEWS = 3, SLICES = 5, KERNEL = 8, HEIGHT = 20, WIDTH = 18, SOURCES = 2, FRAMES = 5 };
enum { PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };

static struct v2v_psf_file psf;
static float scene[SOURCES][VOXELS];

static int setup(void **state)
{
    (void)state;
    psf = (struct v2v_psf_file){VIEWS, SLICES, KERNEL, KERNEL, 0.5, 0, NULL};
    int64_t taps = VIEWS * SLICES * KERNEL * KERNEL;
    assert_ok(V2V_ALLOC(psf.data, "test", taps));
    for (int64_t i = 0; i < taps; i++) {
        psf.data[i] = (float)v2v_random_uniform(1, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    for (int64_t i = 0; i < SOURCES * VOXELS; i++) {
        scene[i / VOXELS][i % VOXELS] = (float)v2v_random_uniform(1, 1, (uint64_t)i);
    }
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

/** The scene as a file of its own in `folder`, open to read. */
static struct v2v_volume *scene_file(const char *folder)
{
    char path[1024];
    struct v2v_volume *volume = NULL;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = {
        .frames = SOURCES, .slices = SLICES, .height = HEIGHT, .width = WIDTH};
    snprintf(path, sizeof path, "%s/scene.h5", folder);
    int64_t count = v2v_comm_rank(test_world()) == 0 ? SLICES : 0;
    assert_ok(
        v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, test_world()));
    for (int64_t t = 0; t < SOURCES; t++) {
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, scene[t], t, 0, count));
        assert_ok(v2v_volume_mark_done(writer, t, test_world()));
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&volume, path, NULL, test_world()));
    return volume;
}

/** Record what `simulation` says, in frames of this size. */
static enum v2v_status record(struct v2v_simulation *simulation, const struct v2v_psf_file *psfs)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_simulator *simulator = NULL;
    V2V_TRY(v2v_simulator_create(&simulator, psfs, HEIGHT, WIDTH, NULL, test_world()));
    V2V_TRY(v2v_simulator_record(simulator, simulation));
done:
    v2v_simulator_destroy(&simulator);
    return rc;
}

/** What one rank alone would record. */
static void expect(float expected[FRAMES][SAMPLES], struct v2v_noise *noise, uint64_t seed)
{
    static float clean[SAMPLES];
    struct v2v_projector *projector = NULL;
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        v2v_projector_forward(projector, clean, scene[t % SOURCES], NULL, VIEWS, 1.0f);
        if (t == 0) {
            assert_ok(v2v_noise_level(noise, clean, SAMPLES));
        }
        v2v_noise_apply(expected[t], clean, SAMPLES, noise, seed, t, 0);
    }
    v2v_projector_destroy(&projector);
}

static void simulate_and_compare(const char *text)
{
    static float expected[FRAMES][SAMPLES], recorded[SAMPLES];
    const struct v2v_input_settings settings = {.views = VIEWS};
    struct v2v_noise twin;
    struct v2v_recording *recording = NULL;
    char path[1024];
    const char *folder = test_folder(test_world());
    struct v2v_simulation simulation = {.volume = scene_file(folder),
                                        .seed = 5,
                                        .frames = FRAMES,
                                        .pixel_size_um = 0.5,
                                        .output = path};
    assert_ok(v2v_noise_parse(&simulation.noise, text));
    twin = simulation.noise;
    snprintf(path, sizeof path, "%s/recording.h5", folder);
    assert_ok(record(&simulation, &psf));
    v2v_volume_close(&simulation.volume);
    expect(expected, &twin, 5);

    assert_ok(v2v_recording_open(&recording, path, &settings, test_world()));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    assert_int_equal(info->frames, FRAMES);
    assert_int_equal(info->views, VIEWS);
    assert_true(info->pixel_size_um == 0.5);
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_recording_read(recording, recorded, t));
        /* The ranks' sums over slices come in another order: two float32 transforms of at most ten
         * levels x eps 6e-8, of which the norm sees the random sum, sqrt(20) x 6e-8 = 3e-7. The
         * noise of another sample would differ by some 0.1. */
        assert_true(test_relative_l2(recorded, expected[t], SAMPLES) < 1e-6);
    }
    v2v_recording_close(&recording);
}

static void any_number_of_ranks_records_clean_views_alike(void **state)
{
    (void)state;
    simulate_and_compare("none");
}

static void any_number_of_ranks_draws_the_same_gaussian_noise(void **state)
{
    (void)state;
    simulate_and_compare("gaussian:0.2");
}

static void any_number_of_ranks_counts_the_same_photons(void **state)
{
    (void)state;
    simulate_and_compare("poisson:1000");
}

/** Frame t of the truth and of the clean views that were written. */
static void expect_scene(const struct v2v_scene *drawn, const struct v2v_simulation *simulation,
                         struct v2v_volume *truth, struct v2v_recording *clean, int64_t t)
{
    static float expected[VOXELS], volume[VOXELS], views[SAMPLES], read[SAMPLES];
    struct v2v_projector *projector = NULL;
    v2v_scene_draw(expected, drawn, t, 0, SLICES);
    assert_ok(v2v_volume_read(truth, volume, t, 0, SLICES));
    assert_memory_equal(volume, expected, sizeof volume);
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, expected, NULL, VIEWS, 1.0f);
    v2v_noise_expected(views, views, SAMPLES, &simulation->noise);
    assert_ok(v2v_recording_read(clean, read, t));
    assert_true(test_relative_l2(read, views, SAMPLES) < 1e-6); /* as above */
    v2v_projector_destroy(&projector);
}

static void a_moving_scene_gives_its_truth_and_clean_views(void **state)
{
    (void)state;
    char noisy[1024], clean[1024], truth[1024];
    const char *folder = test_folder(test_world());
    const struct v2v_input_settings settings = {.views = VIEWS};
    struct v2v_volume *volume = NULL;
    struct v2v_recording *recording = NULL;
    struct v2v_scene drawn = {.slices = SLICES,
                              .height = HEIGHT,
                              .width = WIDTH,
                              .slice_um = 1,
                              .pixel_um = 1,
                              .motion_um = 1,
                              .seed = 3};
    struct v2v_simulation simulation = {
        .scene = &drawn, .seed = 3, .frames = 3, .output = noisy, .clean = clean, .truth = truth};
    assert_ok(v2v_scene_find(&drawn.kind, "cells"));
    assert_ok(v2v_noise_parse(&simulation.noise, "camera:200"));
    snprintf(noisy, sizeof noisy, "%s/noisy.h5", folder);
    snprintf(clean, sizeof clean, "%s/clean.h5", folder);
    snprintf(truth, sizeof truth, "%s/truth.h5", folder);
    assert_ok(record(&simulation, &psf));
    assert_ok(v2v_recording_open(&recording, noisy, &settings, test_world()));
    assert_true(v2v_recording_info(recording)->offset == 100);
    v2v_recording_close(&recording);
    assert_ok(v2v_volume_open(&volume, truth, NULL, test_world()));
    assert_ok(v2v_recording_open(&recording, clean, &settings, test_world()));
    assert_int_equal(v2v_volume_info(volume)->frames, 3);
    for (int64_t t = 0; t < 3; t++) {
        expect_scene(&drawn, &simulation, volume, recording, t);
    }
    v2v_volume_close(&volume);
    v2v_recording_close(&recording);
}

static void what_does_not_fit_is_refused_everywhere(void **state)
{
    (void)state;
    char path[1024];
    const char *folder = test_folder(test_world());
    struct v2v_simulation simulation = {
        .volume = scene_file(folder), .seed = 5, .frames = 1, .output = path};
    struct v2v_psf_file fewer = psf;
    fewer.slices--;
    snprintf(path, sizeof path, "%s/recording.h5", folder);
    assert_int_equal(record(&simulation, &fewer), V2V_E_INPUT);
    simulation.frames = 0;
    assert_int_equal(record(&simulation, &psf), V2V_E_USAGE);
    v2v_volume_close(&simulation.volume);
}

int main(int argc, char **argv)
{
#define WITH(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH(any_number_of_ranks_records_clean_views_alike),
        WITH(any_number_of_ranks_draws_the_same_gaussian_noise),
        WITH(any_number_of_ranks_counts_the_same_photons),
        WITH(a_moving_scene_gives_its_truth_and_clean_views),
        WITH(what_does_not_fit_is_refused_everywhere),
    };
    return test_mpi_main(tests, argc, argv);
}
