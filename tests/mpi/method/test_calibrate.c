/* A microscope whose views are out of register is put right, by any number of ranks alike. */
#include "method/calibrator.h"
#include "method/refinement.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/calibrate.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 8, SLICES = 5, KERNEL = 13 };
enum {
    HEIGHT = 232,
    WIDTH = 104,
    PIXELS = HEIGHT * WIDTH
}; /* higher than what is looked at first */

/* Views from all sides, one pixel a slice. */
static struct v2v_psf_file make_psf(void)
{
    struct v2v_psf_file psf = {.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    const int64_t count = VIEWS * SLICES * KERNEL * KERNEL;
    assert_ok(V2V_ALLOC(psf.data, "test", count));
    for (int64_t i = 0; i < count; i++) {
        const int64_t x = i % KERNEL, y = i / KERNEL % KERNEL, z = i / (KERNEL * KERNEL) % SLICES;
        const double angle = 2.0 * acos(-1.0) * (double)(i / (SLICES * KERNEL * KERNEL)) / VIEWS;
        const double depth = (double)(z - SLICES / 2);
        const double dy = (double)(y - KERNEL / 2) - depth * sin(angle);
        const double dx = (double)(x - KERNEL / 2) - depth * cos(angle);
        psf.data[i] = (float)exp(-0.5 * (dy * dy + dx * dx));
    }
    v2v_psf_normalize_views(&psf);
    return psf;
}

/* Views of bright points through PSFs that are not those that are told. */
static void show(float *views, const struct v2v_calibration *truth, double noise, uint64_t seed)
{
    struct v2v_psf_file psf = make_psf();
    struct v2v_projector *projector = NULL;
    static float volume[SLICES * PIXELS];
    const int64_t pixels = truth->height * truth->width;
    for (int64_t i = 0; i < SLICES * pixels; i++) {
        volume[i] = v2v_random_below(seed, 0, (uint64_t)i, 150) == 0
                        ? (float)(1 + v2v_random_uniform(seed, 1, (uint64_t)i))
                        : 0.0f;
    }
    assert_ok(v2v_calibration_apply_to_psf(&psf, truth));
    assert_ok(v2v_projector_create(&projector, &psf, truth->height, truth->width, V2V_SPLIT_SLICES,
                                   NULL));
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    for (int64_t i = 0; i < VIEWS * pixels; i++) {
        views[i] += (float)(noise * v2v_random_normal(seed, 2, (uint64_t)i));
    }
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
}

/* Shifts of up to two pixels and gains of 0.78 to 1.28, with nothing that all views share or that
 * is the volume's shift in depth. */
static void draw(struct v2v_calibration *truth, const struct v2v_psf_file *psf)
{
    double parallax[VIEWS][2], product = 0.0, squares = 0.0;
    v2v_psf_parallax(parallax, psf);
    for (int v = 0; v < VIEWS; v++) { /* opposite views: shifts and logarithms of gains cancel */
        const int sign = v < VIEWS / 2 ? 1 : -1;
        truth->view[v].gain = exp(sign * (0.25 - 0.1 * (v % (VIEWS / 2))));
        for (int axis = 0; axis < 2; axis++) {
            truth->view[v].shift[axis] =
                4.0 * sign * (v2v_random_uniform(3, 7, (uint64_t)(2 * (v % 4) + axis)) - 0.5);
            product += truth->view[v].shift[axis] * parallax[v][axis];
            squares += parallax[v][axis] * parallax[v][axis];
        }
    }
    for (int i = 0; i < 2 * VIEWS; i++) { /* nothing that is the volume's shift in depth */
        truth->view[i / 2].shift[i % 2] -= product / squares * parallax[i / 2][i % 2];
    }
}

/* Shifts within so many pixels, gains within this part. */
static void assert_found(const struct v2v_calibration *found, const struct v2v_calibration *truth,
                         double pixels, double part)
{
    for (int v = 0; v < VIEWS; v++) {
        const struct v2v_view_calibration *is = &found->view[v], *was = &truth->view[v];
        for (int axis = 0; axis < 2; axis++) {
            if (!(fabs(is->shift[axis] - was->shift[axis]) < pixels)) {
                fail_msg("view %d axis %d: shift %g, not %g", v, axis, is->shift[axis],
                         was->shift[axis]);
            }
        }
        if (!(fabs(is->gain / was->gain - 1.0) < part)) {
            fail_msg("view %d: gain %g, not %g", v, is->gain, was->gain);
        }
    }
}

static void views_come_back_into_register(void **state)
{
    (void)state;
    static float views[VIEWS * PIXELS];
    struct v2v_psf_file psf = make_psf();
    struct v2v_config config;
    struct v2v_calibration truth, found, alone;
    struct v2v_calibration_report report, report_alone;
    v2v_config_defaults(&config);
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_calibration_init(&truth, VIEWS, HEIGHT, WIDTH));
    draw(&truth, &psf);
    show(views, &truth, 0.002, 3);
    assert_ok(v2v_calibrate(&found, &report, &problem, views, test_world()));
    assert_true(report.frame_after < 0.5 * report.frame_before);
    assert_false(report.has_slopes);
    assert_false(report.has_fields);
    assert_found(&found, &truth, 0.02, 0.003); /* 0.0073; 0.25 %, with their bias 0.33 */
    assert_ok(v2v_calibrate(&alone, &report_alone, &problem, views, NULL));
    assert_memory_equal(alone.view, found.view, VIEWS * sizeof *alone.view);
    assert_true(report.frame_after == report_alone.frame_after);
    v2v_calibration_fini(&alone);
    v2v_calibration_fini(&found);
    v2v_calibration_fini(&truth);
    v2v_psf_file_fini(&psf);
}

/* A square frame. */
struct small {
    struct v2v_psf_file psf;
    struct v2v_config config;
    struct v2v_problem problem;
    struct v2v_calibration truth, found;
    struct v2v_calibration_report report;
};

static void small_init(struct small *small, int64_t side)
{
    *small = (struct small){.psf = make_psf()};
    v2v_config_defaults(&small->config);
    small->problem = (struct v2v_problem){
        .config = &small->config, .psf = &small->psf, .height = side, .width = side};
    assert_ok(v2v_calibration_init(&small->truth, VIEWS, side, side));
}

static void small_fini(struct small *small)
{
    v2v_calibration_fini(&small->found);
    v2v_calibration_fini(&small->truth);
    v2v_psf_file_fini(&small->psf);
}

/* Rounds by all views, which are mixed with none before. */
static void refine(struct v2v_calibration *found, const struct v2v_psf_file *psf,
                   const float *views, int has_shifts)
{
    double parallax[VIEWS][2];
    struct v2v_config config;
    v2v_config_defaults(&config);
    config.deconv.stop = V2V_STOP_FIXED;
    config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, 0.2};
    config.deconv.curvature = 0.5;
    const struct v2v_problem problem = {
        .config = &config, .psf = psf, .height = HEIGHT, .width = WIDTH};
    struct v2v_calibrator calibrator = {
        .problem = &problem, .comm = test_world(), .views = views, .calibration = found};
    v2v_psf_parallax(parallax, psf);
    v2v_registration_fix_modes(found, parallax);
    assert_ok(v2v_calibrator_init(&calibrator));
    v2v_calibrator_go(&calibrator, 0);
    for (int round = 0; round < 6; round++) {
        assert_ok(v2v_refinement_step(&calibrator, has_shifts));
        v2v_registration_fix_modes(found, parallax);
    }
    v2v_calibrator_fini(&calibrator);
}

/* Gains from 1, shifts from up to 0.4 pixels off, by rounds alone. */
static void check_refinement(int has_shifts, double pixels)
{
    static float views[VIEWS * PIXELS];
    struct v2v_psf_file psf = make_psf();
    struct v2v_calibration truth, found;
    assert_ok(v2v_calibration_init(&truth, VIEWS, HEIGHT, WIDTH));
    assert_ok(v2v_calibration_init(&found, VIEWS, HEIGHT, WIDTH));
    draw(&truth, &psf);
    show(views, &truth, 0.002, 5);
    draw(&found, &psf);
    for (int v = 0; v < VIEWS; v++) {
        found.view[v].gain = 1.0;
        for (int axis = 0; axis < (has_shifts ? 2 : 0); axis++) {
            const double off = v2v_random_uniform(4, 2, (uint64_t)(2 * v + axis)) - 0.5;
            found.view[v].shift[axis] += 0.8 * off;
        }
    }
    refine(&found, &psf, views, has_shifts);
    assert_found(&found, &truth, pixels, 0.005);
    v2v_calibration_fini(&found);
    v2v_calibration_fini(&truth);
    v2v_psf_file_fini(&psf);
}

static void gains_and_shifts_are_refined(void **state)
{
    (void)state;
    check_refinement(1, 0.01); /* 0.0054; 0.41 % */
}

/* Shifts stay as they are. */
static void gains_alone_are_refined(void **state)
{
    (void)state;
    check_refinement(0, 1e-12);
}

/* Round views, two thirds of a frame, come back as whole ones do. */
static void round_views_come_back_into_register(void **state)
{
    (void)state;
    enum { SIDE = 112, RADIUS = 51 };
    static float views[VIEWS * SIDE * SIDE];
    struct small small;
    small_init(&small, SIDE);
    draw(&small.truth, &small.psf);
    show(views, &small.truth, 0.002, 3);
    for (int64_t i = 0; i < VIEWS * SIDE * SIDE; i++) {
        const double y = (double)(i / SIDE % SIDE) - 55.5, x = (double)(i % SIDE) - 55.5;
        views[i] = y * y + x * x > RADIUS * RADIUS ? V2V_BLIND : views[i];
    }
    assert_ok(v2v_calibrate(&small.found, &small.report, &small.problem, views, test_world()));
    assert_true(small.report.frame_after < 0.5 * small.report.frame_before);
    assert_int_equal(small.report.odd_view, -1);
    assert_found(&small.found, &small.truth, 0.02, 0.007); /* 0.54 %: no bias is told */
    small_fini(&small);
}

/* What noise lets many numbers take of few pixels is no reason for fields. */
static void small_noisy_views_in_register_stay(void **state)
{
    (void)state;
    enum { SIDE = 96 };
    static float views[VIEWS * SIDE * SIDE];
    struct small small;
    small_init(&small, SIDE);
    show(views, &small.truth, 0.01, 0);
    assert_ok(v2v_calibrate(&small.found, &small.report, &small.problem, views, test_world()));
    assert_false(small.report.has_fields);
    assert_true(small.report.is_in_vain);
    small_fini(&small);
}

/* Gains of 1:9 lower the residual by half, which is no reason for shifts that noise made. */
static void unlike_views_in_register_have_gains_alone(void **state)
{
    (void)state;
    enum { SIDE = 112, EDGE = 24 };
    static const double noise = 0.01, certain = 5.0, bias = 0.01;
    static float views[VIEWS * SIDE * SIDE], clean[VIEWS * SIDE * SIDE];
    struct small small;
    small_init(&small, SIDE);
    for (int v = 0; v < VIEWS; v++) {
        small.truth.view[v].gain = pow(9.0, (double)(v * 5 % VIEWS) / (VIEWS - 1) - 0.5);
    }
    show(clean, &small.truth, 0.0, 0);
    show(views, &small.truth, noise, 0);
    assert_ok(v2v_calibrate(&small.found, &small.report, &small.problem, views, test_world()));
    assert_true(small.report.is_gains_alone);
    assert_false(small.report.is_in_vain || small.report.has_slopes || small.report.has_fields);
    assert_int_equal(small.report.odd_view, -1);
    assert_true(small.report.frame_after < 0.5 * small.report.frame_before);
    for (int v = 0; v < VIEWS; v++) {
        const struct v2v_view_calibration *found = &small.found.view[v];
        double squares = 0.0;
        for (int64_t y = EDGE; y < SIDE - EDGE; y++) {
            for (int64_t x = EDGE; x < SIDE - EDGE; x++) {
                squares += pow((double)clean[(v * SIDE + y) * SIDE + x], 2.0);
            }
        }
        assert_true(found->shift[0] == 0.0 && found->shift[1] == 0.0);
        /* what noise lets least squares with the true view err by, and the bar of all gains */
        const double bar = certain * noise / sqrt(squares) + bias, gain = small.truth.view[v].gain;
        if (!(fabs(found->gain / gain - 1.0) < bar)) {
            fail_msg("view %d: gain %g, not %g within %g", v, found->gain, gain, bar);
        }
    }
    small_fini(&small);
}

static void a_view_of_something_else_is_found(void **state)
{
    (void)state;
    enum { SIDE = 96, ODD = 5 };
    static float views[VIEWS * SIDE * SIDE], others[VIEWS * SIDE * SIDE];
    struct small small;
    small_init(&small, SIDE);
    show(views, &small.truth, 0.01, 3);
    show(others, &small.truth, 0.01, 4);
    memcpy(views + ODD * SIDE * SIDE, others + ODD * SIDE * SIDE, SIDE * SIDE * sizeof *views);
    assert_ok(v2v_calibrate(&small.found, &small.report, &small.problem, views, test_world()));
    assert_int_equal(small.report.odd_view, ODD);
    small_fini(&small);
}

static void two_views_cannot_be_compared(void **state)
{
    (void)state;
    static const float views[PIXELS];
    struct v2v_psf_file psf = make_psf();
    struct v2v_config config;
    struct v2v_calibration found;
    struct v2v_calibration_report report;
    v2v_config_defaults(&config);
    psf.views = 2;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_int_equal(v2v_calibrate(&found, &report, &problem, views, test_world()), V2V_E_INPUT);
    v2v_psf_file_fini(&psf);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gains_and_shifts_are_refined),
        cmocka_unit_test(gains_alone_are_refined),
        cmocka_unit_test(views_come_back_into_register),
        cmocka_unit_test(round_views_come_back_into_register),
        cmocka_unit_test(small_noisy_views_in_register_stay),
        cmocka_unit_test(unlike_views_in_register_have_gains_alone),
        cmocka_unit_test(a_view_of_something_else_is_found),
        cmocka_unit_test(two_views_cannot_be_compared),
    };
    return test_mpi_main(tests, argc, argv);
}
