/* PSFs that are displaced, views that are distorted: against what they are by hand. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/calibration.h"

#include <math.h>
#include <string.h>

enum { PSF_VIEWS = 2, PSF_SLICES = 5, PSF_HEIGHT = 40, PSF_WIDTH = 43 };
static const double width_of_spot = 2.0; /* pixels: 3e-9 of its spectrum is beyond sampling */

static double spot(double y, double x)
{
    return exp(-(y * y + x * x) / (2.0 * width_of_spot * width_of_spot));
}

/* Spots that move by `parallax` pixels (y, x) a slice. */
static struct v2v_psf_file make_psf(double (*parallax)[2])
{
    struct v2v_psf_file psf = {
        .views = PSF_VIEWS, .slices = PSF_SLICES, .height = PSF_HEIGHT, .width = PSF_WIDTH};
    const int64_t pixels = PSF_HEIGHT * PSF_WIDTH;
    assert_ok(V2V_ALLOC(psf.data, "test", PSF_VIEWS * PSF_SLICES * pixels));
    for (int v = 0; v < PSF_VIEWS; v++) {
        for (int z = 0; z < PSF_SLICES; z++) {
            for (int64_t i = 0; i < pixels; i++) {
                psf.data[(v * PSF_SLICES + z) * pixels + i] =
                    (float)spot((double)(i / PSF_WIDTH - 19) - parallax[v][0] * (z - 2),
                                (double)(i % PSF_WIDTH - 21) - parallax[v][1] * (z - 2));
            }
        }
    }
    return psf;
}

static void kernels_go_where_they_are_told(void **state)
{
    (void)state;
    double parallax[PSF_VIEWS][2] = {{0.5, -0.25}, {0.0, 0.75}};
    struct v2v_psf_file psf = make_psf(parallax);
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, PSF_VIEWS, 64, 64));
    c.view[0] =
        (struct v2v_view_calibration){.gain = 1.25, .shift = {3.3, -1.7}, .slope = {0.8, -0.8}};
    c.view[1].gain = 0.5;
    assert_ok(v2v_calibration_apply_to_psf(&psf, &c));
    /* ceil(3.3 + 0.8) and two pixels on every side; centres stay centres */
    assert_int_equal(psf.height, PSF_HEIGHT + 14);
    assert_int_equal(psf.width, PSF_WIDTH + 14);
    for (int v = 0; v < PSF_VIEWS; v++) {
        for (int z = 0; z < PSF_SLICES; z++) {
            double worst = 0.0;
            const double depth = (z - 2) / 2.0, *const a = parallax[v];
            const struct v2v_view_calibration *view = &c.view[v];
            for (int64_t i = 0; i < psf.height * psf.width; i++) {
                const double dy = (double)(i / psf.width - 26) - a[0] * (z - 2) - view->shift[0] -
                                  view->slope[0] * depth;
                const double dx = (double)(i % psf.width - 28) - a[1] * (z - 2) - view->shift[1] -
                                  view->slope[1] * depth;
                const double got =
                    (double)psf.data[(v * PSF_SLICES + z) * psf.height * psf.width + i];
                worst = fmax(worst, fabs(got - view->gain * spot(dy, dx)));
            }
            /* two transforms of 60 x 60 numbers at most, of length 1.25 * 2 sqrt(pi) */
            assert_true(worst < 2.0 * 6e-8 * log2(60.0 * 60.0) * 4.5);
        }
    }
    v2v_calibration_fini(&c);
    v2v_psf_file_fini(&psf);
}

static void gains_alone_leave_the_window(void **state)
{
    (void)state;
    double parallax[PSF_VIEWS][2] = {{0.0}};
    struct v2v_psf_file psf = make_psf(parallax), as_was = make_psf(parallax);
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, PSF_VIEWS, 64, 64));
    c.view[1].gain = 0.25;
    assert_ok(v2v_calibration_apply_to_psf(&psf, &c));
    assert_int_equal(psf.height, PSF_HEIGHT);
    const int64_t one_view = PSF_SLICES * PSF_HEIGHT * PSF_WIDTH;
    for (int64_t i = 0; i < 2 * one_view; i++) {
        assert_true(psf.data[i] == (i < one_view ? 1.0f : 0.25f) * as_was.data[i]);
    }
    c.views = 1; /* of other PSFs */
    assert_int_equal(v2v_calibration_apply_to_psf(&psf, &c), V2V_E_INPUT);
    v2v_calibration_fini(&c);
    v2v_psf_file_fini(&as_was);
    v2v_psf_file_fini(&psf);
}

static void parallax_is_how_centroids_move(void **state)
{
    (void)state;
    double parallax[PSF_VIEWS][2] = {{0.5, -0.25}, {0.0, 0.75}}, got[PSF_VIEWS][2];
    struct v2v_psf_file psf = make_psf(parallax);
    v2v_psf_parallax(got, &psf);
    for (int v = 0; v < PSF_VIEWS; v++) {
        for (int axis = 0; axis < 2; axis++) { /* spots are sampled beyond any doubt */
            assert_true(fabs(got[v][axis] - parallax[v][axis]) < 1e-5);
        }
    }
    v2v_psf_file_fini(&psf);
}

static void distortion_is_undone(void **state)
{
    (void)state;
    enum { SIDE = 96, EDGE = 28 };
    /* in the margins fields don't change: there are kinks where those begin */
    static float views[SIDE * SIDE], seen[SIDE * SIDE], back[SIDE * SIDE], scratch[2 * SIDE * SIDE];
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, 1, SIDE, SIDE));
    c.view[0] = (struct v2v_view_calibration){.gain = 1.0,
                                              .distortion_y = {0.9, -0.6, 0.3, 0.4, -0.2},
                                              .distortion_x = {-0.5, 0.7, -0.3, 0.2, 0.4},
                                              .shading = {0.2, -0.3, 0.1, 0.05, -0.1}};
    for (int i = 0; i < SIDE * SIDE; i++) {
        views[i] = (float)(1.0 + 0.5 * sin(0.2 * (i / SIDE)) * cos(0.15 * (i % SIDE)));
    }
    memcpy(seen, views, sizeof seen);
    v2v_calibration_distort(seen, scratch, &c, SIDE, SIDE);
    v2v_calibration_undistort(back, seen, scratch, &c);
    double changed = 0.0, left = 0.0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int y = i / SIDE, x = i % SIDE;
        if (y >= EDGE && y < SIDE - EDGE && x >= EDGE && x < SIDE - EDGE) {
            changed = fmax(changed, fabs((double)seen[i] - (double)views[i]));
            left = fmax(left, fabs((double)back[i] - (double)views[i]));
        }
    }
    /* Cubic convolution misses a 62nd of the third derivative: |t - 3 t t + 2 t t t| / 6 at most.
     * Here that is 0.5 (0.2^3 + 0.15^3), times the shading's e^0.9, and 2 for what shading and
     * fields add to it; two images are resampled. Places are found to a change of 0.001 pixels. */
    const double bend = 0.5 * (0.2 * 0.2 * 0.2 + 0.15 * 0.15 * 0.15) * 2.0 * exp(0.9);
    print_message("changed by %.3g, left %.3g, bound %.3g\n", changed, left,
                  2.0 * bend / 62.0 + 0.001 * 0.175);
    assert_true(changed > 0.2);
    assert_true(left < 2.0 * bend / 62.0 + 0.001 * 0.175);
    v2v_calibration_fini(&c);
}

/* <D x, y> = <x, D^T y> for views of noise, whose fields push pixels over every edge. */
static void transpose_of_distortion_is_its_transpose(void **state)
{
    (void)state;
    enum { VIEWS = 2, HEIGHT = 61, WIDTH = 70, COUNT = VIEWS * HEIGHT * WIDTH };
    static float x[COUNT], y[COUNT], distorted[COUNT], back[COUNT], scratch[HEIGHT * WIDTH];
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, VIEWS, HEIGHT, WIDTH));
    c.view[0] = (struct v2v_view_calibration){.gain = 1.0,
                                              .distortion_y = {2.9, -0.6, 0.3, 1.4, -0.2},
                                              .distortion_x = {-2.5, 0.7, -1.3, 0.2, 0.4},
                                              .shading = {0.2, -0.3, 0.1, 0.05, -0.1}};
    c.view[1] = (struct v2v_view_calibration){.gain = 1.0, .shading = {-0.4, 0.1}};
    for (int i = 0; i < COUNT; i++) {
        x[i] = distorted[i] = (float)v2v_random_normal(1, 1, (uint64_t)i);
        y[i] = back[i] = (float)v2v_random_normal(1, 2, (uint64_t)i);
    }
    v2v_calibration_distort(distorted, scratch, &c, HEIGHT, WIDTH);
    v2v_calibration_distort_transpose(back, scratch, &c, HEIGHT, WIDTH);
    double forth = 0.0, of_back = 0.0, length = 0.0;
    for (int i = 0; i < COUNT; i++) {
        forth += (double)distorted[i] * (double)y[i];
        of_back += (double)x[i] * (double)back[i];
        length += (double)distorted[i] * (double)distorted[i];
    }
    /* float32 rounds each product by 6e-8; their sum is as long as a random walk of them. */
    print_message("%.9g and %.9g, of %.3g\n", forth, of_back, length);
    assert_true(fabs(forth - of_back) < 1e-6 * length);
    assert_true(fabs(forth) > 1e-3 * sqrt(length));
    v2v_calibration_fini(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(kernels_go_where_they_are_told),
        cmocka_unit_test(gains_alone_leave_the_window),
        cmocka_unit_test(parallax_is_how_centroids_move),
        cmocka_unit_test(distortion_is_undone),
        cmocka_unit_test(transpose_of_distortion_is_its_transpose),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
