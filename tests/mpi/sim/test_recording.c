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
    struct v2v_noise noise, twin;
    struct v2v_recording *recording = NULL;
    char path[1024];
    const char *folder = test_folder(test_world());
    struct v2v_volume *volume = scene_file(folder);
    assert_ok(v2v_noise_parse(&noise, text));
    twin = noise;
    snprintf(path, sizeof path, "%s/recording.h5", folder);
    assert_ok(v2v_simulate_recording(path, volume, &psf, &noise, 5, FRAMES, NULL, test_world()));
    v2v_volume_close(&volume);
    expect(expected, &twin, 5);

    assert_ok(v2v_recording_open(&recording, path, &settings, test_world()));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    assert_int_equal(info->frames, FRAMES);
    assert_int_equal(info->views, VIEWS);
    assert_true(info->pixel_size_um == 0.5); /* the volume doesn't say, the PSFs do */
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

static void a_volume_of_other_slices_is_refused_everywhere(void **state)
{
    (void)state;
    struct v2v_noise noise = {0};
    char path[1024];
    const char *folder = test_folder(test_world());
    struct v2v_volume *volume = scene_file(folder);
    struct v2v_psf_file fewer = psf;
    fewer.slices--;
    snprintf(path, sizeof path, "%s/recording.h5", folder);
    assert_int_equal(v2v_simulate_recording(path, volume, &fewer, &noise, 5, 1, NULL, test_world()),
                     V2V_E_INPUT);
    assert_int_equal(v2v_simulate_recording(path, volume, &psf, &noise, 5, 0, NULL, test_world()),
                     V2V_E_USAGE);
    v2v_volume_close(&volume);
}

int main(int argc, char **argv)
{
#define WITH(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH(any_number_of_ranks_records_clean_views_alike),
        WITH(any_number_of_ranks_draws_the_same_gaussian_noise),
        WITH(a_volume_of_other_slices_is_refused_everywhere),
    };
    return test_mpi_main(tests, argc, argv);
}
