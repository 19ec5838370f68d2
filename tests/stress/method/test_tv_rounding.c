/* Total variation in single precision against plain loops in double precision, also where it is
 * worst conditioned.
 *
 * An iteration takes two volumes x and their duals u no farther apart, as a norm of both has it
 * that their steps make (REFERENCE.md 10): the errors of iterations add up at most. One errs by
 * transforms there and back and a product a frequency, some hundred roundings. What views disagree
 * by, the rounded inverse makes 2^-24 / p of (tests/stress/optics/test_data_step.c), p the least
 * penalty: a hot pixel is little else. */
#include "small_optics.h"
#include "twin_tv.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum { HEIGHT = 14, WIDTH = 17, PIXELS = HEIGHT * WIDTH, ITERATIONS = 60 };
enum { SAMPLES = VIEWS * PIXELS, VOXELS = SLICES * PIXELS, KERNEL = KERNEL_HEIGHT * KERNEL_WIDTH };

static const double transforms = 256.0;

/* Two balls, with noise of this part of their light. */
static void make_views(float *views, double noise)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const double y = (double)(i / WIDTH % HEIGHT), x = (double)(i % WIDTH);
        const double near = exp(-0.1 * ((y - 4.0) * (y - 4.0) + (x - 5.0) * (x - 5.0)));
        const double far = exp(-0.2 * ((y - 9.0) * (y - 9.0) + (x - 12.0) * (x - 12.0)));
        views[i] = (float)(near + 0.5 * far + noise * v2v_random_normal(61, 0, (uint64_t)i));
    }
}

/* What the program takes of these views: noise, and the step of the duals. */
static struct twin_pace pace_of(double *sigma, const float *views, int64_t count, int64_t images,
                                double weight, const struct twin_pace *factors)
{
    static float scratch[SAMPLES];
    const double found = v2v_noise_of_images(scratch, views, images, HEIGHT, WIDTH);
    double most = 0.0, deepest = 0.0;
    for (int64_t i = 0; i < count; i++) {
        most = fmax(most, (double)views[i]);
        deepest = fmax(deepest, -(double)views[i]);
    }
    memcpy(scratch, views, (size_t)count * sizeof *views);
    const int64_t bright = count - 1 - (int64_t)((double)count * 1e-3);
    const double brightness = fmax((double)v2v_select(scratch, count, bright), 1e-3 * most);
    *sigma = fmax(found, 1e-4 * fmax(brightness, 1e-3 * fmax(most, deepest)));
    const double deep = sqrt(fmax(1.0, deepest / (10.0 * brightness)));
    const double wanted = factors->step * *sigma * weight / brightness * deep;
    const double step = fmin(fmax(wanted, 1.0 / 2048.0), 4.0);
    return (struct twin_pace){exp2(round(2.0 * log2(step)) / 2.0), factors->plain};
}

static void estimate(float *volume, const float *views, const struct v2v_psf_file *psf,
                     const struct v2v_config *config)
{
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = config, .psf = psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_estimator_find(&ops, "tv"));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    assert_ok(ops->run(estimator, &volume, views, NULL));
    v2v_estimator_destroy(&estimator);
}

/* By the noise that a back-projection has, beside that of 13 views of 39 slices. */
/* b, of PSFs that sum to 1 a view. */
static double voxel_noise_of(const struct v2v_psf_file *psf)
{
    const int64_t samples = psf->views * psf->slices * psf->height * psf->width;
    double squares = 0.0, sum = 0.0;
    for (int64_t i = 0; i < samples; i++) {
        squares += (double)psf->data[i] * (double)psf->data[i];
        sum += (double)psf->data[i];
    }
    const double light = sum / (double)psf->views;
    return sqrt(squares / (double)psf->slices) / light;
}

static double times_plain_of(const struct v2v_psf_file *psf)
{
    return sqrt(fmax(voxel_noise_of(psf) / 0.02976, 1.0));
}

static void check_sparse(const char *what, struct v2v_psf_file *psf, const float *views,
                         double sparsity)
{
    static float volume[VOXELS];
    static double expected[VOXELS];
    struct v2v_config config;
    double sigma = 0.0;
    v2v_config_defaults(&config);
    const double weight = config.deconv.lambda.value * (1.0 + config.deconv.curvature);
    config.deconv.iterations = ITERATIONS;
    config.deconv.tolerance = 0.0;
    config.deconv.sparsity = (struct v2v_number){V2V_NUMBER_GIVEN, sparsity};
    v2v_psf_normalize_views(psf);
    const double plain = times_plain_of(psf);
    const struct v2v_torus torus = v2v_data_step_torus_of(psf, HEIGHT, WIDTH);
    const struct twin_tv settings = {.weight = config.deconv.lambda.value,
                                     .depth = config.deconv.depth,
                                     .curvature = config.deconv.curvature,
                                     .sparse = sparsity * voxel_noise_of(psf),
                                     .pace = pace_of(&sigma, views, psf->views * PIXELS, psf->views,
                                                     weight, &(struct twin_pace){2.0, 0.5 * plain}),
                                     .pace_if_filled =
                                         pace_of(&sigma, views, psf->views * PIXELS, psf->views,
                                                 weight, &(struct twin_pace){16.0, 0.1 * plain}),
                                     .iterations = ITERATIONS};
    struct twin_data_step step = {.views = psf->views,
                                  .slices = psf->slices,
                                  .kernel_height = psf->height,
                                  .kernel_width = psf->width,
                                  .height = HEIGHT,
                                  .width = WIDTH,
                                  .torus_height = torus.height,
                                  .torus_width = torus.width,
                                  .psf = psf->data};
    twin_data_step_init(&step);
    twin_data_step_begin(&step, views, 1.0 / sigma);
    const double longest = twin_tv_run(expected, &step, &settings);
    for (int64_t i = 0; i < psf->slices * PIXELS; i++) {
        expected[i] *= sigma;
    }
    estimate(volume, views, psf, &config);
    const double error = test_relative_l2_to_double(volume, expected, psf->slices * PIXELS);
    const struct twin_penalty penalty = twin_tv_penalty(&settings, &settings.pace);
    print_message("%s: noise %.3g, step %.4g, on the way %.3g, condition %.3g, error %.1e\n", what,
                  sigma, settings.pace.step, longest, twin_data_step_condition(&step, &penalty),
                  error);
    /* Of the transforms; of inverses and gradients, over the least penalty. */
    const double rounding = ITERATIONS * test_rounding(transforms) + 0x1p-23 / penalty.constant;
    assert_true(error <= rounding * fmax(longest, 1.0));
    twin_data_step_fini(&step);
    v2v_psf_file_fini(psf);
}

static void check(const char *what, struct v2v_psf_file *psf, const float *views)
{
    check_sparse(what, psf, views, 0.0);
}

static void single_precision_is_that_of_the_iterations(void **state)
{
    (void)state;
    static const double noise[] = {0.2, 0.05, 1e-3, 0.0};
    static float views[SAMPLES];
    for (size_t i = 0; i < sizeof noise / sizeof *noise; i++) {
        struct v2v_psf_file psf = small_psf();
        make_views(views, noise[i]);
        check("noisy views", &psf, views);
        psf = small_psf();
        check_sparse("noisy views, the volume itself has a weight", &psf, views, 1.0);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void views_alike_are_no_matter(void **state)
{
    (void)state;
    static float views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    make_views(views, 1e-3);
    memcpy(psf.data + SLICES * KERNEL, psf.data, SLICES * KERNEL * sizeof *psf.data);
    check("two views alike", &psf, views);
    psf = small_psf();
    psf.slices = 1;
    memset(psf.data, 0, VIEWS * KERNEL * sizeof *psf.data);
    for (int v = 0; v < VIEWS; v++) {
        psf.data[v * KERNEL + 4 * KERNEL_WIDTH + 5] = 1.0f;
    }
    check("one slice seen sharp by all", &psf, views);
}

static void a_slice_that_no_view_sees_is_no_matter(void **state)
{
    (void)state;
    static float views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    make_views(views, 1e-3);
    for (int v = 0; v < VIEWS; v++) {
        memset(psf.data + (v * SLICES + 2) * KERNEL, 0, KERNEL * sizeof *psf.data);
    }
    check("a slice that no view sees", &psf, views);
}

static void hot_and_negative_pixels_are_no_matter(void **state)
{
    (void)state;
    static float views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    make_views(views, 0.05);
    views[PIXELS + 5 * WIDTH + 7] = 1e4f;
    check("a hot pixel", &psf, views);
    psf = small_psf();
    views[PIXELS + 5 * WIDTH + 7] = -1e4f;
    check("a deep pixel", &psf, views);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(single_precision_is_that_of_the_iterations),
        cmocka_unit_test(views_alike_are_no_matter),
        cmocka_unit_test(a_slice_that_no_view_sees_is_no_matter),
        cmocka_unit_test(hot_and_negative_pixels_are_no_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
