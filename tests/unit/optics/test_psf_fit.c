#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/psf_fit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct v2v_optics_settings truth(void)
{
    return (struct v2v_optics_settings){.tilts = "0 0, 0.4 0, 0 -0.4, -0.5 0.3, 0.1 0.6",
                                        .numerical_aperture = 0.85,
                                        .needle_aperture = 0.25,
                                        .refractive_index = 1.33,
                                        .photons = 2,
                                        .wavelength_um = 0.92,
                                        .pixel_size_um = 0.5,
                                        .slice_spacing_um = 1.0,
                                        .focus_slice = 0.4,
                                        .slices = 9,
                                        .size = 32,
                                        .shift = 1,
                                        .sampling = V2V_OPTICS_SAMPLING_PIXEL};
}

/* The model is exact, so that only where the optimiser stops keeps a fit from 1: rounds end when
 * they gain 1e-6, after which curved valleys may hold a thousand times that. */
static double least_correlation(const struct v2v_optics_settings *fitted,
                                const struct v2v_psf_file *psf)
{
    double least = 1;
    struct v2v_psf_file model;
    struct v2v_psf_likeness likeness;
    assert_ok(v2v_psf_simulate(&model, fitted));
    assert_ok(v2v_psf_compare(&likeness, &model, psf));
    for (int64_t v = 0; v < likeness.views; v++) {
        least = fmin(least, likeness.correlation[v]);
        assert_true(likeness.centroid[v] < 0.1);
    }
    v2v_psf_likeness_fini(&likeness);
    v2v_psf_file_fini(&model);
    return least;
}

/* Of sizes that are not stated a set without a pinhole shows what the paraxial field depends on.
 * That is known as well as the rays here are paraxial: tan(theta) of the steepest, 0.42, less its
 * sine is 8 % of it, of which the fit takes up a part. */
static void fit_finds_what_a_set_was_made_with(void **state)
{
    const struct v2v_optics_settings optics = truth();
    struct v2v_optics_settings fitted = truth();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    psf.pixel_size_um = psf.slice_spacing_um = 0;
    fitted.tilts[0] = '\0';
    fitted.needle_aperture = 0.2;
    fitted.pixel_size_um = 0.6;
    fitted.slice_spacing_um = 0.8;
    fitted.focus_slice = 0;
    fitted.shift = 0;
    assert_ok(v2v_psf_fit(&fitted, &psf, NULL, 0));
    assert_int_equal(fitted.shift, 1);
    assert_true(least_correlation(&fitted, &psf) > 0.999);
    const double pixel = fitted.pixel_size_um;
    assert_true(fabs(fitted.slice_spacing_um / (pixel * pixel) / 4 - 1) < 0.05);
    assert_true(fabs(fitted.focus_slice - 0.4) < 0.05);
    v2v_psf_file_fini(&psf);
}

/* Stated sizes are kept; an aberration is found where it is asked for. */
static void fit_keeps_stated_sizes_and_finds_aberrations(void **state)
{
    static const int64_t modes[] = {5};
    struct v2v_optics_settings optics = truth(), fitted = truth();
    struct v2v_psf_file psf;
    (void)state;
    strcpy(optics.zernike, "5:0.08");
    assert_ok(v2v_psf_simulate(&psf, &optics));
    fitted.pixel_size_um = 0.7;
    assert_ok(v2v_psf_fit(&fitted, &psf, modes, 1));
    assert_true(fitted.pixel_size_um == 0.5 && fitted.slice_spacing_um == 1.0);
    assert_true(least_correlation(&fitted, &psf) > 0.999);
    assert_memory_equal(fitted.zernike, "5:0.0", 5);
    assert_true(fabs(strtod(fitted.zernike + 2, NULL) - 0.08) < 0.008); /* a tenth of it */
    v2v_psf_file_fini(&psf);
}

static void oblong_slices_are_refused(void **state)
{
    struct v2v_optics_settings settings = truth();
    struct v2v_psf_file psf = {.views = 1, .slices = 1, .height = 4, .width = 6};
    const size_t held = v2v_mem_held();
    (void)state;
    assert_int_equal(v2v_psf_fit(&settings, &psf, NULL, 0), V2V_E_INPUT);
    assert_int_equal(v2v_mem_held(), held);
}

/* Settings that a fit prints are ones that the simulation takes: a view that was made with a larger
 * aperture is moved into the pupil. */
static void a_view_at_the_pupils_edge_stays_inside(void **state)
{
    struct v2v_optics_settings optics = truth(), fitted = truth();
    struct v2v_psf_file psf, model;
    (void)state;
    strcpy(optics.tilts, "0 0, 0.7 0.7, -0.6 0");
    assert_ok(v2v_psf_simulate(&psf, &optics));
    fitted.tilts[0] = '\0';
    fitted.numerical_aperture = 0.45;
    assert_ok(v2v_psf_fit(&fitted, &psf, NULL, 0));
    assert_ok(v2v_psf_simulate(&model, &fitted));
    v2v_psf_file_fini(&model);
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fit_finds_what_a_set_was_made_with),
        cmocka_unit_test(fit_keeps_stated_sizes_and_finds_aberrations),
        cmocka_unit_test(oblong_slices_are_refused),
        cmocka_unit_test(a_view_at_the_pupils_edge_stays_inside),
    };
    return cmocka_run_group_tests_name("optics.psf_fit", tests, NULL, NULL);
}
