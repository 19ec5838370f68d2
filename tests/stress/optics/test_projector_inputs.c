/* The projector and its adjoint on inputs of any size, against plain loops in double precision.
 *
 * A stage of a float32 transform rounds each complex number in at most four operations by at most
 * u = 2^-24 each, independently: 2 u in norm, so 2 u sqrt(log2(n)) for a transform of n numbers.
 * Three follow each other (kernel, frame, inverse), a product and a sum are four stages more; a
 * kernel h multiplies no frequency by more than its sum |h|: the view that slices x_z make errs by
 * 2 u sqrt(3 log2(n) + 4) sum_z |h_z| ||x_z||, and an adjoint's slice likewise over views.
 * Numbers below FLT_MIN are rounded to multiples of 2^-149: as many times that, at every pixel. */
#include "hard_input.h"
#include "support.h"
#include "twin_projector.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 3, SLICES = 5, KERNEL_HEIGHT = 9, KERNEL_WIDTH = 8, HEIGHT = 40, WIDTH = 36 };
enum {
    PIXELS = HEIGHT * WIDTH,
    TAPS = KERNEL_HEIGHT * KERNEL_WIDTH,
    HOT = PIXELS + 17 * WIDTH + 5
};

static struct v2v_psf_file psf;
static struct v2v_projector *projector;
static float views[VIEWS * PIXELS], volume[SLICES * PIXELS];
static double exact_views[VIEWS * PIXELS], exact_volume[SLICES * PIXELS];

static int setup(void **state)
{
    (void)state;
    psf = (struct v2v_psf_file){
        .views = VIEWS, .slices = SLICES, .height = KERNEL_HEIGHT, .width = KERNEL_WIDTH};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * TAPS));
    for (int64_t i = 0; i < VIEWS * SLICES * TAPS; i++) {
        psf.data[i] = (float)v2v_random_uniform(71, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

static double norm(const float *x, int64_t count)
{
    return sqrt(v2v_sum_of_squares(x, count));
}

static double kernel_sum(int64_t v, int64_t z)
{
    double sum = 0.0;
    for (int64_t i = 0; i < TAPS; i++) {
        sum += (double)psf.data[(v * SLICES + z) * TAPS + i];
    }
    return sum;
}

/* Of all views made from `volume`, or of the volume made from `views`. */
static double bound(int adjoint)
{
    int64_t outer = adjoint ? SLICES : VIEWS, inner = adjoint ? VIEWS : SLICES;
    double squares = 0.0;
    double stages = 3.0 * log2((double)((HEIGHT + KERNEL_HEIGHT) * (WIDTH + KERNEL_WIDTH))) + 4.0;
    for (int64_t o = 0; o < outer; o++) {
        double sum = 0.0;
        for (int64_t i = 0; i < inner; i++) {
            sum += adjoint ? kernel_sum(i, o) * norm(views + i * PIXELS, PIXELS)
                           : kernel_sum(o, i) * norm(volume + i * PIXELS, PIXELS);
        }
        squares += sum * sum;
    }
    return 2.0 * sqrt(stages) *
           (0x1p-24 * sqrt(squares) + 0x1p-149 * sqrt((double)(outer * PIXELS)));
}

static double largest(const float *x, int64_t count)
{
    double most = 0.0;
    for (int64_t i = 0; i < count; i++) {
        most = fmax(most, fabs((double)x[i]));
    }
    return most;
}

static double size_of(const double *x, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += x[i] * x[i];
    }
    return sqrt(sum);
}

/* |x - exact|; prints its share of the table's row. */
static void judge(const float *x, const double *exact, int64_t count, double allowed)
{
    double error = 0.0, size = size_of(exact, count);
    for (int64_t i = 0; i < count; i++) {
        double d = (double)x[i] - exact[i];
        error += d * d;
    }
    error = sqrt(error);
    print_message(" | %9.2e %9.1e %9.1e", largest(x, count), size > 0.0 ? error / size : error,
                  size > 0.0 ? allowed / size : allowed);
    assert_int_equal(v2v_first_not_finite(x, count), -1);
    assert_true(error <= allowed);
}

static void projections_and_adjoints_err_as_their_transforms_do(void **state)
{
    const struct twin_shape shape = {SLICES, KERNEL_HEIGHT, KERNEL_WIDTH, HEIGHT, WIDTH};
    (void)state;
    print_message("%-10s | %9s %9s %9s | %9s %9s %9s\n", "input", "largest", "views", "bound",
                  "largest", "adjoint", "bound");
    for (int which = 0; which < TEST_HARD_INPUTS; which++) {
        for (int64_t i = 0; i < SLICES * PIXELS; i++) {
            volume[i] = test_hard_sample(which, i, WIDTH, HOT);
            exact_volume[i] = (double)volume[i];
        }
        print_message("%-10s", test_hard_name(which));
        for (int64_t v = 0; v < VIEWS; v++) {
            twin_project(exact_views + v * PIXELS, exact_volume, psf.data + v * SLICES * TAPS,
                         &shape);
        }
        v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
        judge(views, exact_views, VIEWS * PIXELS, bound(0));

        memset(exact_volume, 0, sizeof exact_volume);
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            views[i] = test_hard_sample(which, i, WIDTH, HOT);
            exact_views[i] = (double)views[i];
        }
        for (int64_t v = 0; v < VIEWS; v++) {
            twin_project_adjoint(exact_volume, exact_views + v * PIXELS,
                                 psf.data + v * SLICES * TAPS, &shape);
        }
        v2v_projector_adjoint(projector, volume, views, NULL, VIEWS, 1.0f);
        judge(volume, exact_volume, SLICES * PIXELS, bound(1));
        print_message("\n");
    }
}

/* What a hot pixel of a slice leaves in the views beyond its kernel is round-off of the transforms
 * alone: its light must not wrap around or leak. */
static void a_hot_pixel_lights_its_kernel_and_nothing_else(void **state)
{
    const int64_t y = 2, x = WIDTH - 3;
    double outside = 0.0, inside = 0.0;
    (void)state;
    memset(volume, 0, sizeof volume);
    volume[y * WIDTH + x] = 1e6f;
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        int near = llabs(i / WIDTH % HEIGHT - y) <= KERNEL_HEIGHT / 2 &&
                   llabs(i % WIDTH - x) <= KERNEL_WIDTH / 2;
        double *most = near ? &inside : &outside;
        *most = fmax(*most, fabs((double)views[i]));
    }
    print_message("hot pixel of 1e6: at most %.1e within its kernel, %.1e beyond\n", inside,
                  outside);
    assert_true(inside > 0.0);
    assert_true(outside <= bound(0));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(projections_and_adjoints_err_as_their_transforms_do),
        cmocka_unit_test(a_hot_pixel_lights_its_kernel_and_nothing_else),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
