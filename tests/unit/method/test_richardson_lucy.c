/* Richardson-Lucy, one view at a time: of PSFs that a calibration displaced (sharp ones ring, to
 * below zero), and at the border of the frame. */
#include "small_optics.h"
#include "twin_projector.h"

#include "v2v3d/base/random.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum { SIDE = 40, PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, BLOBS = 12 };

/* Sharp ones, displaced by parts of pixels. */
static struct v2v_psf_file displaced_psf(void)
{
    struct v2v_psf_file psf = point_psf();
    static struct v2v_view_calibration view[VIEWS];
    const struct v2v_calibration calibration = {
        .views = VIEWS, .height = SIDE, .width = SIDE, .view = view};
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

/* Wide PSFs, at some distance from the axis: voxels at the border give views hardly any light. */
static struct v2v_psf_file wide_psf(void)
{
    struct v2v_psf_file psf = {.views = VIEWS, .slices = SLICES, .height = 31, .width = 31};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * psf.height * psf.width));
    float *kernel = psf.data;
    for (int v = 0; v < VIEWS; v++) {
        for (int z = 0; z < SLICES; z++, kernel += psf.height * psf.width) {
            const double turn = 2.0 * acos(-1.0) * v / VIEWS, depth = 3.0 * (z - SLICES / 2);
            for (int64_t i = 0; i < psf.height * psf.width; i++) {
                const double y = (double)(i / psf.width) - 15.0 - depth * sin(turn);
                const double x = (double)(i % psf.width) - 15.0 - depth * cos(turn);
                kernel[i] = (float)exp(-0.5 * (y * y + x * x) / 5.8);
            }
        }
    }
    v2v_psf_normalize_views(&psf);
    return psf;
}

/* The formula of REFERENCE.md 7 in plain loops, from a constant volume of the views' light. */
static void plain_rld(double x[VOXELS], const struct v2v_psf_file *psf,
                      const float views[VIEWS * PIXELS], int64_t iterations)
{
    static double image[PIXELS], above[VOXELS], below[VIEWS][VOXELS];
    const struct twin_shape shape = {SLICES, psf->height, psf->width, SIDE, SIDE};
    const int64_t of_view = psf->slices * psf->height * psf->width;
    double light = 0.0, seen = 0.0;
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t i = 0; i < PIXELS; i++) {
            image[i] = 1.0;
            light += (double)views[v * PIXELS + i];
        }
        twin_project_adjoint(below[v], image, psf->data + v * of_view, &shape);
        for (int64_t i = 0; i < VOXELS; i++) {
            seen += below[v][i];
        }
    }
    for (int64_t i = 0; i < VOXELS; i++) {
        x[i] = light / seen;
    }
    for (int64_t n = 0; n < iterations * VIEWS; n++) {
        const int64_t v = n % VIEWS;
        twin_project(image, x, psf->data + v * of_view, &shape);
        for (int64_t i = 0; i < PIXELS; i++) {
            image[i] = (double)views[v * PIXELS + i] / image[i];
        }
        memset(above, 0, sizeof above);
        twin_project_adjoint(above, image, psf->data + v * of_view, &shape);
        for (int64_t i = 0; i < VOXELS; i++) {
            x[i] *= 0.5 + 0.5 * above[i] / below[v][i];
        }
    }
}

static void voxels_at_the_border_count_by_what_little_they_give(void **state)
{
    (void)state;
    enum { ITERATIONS = 3 };
    static float views[VIEWS * PIXELS], volume[VOXELS];
    static double plain[VOXELS];
    struct v2v_psf_file psf = wide_psf();
    struct v2v_config config;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
    float *volumes = volume;
    double error = 0.0, norm = 0.0;
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = (float)(0.5 + v2v_random_uniform(7, 0, (uint64_t)i));
    }
    v2v_config_defaults(&config);
    config.deconv.iterations = ITERATIONS;
    assert_ok(v2v_estimator_find(&ops, "rld"));
    assert_ok(v2v_estimator_create(&estimator, ops, &problem, NULL));
    assert_ok(ops->run(estimator, &volumes, views, NULL));
    v2v_estimator_destroy(&estimator);
    plain_rld(plain, &psf, views, ITERATIONS);
    for (int64_t i = 0; i < VOXELS; i++) {
        error += ((double)volume[i] - plain[i]) * ((double)volume[i] - plain[i]);
        norm += plain[i] * plain[i];
    }
    print_message("off by %.2g\n", sqrt(error / norm));
    /* voxels that give 1e-5 of the light, after transforms that round by some 1e-9 of it */
    assert_true(sqrt(error / norm) < 3e-4);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(displaced_psfs_do_not_make_light),
        cmocka_unit_test(voxels_at_the_border_count_by_what_little_they_give),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
