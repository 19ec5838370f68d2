/* Richardson-Lucy, one view at a time, of PSFs that a calibration displaced: sharp ones ring, to
 * below zero. */
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/statistics.h"

enum { SIDE = 40, PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, BLOBS = 12 };

/* A pixel of light a slice, where small_psf has its spots, displaced by parts of pixels. */
static struct v2v_psf_file displaced_psf(void)
{
    struct v2v_psf_file psf = small_psf();
    static struct v2v_view_calibration view[VIEWS];
    const struct v2v_calibration calibration = {
        .views = VIEWS, .height = SIDE, .width = SIDE, .view = view};
    const int64_t pixels = psf.height * psf.width;
    for (int64_t k = 0; k < VIEWS * SLICES; k++) {
        float *kernel = psf.data + k * pixels;
        int64_t brightest = 0;
        for (int64_t i = 0; i < pixels; i++) {
            brightest = kernel[i] > kernel[brightest] ? i : brightest;
        }
        for (int64_t i = 0; i < pixels; i++) {
            kernel[i] = i == brightest ? 1.0f / SLICES : 0.0f;
        }
    }
    for (int v = 0; v < VIEWS; v++) {
        view[v] =
            (struct v2v_view_calibration){.gain = 1.0, .shift = {0.5, v % 2 == 0 ? 0.5 : -0.5}};
    }
    assert_ok(v2v_calibration_apply_to_psf(&psf, &calibration));
    return psf;
}

static struct v2v_figures figures_of(const float *x, int64_t count)
{
    struct v2v_figures figures = {0};
    v2v_figures_add(&figures, x, count);
    return figures;
}

static void displaced_psfs_do_not_make_light(void **state)
{
    (void)state;
    static const char *const methods[] = {"rld", "frl"};
    static float truth[VOXELS], views[VIEWS * PIXELS], volume[VOXELS];
    struct v2v_psf_file psf = displaced_psf();
    struct v2v_config config;
    struct v2v_projector *projector = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    assert_true(figures_of(psf.data, psf.views * psf.slices * psf.height * psf.width).least <
                -0.01);
    for (uint64_t k = 0; k < BLOBS; k++) {
        truth[(int64_t)(v2v_random_uniform(5, 0, k) * VOXELS)] = 1.0f;
    }
    assert_ok(v2v_projector_create(&projector, &psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, views, truth, NULL, VIEWS, 1.0f);
    v2v_projector_destroy(&projector);
    double seen = 0.0; /* a slice's PSF of a view sums to 1 / SLICES */
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] += (float)(0.001 * v2v_random_normal(6, 0, (uint64_t)i));
        seen += views[i] > 0.0f ? (double)views[i] * SLICES / VIEWS : 0.0;
    }
    v2v_config_defaults(&config);
    config.deconv.iterations = 20;
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++) {
        const struct v2v_estimator_ops *ops = NULL;
        struct v2v_estimator *estimator = NULL;
        float *volumes = volume;
        assert_ok(v2v_estimator_find(&ops, methods[i]));
        assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
        assert_ok(ops->run(estimator, &volumes, views, NULL));
        v2v_estimator_destroy(&estimator);
        const double light = v2v_sum(volume, VOXELS);
        print_message("%s: light of %.3g, in views where they are positive %.3g\n", methods[i],
                      light, seen);
        assert_true(light > 0.1 * seen && light < 1.5 * seen); /* some has come from the border */
        assert_true(figures_of(volume, VOXELS).most < light);
    }
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(displaced_psfs_do_not_make_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
