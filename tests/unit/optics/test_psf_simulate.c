#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <omp.h>

static struct v2v_optics_settings small_optics(void)
{
    return (struct v2v_optics_settings){.rings = 2,
                                        .views_per_ring = 4,
                                        .numerical_aperture = 0.85,
                                        .needle_aperture = 0.25,
                                        .refractive_index = 1.33,
                                        .photons = 2,
                                        .wavelength_um = 0.92,
                                        .pixel_size_um = 0.5,
                                        .slice_spacing_um = 1.0,
                                        .slices = 9,
                                        .size = 41};
}

static const float *slice_of(const struct v2v_psf_file *psf, int64_t v, int64_t z)
{
    return psf->data + (v * psf->slices + z) * psf->height * psf->width;
}

static void centroid_of(double *cy, double *cx, const struct v2v_psf_file *psf, int64_t v,
                        int64_t z)
{
    const float *slice = slice_of(psf, v, z);
    const double centre = (double)((psf->height + 1) / 2 - 1);
    double energy = 0, moment_y = 0, moment_x = 0;
    for (int64_t y = 0; y < psf->height; y++) {
        for (int64_t x = 0; x < psf->width; x++) {
            const double value = slice[y * psf->width + x];
            energy += value;
            moment_y += value * ((double)y - centre);
            moment_x += value * ((double)x - centre);
        }
    }
    *cy = moment_y / energy;
    *cx = moment_x / energy;
}

static void every_view_sums_to_one(void **state)
{
    const struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    assert_int_equal(psf.views, 9);
    assert_int_equal(psf.slices, 9);
    assert_int_equal(psf.height, 41);
    assert_int_equal(psf.width, 41);
    assert_true(psf.pixel_size_um == 0.5 && psf.slice_spacing_um == 1.0);
    for (int64_t v = 0; v < psf.views; v++) {
        double sum = 0;
        for (int64_t i = 0; i < psf.slices * 41 * 41; i++) {
            assert_true(slice_of(&psf, v, 0)[i] >= 0);
            sum += slice_of(&psf, v, 0)[i];
        }
        assert_true(fabs(sum - 1) <= 1e-6); /* each value is rounded once, 6e-8 */
    }
    v2v_psf_file_fini(&psf);
}

static void every_slice_sums_to_one_if_asked(void **state)
{
    struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    optics.normalize = V2V_OPTICS_NORMALIZE_SLICE;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t i = 0; i < psf.views * psf.slices; i++) {
        double sum = 0;
        for (int64_t p = 0; p < 41 * 41; p++) {
            sum += psf.data[i * 41 * 41 + p];
        }
        assert_true(fabs(sum - 1) <= 1e-6);
    }
    v2v_psf_file_fini(&psf);
}

/* A beam tilted by theta, sin(theta) = tilt aperture / refractive index, walks z * tan(theta). */
static void tilted_views_walk_as_the_tangent_of_their_angle(void **state)
{
    static const double direction[4][2] = {{0, 1}, {1, 0}, {0, -1}, {-1, 0}}; /* y, x */
    const struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t v = 1; v < psf.views; v++) {
        const int64_t ring = (v - 1) / 4 + 1;
        const double sine = (0.85 - 0.25) * (double)ring / 2 / 1.33;
        const double slope = sine / sqrt(1 - sine * sine);
        for (int64_t z = 0; z < psf.slices; z++) {
            double cy = 0, cx = 0;
            const double walk = (double)(z - 4) * 1.0 * slope / 0.5; /* pixels */
            centroid_of(&cy, &cx, &psf, v, z);
            /* Half a pixel: the rays of one sub-aperture have other slopes than its middle's. */
            assert_true(fabs(cy - walk * direction[(v - 1) % 4][0]) <= 0.5);
            assert_true(fabs(cx - walk * direction[(v - 1) % 4][1]) <= 0.5);
        }
    }
    v2v_psf_file_fini(&psf);
}

/* Largest difference of two slices, the second one turned by 180 degrees about its centre pixel,
 * relative to the first one's maximum. */
static double turned_difference(const struct v2v_psf_file *psf, int64_t v, int64_t w, int64_t z)
{
    const float *a = slice_of(psf, v, z), *b = slice_of(psf, w, z);
    const int64_t last = psf->height * psf->width - 1;
    double difference = 0, peak = 0;
    for (int64_t i = 0; i <= last; i++) {
        difference = fmax(difference, fabs((double)a[i] - b[last - i]));
        peak = fmax(peak, a[i]);
    }
    return difference / peak;
}

/* The field is summed in float over about 2^10 pupil samples (10 roundings of 6e-8), the intensity
 * squared quadruples that: 2.4e-6. */
#define FIELD_ERROR 2.4e-6

static void opposite_azimuths_are_turned_by_180_degrees(void **state)
{
    const struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t ring = 0; ring < 2; ring++) {
        for (int64_t around = 0; around < 2; around++) {
            const int64_t v = 1 + ring * 4 + around;
            for (int64_t z = 0; z < psf.slices; z++) {
                assert_true(turned_difference(&psf, v, v + 2, z) <= FIELD_ERROR);
            }
        }
    }
    v2v_psf_file_fini(&psf);
}

static void untilted_view_is_symmetric(void **state)
{
    const struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t z = 0; z < psf.slices; z++) {
        const float *slice = slice_of(&psf, 0, z), *mirrored = slice_of(&psf, 0, 8 - z);
        const double peak = slice[20 * 41 + 20];
        assert_true(turned_difference(&psf, 0, 0, z) <= FIELD_ERROR);
        for (int64_t y = 0; y < 41; y++) {
            for (int64_t x = 0; x < 41; x++) {
                const double value = slice[y * 41 + x];
                assert_true(value <= peak);
                assert_true(fabs(value - slice[x * 41 + y]) <= FIELD_ERROR * peak);
                assert_true(fabs(value - slice[y * 41 + 40 - x]) <= FIELD_ERROR * peak);
                assert_true(fabs(value - mirrored[y * 41 + x]) <= FIELD_ERROR * peak);
            }
        }
    }
    v2v_psf_file_fini(&psf);
}

/* In focus the field of a disk of radius r is J1(u)/u, u = 2 pi r rho: two-photon excitation is its
 * fourth power. Pixels of 50 nm, so that the mean over a pixel is close to its middle. */
static void focus_is_the_airy_pattern_to_the_fourth_power(void **state)
{
    struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    optics.rings = 0;
    optics.slices = 1;
    optics.pixel_size_um = 0.05;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    assert_int_equal(psf.views, 1);
    const double peak = psf.data[20 * 41 + 20];
    for (int64_t x = 1; x <= 20; x++) {
        const double u = 2 * 3.14159265358979323846 * 0.25 / 0.92 * 0.05 * (double)x;
        const double airy = pow(2 * j1(u) / u, 4);
        const double value = psf.data[20 * 41 + 20 + x] / peak;
        /* The disk is drawn with 4.3 frequency steps of radius and an edge one step wide, which
         * adds (1/4.3)^2 / 6 = 0.9 % to its mean square radius; at the steepest place the curve
         * falls by 1.2 times the relative width: 0.01. */
        assert_true(fabs(value - airy) <= 0.01);
    }
    v2v_psf_file_fini(&psf);
}

static void thread_count_does_not_change_the_simulated_bits(void **state)
{
    const struct v2v_optics_settings optics = small_optics();
    const int before = omp_get_max_threads();
    struct v2v_psf_file one, three;
    (void)state;
    omp_set_num_threads(1);
    assert_ok(v2v_psf_simulate(&one, &optics));
    omp_set_num_threads(3);
    assert_ok(v2v_psf_simulate(&three, &optics));
    omp_set_num_threads(before);
    assert_memory_equal(one.data, three.data, 9 * 9 * 41 * 41 * sizeof(float));
    v2v_psf_file_fini(&three);
    v2v_psf_file_fini(&one);
}

static void assert_refused(struct v2v_optics_settings optics, enum v2v_status expected)
{
    struct v2v_psf_file psf;
    const size_t held = v2v_mem_held();
    assert_int_equal(v2v_psf_simulate(&psf, &optics), expected);
    assert_null(psf.data);
    assert_int_equal(v2v_mem_held(), held);
}

static void impossible_optics_are_refused(void **state)
{
    struct v2v_optics_settings optics = small_optics();
    (void)state;
    optics.needle_aperture = 0.9; /* wider than the pupil */
    assert_refused(optics, V2V_E_CONFIG);
    optics = small_optics();
    optics.needle_aperture = 0;
    assert_refused(optics, V2V_E_CONFIG);
    optics = small_optics();
    optics.numerical_aperture = 1.33; /* light along the slice */
    assert_refused(optics, V2V_E_CONFIG);
    optics = small_optics();
    optics.shift = 21; /* beyond pixel 40 */
    assert_refused(optics, V2V_E_CONFIG);
    optics.shift = -21;
    assert_refused(optics, V2V_E_CONFIG);
    optics = small_optics();
    optics.pixel_size_um = 100; /* 41 pixels of 220 samples each */
    assert_refused(optics, V2V_E_CONFIG);
}

static void simulation_short_of_memory_is_refused(void **state)
{
    (void)state;
    v2v_mem_set_limit(v2v_mem_held() + 100000);
    assert_refused(small_optics(), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
}

/* Beyond what the immersion lets through nothing propagates, though the pupil's edge is soft. */
static void an_aperture_near_the_immersions_index_gives_finite_psfs(void **state)
{
    struct v2v_optics_settings optics = small_optics();
    struct v2v_psf_file psf;
    (void)state;
    optics.rings = 1;
    optics.numerical_aperture = 1.325;
    optics.needle_aperture = 0.3;
    optics.refractive_index = 1.45;
    optics.immersion_index = 1.33;
    optics.depth_um = 5;
    optics.pixel_size_um = 0.3;
    optics.size = 32;
    assert_ok(v2v_psf_simulate(&psf, &optics));
    for (int64_t i = 0; i < psf.views * psf.slices * psf.height * psf.width; i++) {
        assert_true(isfinite(psf.data[i]));
    }
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_view_sums_to_one),
        cmocka_unit_test(every_slice_sums_to_one_if_asked),
        cmocka_unit_test(tilted_views_walk_as_the_tangent_of_their_angle),
        cmocka_unit_test(opposite_azimuths_are_turned_by_180_degrees),
        cmocka_unit_test(untilted_view_is_symmetric),
        cmocka_unit_test(focus_is_the_airy_pattern_to_the_fourth_power),
        cmocka_unit_test(thread_count_does_not_change_the_simulated_bits),
        cmocka_unit_test(impossible_optics_are_refused),
        cmocka_unit_test(simulation_short_of_memory_is_refused),
        cmocka_unit_test(an_aperture_near_the_immersions_index_gives_finite_psfs),
    };
    return cmocka_run_group_tests_name("optics.psf_simulate", tests, NULL, NULL);
}
