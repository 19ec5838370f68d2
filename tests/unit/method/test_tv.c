/* Total variation where its minimum is known, and where nothing is easy. */
#include "method/tv.h"
#include "small_tv.h"

#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/statistics.h"

#include <stdio.h>
#include <string.h>

enum { MOST = 64 * 64 };

/* Noise that v2v3d sees in views without any, of their brightness. */
#define LEAST_NOISE 1e-4

/* n views, each of which sees one of n slices as it is. */
static struct v2v_psf_file sharp_psf(float *data, int64_t n)
{
    for (int64_t i = 0; i < n * n; i++) {
        data[i] = i % (n + 1) == 0 ? 1.0f : 0.0f;
    }
    return (struct v2v_psf_file){.views = n, .slices = n, .height = 1, .width = 1, .data = data};
}

/* Two levels, h rows of each, on a torus: two edges, which pull each level towards the other by
 * 2 lambda / h. Rows beyond the frame follow the volume: nothing changes. */
static void check_levels(int64_t half, int64_t width)
{
    enum { LARGEST = 1000 };
    static float views[MOST], volume[MOST];
    float data[1];
    const struct v2v_psf_file psf = sharp_psf(data, 1);
    const float high = 8.0f, low = 5.0f;
    for (int64_t i = 0; i < 2 * half * width; i++) {
        views[i] = i < half * width ? high : low;
    }
    config.deconv.lambda.value = LARGEST;
    config.deconv.curvature = 0.0;
    config.deconv.tolerance = 1e-8;
    config.deconv.iterations = 4000;
    assert_ok(estimate(volume, views, &psf, 2 * half, width));
    const double pull = 2.0 * LARGEST * LEAST_NOISE * (double)high / (double)half;
    for (int64_t i = 0; i < 2 * half * width; i++) {
        const double expected = i < half * width ? (double)high - pull : (double)low + pull;
        if (!(fabs((double)volume[i] - expected) < 1e-3 * pull)) {
            fail_msg("%d rows, pixel %d: %g, not %g", (int)(2 * half), (int)i, (double)volume[i],
                     expected);
        }
    }
}

static void edges_are_lowered_by_the_weight(void **state)
{
    (void)state;
    check_levels(8, 12);
    check_levels(11, 12); /* a torus of 24 rows */
}

/* Ripples of one pixel along y, x or both: differences along each of these axes are twice, the
 * curvature is four times what is left of them. */
static void check_ripples(int along_y, int along_x)
{
    enum { HEIGHT = 16, WIDTH = 12, RIPPLED = HEIGHT * WIDTH };
    static float views[RIPPLED], volume[RIPPLED], scratch[RIPPLED];
    float data[1];
    const struct v2v_psf_file psf = sharp_psf(data, 1);
    const double mean = 8.0, ripple = 2.0, weight = along_y && along_x ? 0.05 : 300.0;
    for (int i = 0; i < RIPPLED; i++) {
        const int is_up = (along_y * (i / WIDTH) + along_x * (i % WIDTH)) % 2;
        views[i] = (float)(is_up ? mean + ripple : mean - ripple);
    }
    config.deconv.lambda.value = weight;
    config.deconv.curvature = 0.4;
    config.deconv.tolerance = 1e-8;
    config.deconv.iterations = 4000;
    assert_ok(estimate(volume, views, &psf, HEIGHT, WIDTH));
    const double found = v2v_noise_of_images(scratch, views, 1, HEIGHT, WIDTH);
    const double noise = fmax(found, LEAST_NOISE * (mean + ripple));
    const double pull = weight * noise * (2.0 * sqrt(along_y + along_x) + 4.0 * 0.4);
    assert_true(pull > 0.1 * ripple && pull < 0.9 * ripple);
    for (int i = 0; i < RIPPLED; i++) {
        const double expected = (double)views[i] + ((double)views[i] > mean ? -pull : pull);
        if (!(fabs((double)volume[i] - expected) < 1e-3 * pull)) {
            fail_msg("along y: %d, x: %d: pixel %d: %g, not %g", along_y, along_x, i,
                     (double)volume[i], expected);
        }
    }
}

static void ripples_are_lowered_by_variation_and_curvature(void **state)
{
    (void)state;
    check_ripples(1, 0);
    check_ripples(0, 1);
    check_ripples(1, 1);
}

/* Two flat slices, each seen by a view: every pixel's pair is pulled together by lambda * depth. */
static void slices_are_pulled_together_by_the_weight_of_depth(void **state)
{
    (void)state;
    enum { SIDE = 8, PIXELS = SIDE * SIDE };
    static float views[2 * PIXELS], volume[2 * PIXELS];
    float data[4];
    const struct v2v_psf_file psf = sharp_psf(data, 2);
    for (int i = 0; i < 2 * PIXELS; i++) {
        views[i] = i < PIXELS ? 4.0f : 3.0f;
    }
    config.deconv.lambda.value = 1000.0;
    config.deconv.depth = 0.3;
    config.deconv.tolerance = 1e-8;
    config.deconv.iterations = 4000;
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    const double pull = 1000.0 * 0.3 * LEAST_NOISE * 4.0;
    for (int i = 0; i < 2 * PIXELS; i++) {
        const double expected = i < PIXELS ? 4.0 - pull : 3.0 + pull;
        assert_true(fabs((double)volume[i] - expected) < 1e-3 * pull);
    }
}

/* Where the volume itself has a weight every voxel pays it, and none pays more than it has. */
static void a_weight_of_the_volume_is_taken_from_every_voxel(void **state)
{
    (void)state;
    enum { SIDE = 8, PIXELS = SIDE * SIDE };
    static float views[2 * PIXELS], volume[2 * PIXELS];
    float data[4];
    const struct v2v_psf_file psf = sharp_psf(data, 2);
    const double sparsity = 1000.0, pull = sparsity * LEAST_NOISE * 4.0 * v2v_psf_voxel_noise(&psf);
    for (int i = 0; i < 2 * PIXELS; i++) {
        views[i] = i < PIXELS ? 4.0f : 0.5f * (float)pull;
    }
    config.deconv.lambda.value = 0.0;
    config.deconv.sparsity = (struct v2v_number){V2V_NUMBER_GIVEN, sparsity};
    config.deconv.tolerance = 1e-8;
    config.deconv.iterations = 4000;
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    for (int i = 0; i < 2 * PIXELS; i++) {
        const double expected = i < PIXELS ? 4.0 - pull : 0.0;
        if (!(fabs((double)volume[i] - expected) < 1e-3 * pull)) {
            fail_msg("voxel %d: %g, not %g", i, (double)volume[i], expected);
        }
    }
}

/* Noise of the views: 0.1, which the median of 2 x 2 differences finds to a few percent. */
static void noise_of_the_views_is_found(void **state)
{
    (void)state;
    enum { COUNT = 3, SIDE = 64 };
    static float images[COUNT * SIDE * SIDE], scratch[COUNT * SIDE * SIDE];
    for (int64_t i = 0; i < COUNT * SIDE * SIDE; i++) {
        const double slope = 0.01 * (double)(i % SIDE) + 0.02 * (double)(i / SIDE);
        images[i] = (float)(slope + 0.1 * v2v_random_normal(41, 0, (uint64_t)i));
    }
    const double found = v2v_noise_of_images(scratch, images, COUNT, SIDE, SIDE);
    /* standard error of the median of 12,000 correlated samples: 2 % */
    assert_true(found > 0.092 && found < 0.108);
    assert_true(v2v_noise_of_images(scratch, images, COUNT, 1, SIDE) == 0.0);
}

/* A ramp of light 0 .. 4, photons of 0.5 each: variance 0.5 light, and 0.02 beside it. Their
 * squares' mean over a tenth of 11,500 blocks, which overlap nine times, is known to sqrt(2 * 9 /
 * 1150), a tenth; the slope of the line, from all of them, to half of that, and the variance to
 * 0.012 (40 such ramps), of which this allows three. */
static void noise_of_photons_is_found(void **state)
{
    (void)state;
    enum { COUNT = 3, SIDE = 64 };
    static float images[COUNT * SIDE * SIDE];
    for (int64_t i = 0; i < COUNT * SIDE * SIDE; i++) {
        const double light = 4.0 * (double)(i % SIDE) / SIDE;
        const uint64_t pixel = (uint64_t)i;
        const double photons = (double)v2v_random_poisson(53, 0, pixel, light / 0.5);
        images[i] = (float)(0.5 * photons + sqrt(0.02) * v2v_random_normal(53, 1, pixel));
    }
    struct v2v_noise_line line = v2v_noise_line_of_images(images, COUNT, SIDE, SIDE, 6.0);
    if (!(fabs(line.gain / 0.5 - 1.0) < 0.1 && fabs(line.variance - 0.02) < 0.036 &&
          fabs(line.colour - 1.0) < 0.1)) {
        fail_msg("gain %g, variance %g, colour %g", line.gain, line.variance, line.colour);
    }
    images[5 * SIDE + 7] = 3e38f; /* out of the levels */
    const struct v2v_noise_line hot = v2v_noise_line_of_images(images, COUNT, SIDE, SIDE, 6.0);
    assert_true(fabs(hot.gain / line.gain - 1.0) < 0.01);
    line = v2v_noise_line_of_images(images, COUNT, 2, SIDE, 6.0);
    assert_true(line.gain == 0.0 && line.variance == 0.0 && line.colour == 0.0);
}

enum { SIDE = 40, PIXELS = SIDE * SIDE };

static void views_of_a_spot(float *views, float scale, double noise)
{
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        const int64_t y = i / SIDE % SIDE, x = i % SIDE;
        const double light = exp(-0.02 * (double)((y - 18) * (y - 18) + (x - 22) * (x - 22)));
        views[i] = scale * (float)(light + noise * v2v_random_normal(43, 0, (uint64_t)i));
    }
}

static void noisy_views(float *views, float scale)
{
    views_of_a_spot(views, scale, 0.1);
}

static void views_at_any_brightness_give_the_volume_at_that(void **state)
{
    (void)state;
    static const float scales[] = {0.1f, 10.0f, 1e-12f, 1e12f};
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS], scaled[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    noisy_views(views, 1.0f);
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_true(v2v_sum_of_squares(volume, SLICES * PIXELS) > 0.0);
    for (int64_t i = 0; i < SLICES * PIXELS; i++) {
        assert_true(volume[i] >= 0.0f);
    }
    for (size_t s = 0; s < sizeof scales / sizeof *scales; s++) {
        noisy_views(views, scales[s]);
        assert_ok(estimate(scaled, views, &psf, SIDE, SIDE));
        for (int64_t i = 0; i < SLICES * PIXELS; i++) {
            scaled[i] /= scales[s];
        }
        assert_true(test_relative_l2(scaled, volume, SLICES * PIXELS) < 1e-4);
    }
    v2v_psf_file_fini(&psf);
}

static double largest(const float *x, int64_t count)
{
    double found = 0.0;
    for (int64_t i = 0; i < count; i++) {
        assert_true(isfinite(x[i]) && x[i] >= 0.0f);
        found = fmax(found, (double)x[i]);
    }
    return found;
}

static void hard_views_give_finite_volumes(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    memset(views, 0, sizeof views);
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_true(largest(volume, SLICES * PIXELS) == 0.0); /* dark */
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = -1.0f;
    }
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_true(largest(volume, SLICES * PIXELS) == 0.0); /* darker */
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = 3.0f;
    }
    const double tolerance = config.deconv.tolerance;
    config.deconv.tolerance = 1e-4;
    assert_ok(
        estimate(volume, views, &psf, SIDE, SIDE)); /* flat: a PSF sums to 1 over all slices */
    assert_true(fabs(largest(volume, SLICES * PIXELS) / 3.0 - 1.0) < 0.01);
    config.deconv.tolerance = tolerance;
    noisy_views(views, 1.0f);
    views[PIXELS + 5 * SIDE + 7] = 1e6f; /* hot */
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_true(largest(volume, SLICES * PIXELS) > 0.0);
    noisy_views(views, 1.0f);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = fminf(views[i], 0.3f); /* saturated */
    }
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_in_range((int)(1000.0 * largest(volume, SLICES * PIXELS)), 20, 1000);
    views[2 * PIXELS + 3 * SIDE + 4] = NAN;
    assert_int_equal(estimate(volume, views, &psf, SIDE, SIDE), V2V_E_NUMERIC);
    assert_non_null(strstr(v2v_status_message(), "view 2, row 3, column 4"));
    v2v_psf_file_fini(&psf);
}

/* No light explains a negative sample. One of 1e4 times the scene leaves the brightest voxel as it
 * is, within a factor of two; beside deeper ones the volume is dark (2e-4 of them was found). */
static void a_deep_sample_gives_no_light(void **state)
{
    (void)state;
    static const float deep[] = {-1e4f, -1e6f, -1e30f, -3e38f};
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    noisy_views(views, 1.0f);
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    const double scene = largest(volume, SLICES * PIXELS);
    for (size_t i = 0; i < sizeof deep / sizeof *deep; i++) {
        views[PIXELS + 5 * SIDE + 7] = deep[i];
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        const double found = largest(volume, SLICES * PIXELS);
        const double most = i == 0 ? 2.0 * scene : -1e-3 * (double)deep[i];
        if (!(found > 0.5 * scene && found < most)) {
            fail_msg("%g: the brightest voxel is %g, %g without it", (double)deep[i], found, scene);
        }
    }
    v2v_psf_file_fini(&psf);
}

/* Frames smaller than the kernels, down to a pixel; one view; one slice; a dark slice. */
static void small_frames_and_few_views_work(void **state)
{
    (void)state;
    static const int64_t sides[][2] = {{4, 5}, {1, 9}, {9, 1}, {1, 1}};
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf(), part;
    noisy_views(views, 1.0f);
    for (size_t i = 0; i < sizeof sides / sizeof *sides; i++) {
        assert_ok(estimate(volume, views, &psf, sides[i][0], sides[i][1]));
        (void)largest(volume, SLICES * sides[i][0] * sides[i][1]);
    }
    part = psf;
    part.views = 1;
    assert_ok(estimate(volume, views, &part, SIDE, SIDE));
    assert_true(largest(volume, SLICES * PIXELS) > 0.0);
    part = psf;
    part.slices = 1; /* of the first view's, whose kernels then are those of four views */
    assert_ok(estimate(volume, views, &part, SIDE, SIDE));
    assert_true(largest(volume, PIXELS) > 0.0);
    memset(psf.data, 0, (size_t)(KERNEL_HEIGHT * KERNEL_WIDTH) * sizeof *psf.data);
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    assert_true(largest(volume, SLICES * PIXELS) > 0.0);
    v2v_psf_file_fini(&psf);
}

/* Views of dark and bright boxes with `photons` at 1 and otherwise noise `read`. */
static void box_views(float *views, float *truth, const struct v2v_psf_file *psf, double photons,
                      double read)
{
    struct v2v_projector *projector = NULL;
    for (int64_t i = 0; i < SLICES * PIXELS; i++) {
        const int64_t z = i / PIXELS, y = i / SIDE % SIDE, x = i % SIDE;
        truth[i] = (y / 6 + 2 * (x / 7) + z / 2) % 5 == 0 ? (float)(x * x) / (SIDE * SIDE) : 0.0f;
    }
    assert_ok(v2v_projector_create(&projector, psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        const double light = fmax(0.0, (double)views[i]);
        const double made =
            photons > 0.0
                ? (double)v2v_random_poisson(59, 0, (uint64_t)i, light * photons) / photons
                : light;
        views[i] = (float)(made + read * v2v_random_normal(59, 1, (uint64_t)i));
    }
    v2v_projector_destroy(&projector);
}

/* Of boxes seen with noise that is this part of the brightest sample. */
static int64_t iterations_of(double noise, double tolerance)
{
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    setup(NULL);
    box_views(views, truth, &psf, 0.0, 0.0);
    box_views(views, truth, &psf, 0.0, noise * largest(views, VIEWS * PIXELS));
    config.deconv.lambda.value = 0.03;
    config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN;
    config.deconv.tolerance = tolerance;
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    setup(NULL);
    v2v_psf_file_fini(&psf);
    return iterations;
}

/* The tolerance counts as it is where there is noise, by a tenth where there is none. */
static void less_noise_asks_for_more(void **state)
{
    (void)state;
    const double tolerance = 0.15;
    const int64_t with = iterations_of(0.03, tolerance), between = iterations_of(0.004, tolerance);
    const int64_t without = iterations_of(0.0, tolerance);
    if (!(2 * between > 3 * with && between < without && without > 2 * with)) {
        fail_msg("%d, %d and %d iterations", (int)with, (int)between, (int)without);
    }
}

/* Of points of light nearly all voxels are dark, and become so slowly: by the tolerance of other
 * scenes 0.31 of their length would be missing. */
static void points_of_light_come_nearly_as_far(void **state)
{
    (void)state;
    enum { LARGE = 64, POINTS = 3 };
    static float truth[SLICES * MOST], views[VIEWS * MOST], usual[SLICES * MOST],
        end[SLICES * MOST];
    struct v2v_psf_file psf = small_psf();
    struct v2v_projector *projector = NULL;
    for (int64_t k = 0; k < POINTS; k++) {
        truth[(k % SLICES * LARGE + 12 + 17 * k) * LARGE + 50 - 13 * k] = 1.0f;
    }
    assert_ok(v2v_projector_create(&projector, &psf, LARGE, LARGE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    double bright = 0.0;
    for (int64_t i = 0; i < VIEWS * MOST; i++) {
        bright = fmax(bright, (double)views[i]);
    }
    for (int64_t i = 0; i < VIEWS * MOST; i++) {
        views[i] += (float)(0.02 * bright * v2v_random_normal(17, 0, (uint64_t)i));
    }
    config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, 0.02};
    assert_ok(estimate(usual, views, &psf, LARGE, LARGE));
    const int64_t taken = iterations;
    config.deconv.tolerance = 1e-5;
    config.deconv.iterations = 2000;
    assert_ok(estimate(end, views, &psf, LARGE, LARGE));
    v2v_psf_file_fini(&psf);
    const double away = test_relative_l2(usual, end, SLICES * MOST);
    print_message("%d iterations, %.3f from where they end after %d\n", (int)taken, away,
                  (int)iterations);
    assert_true(away < 0.1);
}

/* The error of their volume by a model of the noise, of the truth's length. */
static double error_by(enum v2v_noise_model model, float *volume, double photons, double read)
{
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS];
    struct v2v_psf_file psf = small_psf();
    box_views(views, truth, &psf, photons, read);
    config.deconv.noise = model;
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    v2v_psf_file_fini(&psf);
    return test_relative_l2(volume, truth, SLICES * PIXELS);
}

/* Of photons: weighted, and closer to the truth. Else `auto` gives the bits of `gaussian`. */
static void noise_of_photons_is_weighted(void **state)
{
    (void)state;
    static float even[SLICES * PIXELS], found[SLICES * PIXELS], told[SLICES * PIXELS];
    const double without = error_by(V2V_NOISE_MODEL_GAUSSIAN, even, 200.0, 0.0);
    const double with = error_by(V2V_NOISE_MODEL_AUTO, found, 200.0, 0.0);
    (void)error_by(V2V_NOISE_MODEL_POISSON, told, 200.0, 0.0);
    if (!(with < 0.97 * without)) {
        fail_msg("error %g, without weights %g", with, without);
    }
    assert_memory_equal(found, told, sizeof found);
    (void)error_by(V2V_NOISE_MODEL_GAUSSIAN, even, 0.0, 0.05);
    (void)error_by(V2V_NOISE_MODEL_AUTO, found, 0.0, 0.05);
    assert_memory_equal(found, even, sizeof found);
}

/* Error of the volume of views of which every other 6 rows are means of `frames` frames, told so or
 * not. */
static double error_of_averages(float frames, int is_told, double photons)
{
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    static float sum[VIEWS * PIXELS], of[VIEWS * PIXELS];
    const double read = photons > 0.0 ? 0.0 : 0.05;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    struct v2v_psf_file psf = small_psf();
    float *to = volume;
    config.deconv.noise = V2V_NOISE_MODEL_AUTO;
    config.recon.neighbours = 1;
    box_views(sum, truth, &psf, 0.0, 0.0);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        of[i] = i / SIDE % 12 < 6 ? 1.0f : frames;
        const double light = fmax(0.0, (double)sum[i]);
        const double counts = photons * (double)of[i];
        const double made =
            photons > 0.0 ? (double)v2v_random_poisson(61, 0, (uint64_t)i, light * counts) / counts
                          : light;
        views[i] =
            (float)(made + read / sqrt((double)of[i]) * v2v_random_normal(61, 1, (uint64_t)i));
    }
    const struct v2v_averaging averaging = {of, read, photons > 0.0 ? 1.0 / photons : 0.0, 0.0,
                                            photons > 0.0};
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    assert_ok(v2v_estimator_find(&ops, "tv"));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    estimator->averaging = is_told ? &averaging : NULL;
    assert_ok(ops->run(estimator, &to, views, NULL));
    if (is_told) { /* and the noise is found where it is known */
        const double missed = estimator->misfit.missed;
        print_message("frames %g, photons %g: missed by %g\n", (double)frames, photons, missed);
        assert_true(missed > 0.8 && missed < 1.2);
    }
    v2v_estimator_destroy(&estimator);
    v2v_psf_file_fini(&psf);
    return test_relative_l2(volume, truth, SLICES * PIXELS);
}

/* Samples of less noise count for more. */
static void averages_count_by_their_frames(void **state)
{
    (void)state;
    for (int of_photons = 0; of_photons < 2; of_photons++) {
        const double photons = of_photons ? 30.0 : 0.0;
        const double told = error_of_averages(25.0f, 1, photons);
        const double untold = error_of_averages(25.0f, 0, photons);
        if (!(told < 0.97 * untold)) {
            fail_msg("photons %g: error %g, %g untold", photons, told, untold);
        }
    }
}

/* Weights go by the volume's light and the volume by weights: where views contradict each other,
 * as by a hot pixel, they don't answer each other for ever. */
static void contradictory_views_come_to_rest_under_weights(void **state)
{
    (void)state;
    enum { CONTRADICTIONS = 3, WITHOUT_END = 500 };
    static float truth[SLICES * PIXELS], views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    config.deconv.noise = V2V_NOISE_MODEL_POISSON;
    for (int c = 0; c < CONTRADICTIONS; c++) {
        box_views(views, truth, &psf, 200.0, 0.0);
        const float brightest = (float)largest(views, VIEWS * PIXELS);
        for (int64_t i = PIXELS; i < 2 * PIXELS; i++) { /* the second view's */
            views[i] = c == 0 ? views[i] : c == 1 ? 5.0f * views[i] : 0.0f;
        }
        if (c == 0) {
            views[PIXELS + 5 * SIDE + 7] = 10.0f * brightest;
        }
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        print_message("%d: %d iterations\n", c, (int)iterations);
        assert_true(iterations < WITHOUT_END);
        (void)largest(volume, SLICES * PIXELS);
    }
    v2v_psf_file_fini(&psf);
}

/* Steps are float32: they have no room for the square of such a sum. */
static void psfs_of_absurd_sums_are_refused(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    noisy_views(views, 1.0f);
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH; i++) {
        psf.data[i] *= 1e25f;
    }
    assert_int_equal(estimate(volume, views, &psf, SIDE, SIDE), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "--normalize view"));
    v2v_psf_file_fini(&psf);
}

/* PSFs that sum to little or much in place of 1: volumes as much brighter or darker. Without noise
 * these are 1e4 in units of it, and the squares of their spectra beyond float32. */
static void psfs_of_other_sums_give_the_same_volume(void **state)
{
    (void)state;
    enum { TAPS = VIEWS * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH };
    static const float sums[] = {2e-15f, 1e-6f, 1e6f, 5e14f};
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS], other[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    views_of_a_spot(views, 1.0f, 0.0);
    assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
    for (size_t i = 0; i < sizeof sums / sizeof *sums; i++) {
        struct v2v_psf_file scaled = small_psf();
        for (int64_t k = 0; k < TAPS; k++) {
            scaled.data[k] *= sums[i];
        }
        assert_ok(estimate(other, views, &scaled, SIDE, SIDE));
        for (int64_t k = 0; k < SLICES * PIXELS; k++) {
            other[k] *= sums[i];
        }
        assert_true(test_relative_l2(other, volume, SLICES * PIXELS) < 1e-4);
        v2v_psf_file_fini(&scaled);
    }
    v2v_psf_file_fini(&psf);
}

/* Flat views are of a flat volume, in which nothing differs, along z either. */
static void any_weight_of_depth_leaves_the_light(void **state)
{
    (void)state;
    static const double depths[] = {0.0, 0.25, 1.0, 10.0, 100.0};
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = 3.0f + 0.5f * (float)v2v_random_normal(67, 0, (uint64_t)i);
    }
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
        double light = 0.0;
        config.deconv.depth = depths[i];
        assert_ok(estimate(volume, views, &psf, SIDE, SIDE));
        for (int64_t k = 0; k < SLICES * PIXELS; k++) {
            light += (double)volume[k] / (SLICES * PIXELS);
        }
        print_message("depth %g: %d iterations, light %g\n", depths[i], (int)iterations, light);
        assert_true(fabs(light / 3.0 - 1.0) < 0.1);
    }
    v2v_psf_file_fini(&psf);
}

/* A rank reads two rows of its neighbours. */
static void a_rank_takes_two_rows_at_least(void **state)
{
    (void)state;
    struct v2v_psf_file psf = small_psf();
    struct v2v_grid_work work;
    for (int64_t height = 1; height < 8; height++) {
        const struct v2v_problem problem = {
            .config = &config, .psf = &psf, .height = height, .width = SIDE};
        assert_ok(v2v_estimator_tv.describe_work(&work, &problem));
        assert_int_equal(work.most_shards, height < 2 ? 1 : height / 2);
    }
    v2v_psf_file_fini(&psf);
}

static void a_rule_of_another_method_is_refused(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
    struct v2v_psf_file psf = small_psf();
    config.deconv.stop = V2V_STOP_HELDOUT;
    assert_int_equal(estimate(volume, views, &psf, SIDE, SIDE), V2V_E_CONFIG);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(edges_are_lowered_by_the_weight, setup),
        cmocka_unit_test_setup(ripples_are_lowered_by_variation_and_curvature, setup),
        cmocka_unit_test_setup(slices_are_pulled_together_by_the_weight_of_depth, setup),
        cmocka_unit_test_setup(a_weight_of_the_volume_is_taken_from_every_voxel, setup),
        cmocka_unit_test_setup(noise_of_the_views_is_found, setup),
        cmocka_unit_test_setup(noise_of_photons_is_found, setup),
        cmocka_unit_test_setup(noise_of_photons_is_weighted, setup),
        cmocka_unit_test_setup(averages_count_by_their_frames, setup),
        cmocka_unit_test_setup(views_at_any_brightness_give_the_volume_at_that, setup),
        cmocka_unit_test_setup(less_noise_asks_for_more, setup),
        cmocka_unit_test_setup(points_of_light_come_nearly_as_far, setup),
        cmocka_unit_test_setup(hard_views_give_finite_volumes, setup),
        cmocka_unit_test_setup(a_deep_sample_gives_no_light, setup),
        cmocka_unit_test_setup(small_frames_and_few_views_work, setup),
        cmocka_unit_test_setup(contradictory_views_come_to_rest_under_weights, setup),
        cmocka_unit_test_setup(psfs_of_absurd_sums_are_refused, setup),
        cmocka_unit_test_setup(psfs_of_other_sums_give_the_same_volume, setup),
        cmocka_unit_test_setup(any_weight_of_depth_leaves_the_light, setup),
        cmocka_unit_test_setup(a_rank_takes_two_rows_at_least, setup),
        cmocka_unit_test_setup(a_rule_of_another_method_is_refused, setup),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
