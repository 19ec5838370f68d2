/* Noise of photons: decided once for a recording, or told by the camera. */
#include "method/photons.h"
#include "small_optics.h"

#include "v2v3d/base/random.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { SIDE = 40, PIXELS = SIDE * SIDE, SAMPLES = VIEWS * PIXELS };

static struct v2v_config config;
static struct v2v_psf_file psf;
static const struct v2v_estimator_ops *tv;
static float views[SAMPLES], scratch[SAMPLES];

static int setup(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    psf = small_psf();
    assert_ok(v2v_estimator_find(&tv, "tv"));
    return 0;
}

static int drop(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

/* Light `least` .. 4 of photons of so many counts each (0: none), and `read` beside it. */
static void make_light(double least, double photon, double read)
{
    for (int64_t i = 0; i < SAMPLES; i++) {
        const uint64_t at = (uint64_t)i;
        const double light = least + (4.0 - least) * (double)(i % SIDE) / SIDE;
        const double made =
            photon > 0.0 ? photon * (double)v2v_random_poisson(61, 0, at, light / photon) : light;
        views[i] = (float)(made + read * v2v_random_normal(61, 1, at));
    }
}

static void make_views(double photon, double read)
{
    make_light(0.0, photon, read);
}

static struct v2v_problem problem_of(void)
{
    return (struct v2v_problem){.config = &config, .psf = &psf, .height = SIDE, .width = SIDE};
}

static struct v2v_photons find(void)
{
    const struct v2v_camera camera = v2v_camera_of(&config);
    return v2v_photons_find(scratch, views, VIEWS, SIDE, SIDE, &camera);
}

static void assert_settles(int noise)
{
    static const char *const methods[] = {"tv", "unrolled"};
    const struct v2v_problem problem = problem_of();
    for (int m = 0; m < 2; m++) {
        const struct v2v_estimator_ops *ops = NULL;
        assert_ok(v2v_estimator_find(&ops, methods[m]));
        config.deconv.noise = V2V_NOISE_MODEL_AUTO;
        config.recon.strength = (struct v2v_number){V2V_NUMBER_GIVEN, 0.5};
        assert_true(ops->is_open(&config));
        assert_ok(ops->settle(&config, &problem, views, NULL, NULL));
        assert_int_equal(config.deconv.noise, noise);
        assert_false(ops->is_open(&config));
    }
}

static void a_frame_settles_the_noise_of_those_after_it(void **state)
{
    (void)state;
    make_views(0.1, 0.0);
    assert_settles(V2V_NOISE_MODEL_POISSON);
    make_views(0.1, 0.6); /* too little of it */
    assert_settles(V2V_NOISE_MODEL_GAUSSIAN);
    memset(views, 0, sizeof views);
    assert_settles(V2V_NOISE_MODEL_GAUSSIAN);
}

/* 4000 samples or more tell photons. */
static void few_samples_are_not_clear(void **state)
{
    (void)state;
    const struct v2v_camera camera = v2v_camera_of(&config);
    make_views(0.1, 0.01);
    assert_false(v2v_photons_find(scratch, views, 2, SIDE, SIDE, &camera).is_clear);
    assert_true(v2v_photons_find(scratch, views, 3, SIDE, SIDE, &camera).is_clear);
}

/* The same frame by another model is another volume: it is the configuration that counts. */
static void what_was_settled_is_what_a_frame_is_weighed_by(void **state)
{
    (void)state;
    static float volume[3][SLICES * PIXELS];
    static const int models[] = {V2V_NOISE_MODEL_AUTO, V2V_NOISE_MODEL_GAUSSIAN,
                                 V2V_NOISE_MODEL_POISSON};
    make_views(0.1, 0.6);
    for (int m = 0; m < 3; m++) {
        struct v2v_estimator *estimator = NULL;
        float *to = volume[m];
        const struct v2v_problem problem = problem_of();
        config.deconv.noise = models[m];
        assert_ok(v2v_estimator_create(&estimator, tv, &problem, NULL));
        assert_ok(tv->run(estimator, &to, views, NULL));
        v2v_estimator_destroy(&estimator);
    }
    assert_memory_equal(volume[0], volume[1], sizeof volume[0]);
    assert_memory_not_equal(volume[1], volume[2], sizeof volume[0]);
}

static struct v2v_noise_line line_of_views(void)
{
    return v2v_noise_line_of_images(views, VIEWS, SIDE, SIDE, find().bright);
}

/* The narrower the range of the light, the less is known of how the noise grows with it: of 2 to 4
 * the slope is six times its standard error, of 2.5 to 4 three to five times. */
static void five_standard_errors_are_photons(void **state)
{
    (void)state;
    static const struct {
        double least, errors[2];
        int is_clear;
    } cases[] = {{0.0, {20.0, 30.0}, 1}, {2.0, {5.0, 7.0}, 1}, {2.5, {3.0, 5.0}, 0}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        make_light(cases[c].least, 0.1, 0.0);
        const struct v2v_noise_line line = line_of_views();
        const double errors = line.gain / line.gain_error;
        assert_true(errors > cases[c].errors[0] && errors < cases[c].errors[1]);
        assert_true(line.variance < 0.0 && line.colour < 1.1); /* by which all are clear */
        assert_int_equal(find().is_clear, cases[c].is_clear);
    }
}

/* Means of two samples, one below the other, and beside each other too. As a sum of squares, of
 * (1,-1) they leave 1/4, of (1,-2,1) 1/6: in each direction the colour is 3/2 of white noise's. */
static void coloured_noise_is_not_of_photons(void **state)
{
    (void)state;
    static const double colours[] = {1.0, 1.5, 2.25};
    for (int directions = 0; directions <= 2; directions++) {
        make_views(0.1, 0.0);
        for (int64_t i = 0; directions > 0 && i < SAMPLES; i++) {
            const int64_t below = i / SIDE % SIDE < SIDE - 1 ? SIDE : 0;
            const int64_t beside = directions == 2 && i % SIDE < SIDE - 1 ? 1 : 0;
            views[i] = 0.25f * (views[i] + views[i + beside] + views[i + below] +
                                views[i + below + beside]);
        }
        const struct v2v_noise_line line = line_of_views();
        assert_true(fabs(line.colour / colours[directions] - 1.0) < 0.05);
        assert_true(line.variance < 0.0 && line.gain > 20.0 * line.gain_error);
        assert_int_equal(find().is_clear, directions < 2);
    }
}

/* 10 electrons a count, 6 electrons of read noise: variance 0.1 level + 0.36, which by itself shows
 * too few photons. */
static void the_camera_replaces_the_estimate(void **state)
{
    (void)state;
    make_views(0.1, 0.6);
    const struct v2v_photons estimated = find();
    assert_false(estimated.is_clear);
    config.deconv.electrons_per_count = (struct v2v_number){V2V_NUMBER_GIVEN, 10.0};
    struct v2v_photons found = find();
    assert_true(found.is_clear && found.gain == 0.1 && found.variance == estimated.variance);
    config.deconv.read_noise = (struct v2v_number){V2V_NUMBER_GIVEN, 6.0};
    found = find();
    assert_true(found.is_clear && found.gain == 0.1 && found.bright == estimated.bright);
    assert_float_equal(found.variance, 0.36, 1e-12);
    assert_settles(V2V_NOISE_MODEL_POISSON);
    config.deconv.read_noise.value = 0.0;
    assert_true(find().variance == 0.0);
    memset(views, 0, sizeof views); /* the frames after it may have light */
    assert_settles(V2V_NOISE_MODEL_POISSON);
}

static void a_camera_that_cannot_be_meant_is_refused(void **state)
{
    (void)state;
    struct v2v_problem problem = problem_of();
    config.deconv.read_noise = (struct v2v_number){V2V_NUMBER_GIVEN, 3.0};
    assert_int_equal(v2v_camera_check(&problem), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "it wants deconv.electrons_per_count"));
    config.deconv.electrons_per_count = (struct v2v_number){V2V_NUMBER_GIVEN, 10.0};
    assert_ok(v2v_camera_check(&problem));
    config.recon.neighbours = 1;
    assert_int_equal(v2v_camera_check(&problem), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "recon.neighbours averages"));
    config.recon.neighbours = 0;
    config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN;
    assert_int_equal(v2v_camera_check(&problem), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "which deconv.noise gaussian leaves out"));
    config.deconv.noise = V2V_NOISE_MODEL_POISSON;
    assert_ok(v2v_camera_check(&problem));
    config.deconv.noise = V2V_NOISE_MODEL_AUTO;
    problem.skip = 0.02;
    assert_int_equal(tv->settle(&config, &problem, views, NULL, NULL), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "recon.skip averages"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_frame_settles_the_noise_of_those_after_it, setup, drop),
        cmocka_unit_test_setup_teardown(few_samples_are_not_clear, setup, drop),
        cmocka_unit_test_setup_teardown(what_was_settled_is_what_a_frame_is_weighed_by, setup,
                                        drop),
        cmocka_unit_test_setup_teardown(five_standard_errors_are_photons, setup, drop),
        cmocka_unit_test_setup_teardown(coloured_noise_is_not_of_photons, setup, drop),
        cmocka_unit_test_setup_teardown(the_camera_replaces_the_estimate, setup, drop),
        cmocka_unit_test_setup_teardown(a_camera_that_cannot_be_meant_is_refused, setup, drop),
    };
    return cmocka_run_group_tests_name("photons", tests, NULL, NULL);
}
