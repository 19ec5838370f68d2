/* Features of frames of which they are known, and frames made of volumes. */
#include "method/features.h"
#include "small_draw.h"
#include "small_optics.h"

#include "v2v3d/op/gemm.h"
#include "v2v3d/optics/projector.h"

#include <math.h>
#include <string.h>

enum { HEIGHT = 20, WIDTH = 26, PIXELS = HEIGHT * WIDTH };

/* Transforms of a few thousand pixels: some hundred roundings, in squares. */
static const double transforms = 256.0;

static const struct v2v_tv_noise none = {0};

static struct v2v_config config;
static struct v2v_psf_file psf;
static struct v2v_features *features;
static struct v2v_torus torus;
static int64_t whole; /* pixels of the torus */

static void make(void)
{
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_features_create(&features, &problem));
    torus = v2v_features_torus(features);
    whole = torus.height * torus.width;
}

static int setup(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    psf = small_psf();
    make();
    assert_true(torus.height > HEIGHT && torus.width > WIDTH);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_features_destroy(&features);
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

/* [z,torus], above 0 */
static float *draw_volume(void)
{
    float *volume = small_draw(psf.slices * whole, 1, 1.0);
    for (int64_t i = 0; i < psf.slices * whole; i++) {
        volume[i] = fabsf(volume[i]);
    }
    return volume;
}

static void a_volume_that_meets_its_views_leaves_nothing(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], out[V2V_FEATURES * SLICES * PIXELS];
    static float frame[SLICES * PIXELS];
    float *volume = draw_volume();
    v2v_features_simulate(features, views, volume, &none, 1, 0);
    v2v_features_of_volume(features, out, volume, views);
    v2v_features_cut(features, frame, volume);
    assert_memory_equal(out, frame, sizeof frame);
    for (int i = SLICES * PIXELS; i < V2V_FEATURES * SLICES * PIXELS; i++) {
        assert_true(out[i] == 0.0f);
    }
    v2v_mem_free(volume);
}

/* Whatever a volume has beyond the frame: it is told by the residual in the frame alone. */
static void features_are_those_of_the_residual_in_the_frame(void **state)
{
    (void)state;
    enum { VOXELS = SLICES * PIXELS };
    static float met[VIEWS * PIXELS], out[2][V2V_FEATURES * VOXELS];
    float *volume = draw_volume(), *views = small_draw(VIEWS * PIXELS, 2, 1.0);
    v2v_features_of_volume(features, out[0], volume, views);
    v2v_features_simulate(features, met, volume, &none, 1, 0);
    memset(volume, 0, (size_t)(SLICES * whole) * sizeof *volume);
    for (int i = 0; i < VIEWS * PIXELS; i++) {
        views[i] -= met[i];
    }
    v2v_features_of_volume(features, out[1], volume, views);
    for (int k = 1; k < V2V_FEATURES; k++) {
        assert_true(test_relative_l2(out[0] + k * VOXELS, out[1] + k * VOXELS, VOXELS) <=
                    test_rounding(transforms));
    }
    v2v_mem_free(volume);
    v2v_mem_free(views);
}

/* Every view sees one slice as it is, times `light`: A^H (A A^H + light^2 / tau)^-1 r =
 * r / light * tau / (1 + tau). */
static void check_sharp_views(float light)
{
    enum { N = 2 };
    static const double taus[] = {2.0, 64.0};
    static float out[V2V_FEATURES * N * PIXELS], expected[N * PIXELS];
    float data[N * N] = {light, 0.0f, 0.0f, light};
    v2v_features_destroy(&features);
    v2v_psf_file_fini(&psf);
    psf = (struct v2v_psf_file){.views = N, .slices = N, .height = 3, .width = 3};
    assert_ok(V2V_ALLOC(psf.data, "test", N * N * 9));
    for (int i = 0; i < N * N; i++) {
        psf.data[i * 9 + 4] = data[i];
    }
    make();
    float *volume = draw_volume(), *views = small_draw(N * PIXELS, 2, 1.0);
    v2v_features_of_volume(features, out, volume, views);
    for (int k = 0; k < V2V_FEATURES - 1; k++) {
        for (int i = 0; i < N * PIXELS; i++) {
            const double rest = (double)views[i] - (double)light * (double)out[i];
            expected[i] = (float)(rest / (double)light * taus[k] / (1.0 + taus[k]));
        }
        assert_true(test_relative_l2(out + (k + 1) * N * PIXELS, expected, N * PIXELS) <=
                    test_rounding(transforms));
    }
    v2v_mem_free(volume);
    v2v_mem_free(views);
}

static void sharp_views_give_their_residual(void **state)
{
    (void)state;
    check_sharp_views(1.0f);
    check_sharp_views(3.0f);
}

/* The sum of the moduli of all differences of neighbours on the torus. */
static double variation(const float *volume)
{
    double sum = 0.0;
    for (int64_t i = 0; i < psf.slices * whole; i++) {
        const int64_t x = i % torus.width, y = i / torus.width % torus.height;
        const float *plane = volume + i / whole * whole;
        const float *right = plane + y * torus.width + (x + 1) % torus.width;
        const float *below = plane + (y + 1) % torus.height * torus.width + x;
        sum += fabs((double)*right - (double)volume[i]) + fabs((double)*below - (double)volume[i]);
    }
    return sum;
}

static void flips_mirror_the_frame_and_keep_neighbours(void **state)
{
    (void)state;
    static float frame[SLICES * PIXELS], flipped[SLICES * PIXELS];
    float *volume = draw_volume(), *once = draw_volume(), *twice = draw_volume();
    v2v_features_cut(features, frame, volume);
    for (unsigned flips = 0; flips < 8; flips++) {
        v2v_features_flip(features, once, volume, flips);
        v2v_features_flip(features, twice, once, flips);
        assert_memory_equal(twice, volume, (size_t)(SLICES * whole) * sizeof *volume);
        assert_true(fabs(variation(once) - variation(volume)) <= 1e-12 * variation(volume));
        v2v_features_cut(features, flipped, once);
        for (int i = 0; i < SLICES * PIXELS; i++) {
            const int x = i % WIDTH, y = i / WIDTH % HEIGHT, z = i / PIXELS;
            const int from_x = flips & V2V_FLIP_X ? WIDTH - 1 - x : x;
            const int from_y = flips & V2V_FLIP_Y ? HEIGHT - 1 - y : y;
            const int from_z = flips & V2V_FLIP_Z ? SLICES - 1 - z : z;
            assert_true(flipped[i] == frame[(from_z * HEIGHT + from_y) * WIDTH + from_x]);
        }
    }
    v2v_mem_free(volume);
    v2v_mem_free(once);
    v2v_mem_free(twice);
}

/* Of a volume that is empty beyond the frame; what the torus brings round is below what its border
 * may lose. */
static void views_of_a_volume_are_its_projection(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], expected[VIEWS * PIXELS], frame[SLICES * PIXELS];
    struct v2v_projector *projector = NULL;
    float *volume = draw_volume();
    for (int64_t i = 0; i < SLICES * whole; i++) {
        const int64_t x = i % torus.width, y = i / torus.width % torus.height;
        volume[i] = x < WIDTH && y < HEIGHT ? volume[i] : 0.0f;
    }
    v2v_features_cut(features, frame, volume);
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, expected, frame, NULL, VIEWS, 1.0f);
    v2v_features_simulate(features, views, volume, &none, 1, 0);
    assert_true(test_relative_l2(views, expected, VIEWS * PIXELS) <= V2V_DATA_STEP_LOST);
    v2v_projector_destroy(&projector);
    v2v_mem_free(volume);
}

/* Mean squares of n normal numbers lie within 5 sqrt(2 / n) of 1. */
static void noise_is_as_large_as_asked_for(void **state)
{
    (void)state;
    enum { SAMPLES = VIEWS * PIXELS };
    static float clean[SAMPLES], noisy[SAMPLES], again[SAMPLES], other[SAMPLES];
    const struct v2v_tv_noise noise = {.deviation = 0.3};
    double squares = 0.0;
    float *volume = draw_volume();
    v2v_features_simulate(features, clean, volume, &none, 7, 1);
    v2v_features_simulate(features, noisy, volume, &noise, 7, 1);
    v2v_features_simulate(features, again, volume, &noise, 7, 1);
    v2v_features_simulate(features, other, volume, &noise, 7, 2);
    for (int i = 0; i < SAMPLES; i++) {
        const double d = ((double)noisy[i] - (double)clean[i]) / noise.deviation;
        squares += d * d / SAMPLES;
    }
    assert_true(fabs(squares - 1.0) <= 5.0 * sqrt(2.0 / SAMPLES));
    assert_memory_equal(noisy, again, sizeof noisy);
    assert_memory_not_equal(noisy, other, sizeof noisy);
    v2v_mem_free(volume);
}

/* Variances gain * level + deviation^2: squares over these, of 1 in the mean. That of a square is 2
 * for normal numbers, and more by one over the photons where they make the noise: by less than 0.5
 * here. */
static void photons_make_noise_where_there_is_light(void **state)
{
    (void)state;
    enum { SAMPLES = VIEWS * PIXELS };
    static float clean[SAMPLES], noisy[SAMPLES];
    const struct v2v_tv_noise noise = {.gain = 0.01, .deviation = 0.02};
    double squares[2] = {0}, counted[2] = {0}, sum = 0.0, brightest = 0.0;
    float *volume = draw_volume();
    for (int64_t i = 0; i < psf.slices * whole; i++) {
        volume[i] *= i % torus.width < WIDTH / 2 ? 1.0f : 0.01f;
    }
    v2v_features_simulate(features, clean, volume, &none, 7, 1);
    v2v_features_simulate(features, noisy, volume, &noise, 7, 1);
    for (int i = 0; i < SAMPLES; i++) {
        brightest = fmax(brightest, (double)clean[i]);
    }
    assert_true(brightest > 0.1);
    for (int i = 0; i < SAMPLES; i++) {
        const double variance = noise.gain * fmax((double)clean[i], 0.0) + 4e-4;
        const double d = (double)noisy[i] - fmax((double)clean[i], 0.0);
        const int is_bright = (double)clean[i] > 0.5 * brightest;
        squares[is_bright] += d * d / variance;
        counted[is_bright] += 1.0;
        sum += d / sqrt(variance);
    }
    for (int k = 0; k < 2; k++) {
        assert_true(counted[k] > 100.0);
        assert_true(fabs(squares[k] / counted[k] - 1.0) <= 5.0 * sqrt(2.5 / counted[k]));
    }
    assert_true(fabs(sum) <= 5.0 * sqrt(SAMPLES));
    v2v_mem_free(volume);
}

/* What total variation takes the noise for is what lessons are made with. */
static void noise_of_photons_is_found_and_made_again(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], out[V2V_FEATURES * SLICES * PIXELS];
    const struct v2v_tv_noise put_in = {.gain = 0.01, .deviation = 0.002};
    struct v2v_tv_noise noise = {0};
    float *volume = draw_volume();
    v2v_features_destroy(&features);
    config.deconv.noise = V2V_NOISE_MODEL_POISSON;
    make();
    v2v_features_simulate(features, views, volume, &put_in, 3, 0);
    assert_ok(v2v_features_of_views(features, out, NULL, &noise, views));
    assert_true(noise.gain > 0.5 * put_in.gain && noise.gain < 2.0 * put_in.gain);
    config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN;
    v2v_features_destroy(&features);
    make();
    assert_ok(v2v_features_of_views(features, out, NULL, &noise, views));
    assert_true(noise.gain == 0.0 && noise.deviation > 0.0);
    v2v_mem_free(volume);
}

static void run_tv(float *volume, const float *views)
{
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_estimator_find(&ops, "tv"));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    assert_ok(ops->run(estimator, &volume, views, NULL));
    v2v_estimator_destroy(&estimator);
}

/* The second frame after a first one, and on two threads; with the volume, and without. */
static void features_of_views_begin_with_tv(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], frame[SLICES * PIXELS];
    static float out[2][V2V_FEATURES * SLICES * PIXELS];
    const struct v2v_tv_noise put_in = {.deviation = 0.05};
    struct v2v_tv_noise noise = {0};
    float *volume = draw_volume(), *found = draw_volume();
    v2v_features_simulate(features, views, volume, &put_in, 3, 0);
    v2v_features_destroy(&features);
    for (int t = 0; t < 2; t++) {
        v2v_op_set_threads(t + 1);
        make();
        for (int run = 0; run < 2; run++) {
            float *const volume_of_run = run == t ? found : NULL;
            assert_ok(v2v_features_of_views(features, out[t], volume_of_run, &noise, views));
        }
        if (t == 0) {
            v2v_features_destroy(&features);
        }
    }
    v2v_op_set_threads(1);
    assert_memory_equal(out[0], out[1], sizeof out[0]);
    assert_true(noise.gain == 0.0 && noise.deviation > 0.5 * put_in.deviation &&
                noise.deviation < 2.0 * put_in.deviation);
    run_tv(frame, views);
    assert_memory_equal(out[0], frame, sizeof frame);
    v2v_features_cut(features, frame, found);
    assert_memory_equal(out[0], frame, sizeof frame);
    v2v_mem_free(volume);
    v2v_mem_free(found);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_volume_that_meets_its_views_leaves_nothing, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(features_are_those_of_the_residual_in_the_frame, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(sharp_views_give_their_residual, setup, teardown),
        cmocka_unit_test_setup_teardown(flips_mirror_the_frame_and_keep_neighbours, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(views_of_a_volume_are_its_projection, setup, teardown),
        cmocka_unit_test_setup_teardown(noise_is_as_large_as_asked_for, setup, teardown),
        cmocka_unit_test_setup_teardown(photons_make_noise_where_there_is_light, setup, teardown),
        cmocka_unit_test_setup_teardown(noise_of_photons_is_found_and_made_again, setup, teardown),
        cmocka_unit_test_setup_teardown(features_of_views_begin_with_tv, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
