/* The model of psf simulate against closed forms of low apertures. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <string.h>

static const double PI = 3.14159265358979323846;

/* Wide field: one sub-aperture that is the pupil, one photon. */
static struct v2v_optics_settings wide_field(void)
{
    return (struct v2v_optics_settings){.views_per_ring = 1,
                                        .numerical_aperture = 0.2,
                                        .needle_aperture = 0.2,
                                        .refractive_index = 1.33,
                                        .photons = 1,
                                        .wavelength_um = 0.5,
                                        .pixel_size_um = 0.25,
                                        .slice_spacing_um = 4.0,
                                        .slices = 9,
                                        .size = 201,
                                        .normalize = V2V_OPTICS_NORMALIZE_NONE};
}

static const float *slice_of(const struct v2v_psf_file *psf, int64_t v, int64_t z)
{
    return psf->data + (v * psf->slices + z) * psf->height * psf->width;
}

/* Light is neither gained nor lost on its way. 50 um hold all but the Airy pattern's tails. */
static void light_of_a_slice_does_not_depend_on_depth(void **state)
{
    struct v2v_optics_settings optics = wide_field();
    struct v2v_psf_file psf;
    double sum[9] = {0};
    (void)state;
    optics.beam_radius = 0.4; /* no tails */
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t z = 0; z < 9; z++) {
        for (int64_t i = 0; i < 201 * 201; i++) {
            sum[z] += slice_of(&psf, 0, z)[i];
        }
        assert_true(fabs(sum[z] / sum[0] - 1) < 1e-3);
    }
    v2v_psf_file_fini(&psf);
}

/* Born and Wolf, Principles of Optics, 8.8: (2 J1(u)/u)^2 in focus. The pupil on a grid is 20 steps
 * wide: 1 %. */
static void focus_is_the_airy_pattern(void **state)
{
    const struct v2v_optics_settings optics = wide_field();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    const float *focus = slice_of(&psf, 0, 4) + 100 * 201 + 100;
    for (int64_t x = 1; x <= 20; x++) {
        const double u = 2 * PI * 0.2 / 0.5 * 0.25 * (double)x;
        assert_true(fabs(focus[x] / focus[0] - pow(2 * j1(u) / u, 2)) <= 0.01);
    }
    v2v_psf_file_fini(&psf);
}

/* On the axis: sinc^2 of half the phase between the pupil's middle and its edge. */
static void axis_is_sinc_squared(void **state)
{
    const struct v2v_optics_settings optics = wide_field();
    const double k = 1.33 / 0.5, edge = 0.2 / 0.5;
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    const double peak = slice_of(&psf, 0, 4)[100 * 201 + 100];
    for (int64_t z = 0; z < 9; z++) {
        const double half = PI * (double)(z - 4) * 4.0 * (k - sqrt(k * k - edge * edge));
        const double expected = z == 4 ? 1 : pow(sin(half) / half, 2);
        assert_true(fabs(slice_of(&psf, 0, z)[100 * 201 + 100] / peak - expected) <= 0.01);
    }
    v2v_psf_file_fini(&psf);
}

/* A beam that fills 0.4 of the aperture: w(z) = w0 sqrt(1 + (z / (pi k w0^2))^2), w0 = wavelength /
 * (pi 0.4 NA); its intensity's second moment is w^2 / 2. */
static void gaussian_beam_widens_as_it_should(void **state)
{
    struct v2v_optics_settings optics = wide_field();
    const double w0 = 0.5 / (PI * 0.4 * 0.2), range = PI * 1.33 / 0.5 * w0 * w0;
    struct v2v_psf_file psf;
    (void)state;
    optics.beam_radius = 0.4;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t z = 0; z < 9; z++) {
        const double depth = (double)(z - 4) * 4.0;
        const double expected = w0 * sqrt(1 + pow(depth / range, 2));
        double light = 0, moment = 0;
        for (int64_t i = 0; i < 201 * 201; i++) {
            const double y = (double)(i / 201 - 100) * 0.25, x = (double)(i % 201 - 100) * 0.25;
            light += slice_of(&psf, 0, z)[i];
            moment += slice_of(&psf, 0, z)[i] * (y * y + x * x);
        }
        assert_true(fabs(sqrt(2 * moment / light) / expected - 1) <= 0.01);
    }
    v2v_psf_file_fini(&psf);
}

/* Reciprocity: what a tilted beam without aberration is above its focus it is below, turned by 180
 * degrees. Floats: 1e-4 of the peak. */
static void depth_mirrors_a_tilted_beam(void **state)
{
    struct v2v_optics_settings optics = wide_field();
    struct v2v_psf_file psf;
    (void)state;
    strcpy(optics.tilts, "0.5 -0.3");
    optics.numerical_aperture = 0.6;
    optics.size = 101;
    optics.photons = 2;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    const double peak = slice_of(&psf, 0, 4)[50 * 101 + 50];
    for (int64_t z = 0; z < 4; z++) {
        for (int64_t i = 0; i < 101 * 101; i++) {
            const double above = slice_of(&psf, 0, z)[i];
            const double below = slice_of(&psf, 0, 8 - z)[101 * 101 - 1 - i];
            assert_true(fabs(above - below) <= 1e-4 * peak);
        }
    }
    v2v_psf_file_fini(&psf);
}

/* Samples as fine as the band asks for are enough: twice as fine ones pass through them. The same
 * grid's width, so the same pupil to the rounding of its size. */
static void finer_samples_change_nothing(void **state)
{
    struct v2v_optics_settings optics = wide_field(), fine = wide_field();
    struct v2v_psf_file psf, finer;
    (void)state;
    optics.size = 65;
    fine.size = 129;
    fine.pixel_size_um = 0.125;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    assert_ok(v2v_psf_simulate(&finer, &fine));
    const double peak = slice_of(&psf, 0, 4)[32 * 65 + 32];
    for (int64_t i = 0; i < 65 * 65; i++) {
        const double same = slice_of(&finer, 0, 3)[i / 65 * 2 * 129 + i % 65 * 2];
        assert_true(fabs(slice_of(&psf, 0, 3)[i] - same) <= 0.01 * peak);
    }
    v2v_psf_file_fini(&finer);
    v2v_psf_file_fini(&psf);
}

/* Noll's fourth polynomial is a defocus: sqrt(3) 2 rho^2 waves against z (k - sqrt(k^2 - f^2)). */
static void defocus_polynomial_moves_the_focus(void **state)
{
    struct v2v_optics_settings optics = wide_field();
    const double k = 1.33 / 0.5, edge = 0.2 / 0.5;
    const double waves = 8.0 * (k - sqrt(k * k - edge * edge)) / (2 * sqrt(3));
    struct v2v_psf_file psf, moved;
    (void)state;
    optics.size = 65;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    snprintf(optics.zernike, sizeof optics.zernike, "4:%.6f", waves);
    assert_ok(v2v_psf_simulate(&moved, &optics));
    const double peak = slice_of(&psf, 0, 4)[32 * 65 + 32];
    for (int64_t z = 2; z < 9; z++) {
        for (int64_t i = 0; i < 65 * 65; i++) {
            const double difference = slice_of(&moved, 0, z)[i] - slice_of(&psf, 0, z - 2)[i];
            assert_true(fabs(difference) <= 0.01 * peak);
        }
    }
    v2v_psf_file_fini(&moved);
    v2v_psf_file_fini(&psf);
}

/* Two indices: the paraxial focus lies depth * (k / k' - 1) deeper, here two slices. What is left
 * is spherical aberration of 0.004 waves at the edge. */
static void index_mismatch_moves_the_focus(void **state)
{
    struct v2v_optics_settings optics = wide_field();
    struct v2v_psf_file psf, moved;
    (void)state;
    optics.size = 65;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    optics.immersion_index = 1.0;
    optics.depth_um = 8.0 / (1.33 / 1.0 - 1);
    assert_ok(v2v_psf_simulate(&moved, &optics));
    const double peak = slice_of(&psf, 0, 4)[32 * 65 + 32];
    assert_true(fabs(slice_of(&moved, 0, 6)[32 * 65 + 32] / peak - 1) <= 0.01);
    assert_true(slice_of(&moved, 0, 4)[32 * 65 + 32] < 0.9 * peak);
    v2v_psf_file_fini(&moved);
    optics.immersion_index = 1.33;
    assert_ok(v2v_psf_simulate(&moved, &optics));
    for (int64_t i = 0; i < 9 * 65 * 65; i++) {
        assert_true(fabs((double)moved.data[i] - psf.data[i]) <= 1e-6 * peak); /* float */
    }
    v2v_psf_file_fini(&moved);
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(light_of_a_slice_does_not_depend_on_depth),
        cmocka_unit_test(focus_is_the_airy_pattern),
        cmocka_unit_test(axis_is_sinc_squared),
        cmocka_unit_test(gaussian_beam_widens_as_it_should),
        cmocka_unit_test(depth_mirrors_a_tilted_beam),
        cmocka_unit_test(finer_samples_change_nothing),
        cmocka_unit_test(defocus_polynomial_moves_the_focus),
        cmocka_unit_test(index_mismatch_moves_the_focus),
    };
    return cmocka_run_group_tests_name("optics.beam", tests, NULL, NULL);
}
