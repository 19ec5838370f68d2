/* The step towards the views where A A^H + 1 / tau is worst conditioned: the largest tau that total
 * variation takes, views alike, a slice that no view sees, one slice that all views see sharp. */
#include "small_draw.h"
#include "support.h"
#include "twin_data_step.h"

#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, KERNEL_HEIGHT = 6, KERNEL_WIDTH = 5, HEIGHT = 15, WIDTH = 22 };
enum { TAPS = KERNEL_HEIGHT * KERNEL_WIDTH, VIEW = SLICES * TAPS, STEPS = 3 };

/* Where PSFs sum to 1 a view. */
static const double largest_tau = 4096.0;

static struct v2v_psf_file psf;

static int setup(void **state)
{
    (void)state;
    psf = (struct v2v_psf_file){
        .views = VIEWS, .slices = SLICES, .height = KERNEL_HEIGHT, .width = KERNEL_WIDTH};
    psf.data = small_draw(VIEWS * VIEW, 1, 1.0);
    for (int64_t i = 0; i < VIEWS * VIEW; i++) {
        psf.data[i] = fabsf(psf.data[i]);
    }
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != 0;
}

/* Light and noise of the views for which total variation takes this tau (REFERENCE.md 10): views of
 * much noise, which disagree, never meet a large one. */
static double noise_of(double tau)
{
    return 0.15 / (0.03 * (1.0 + 0.5) * tau);
}

/* Views of a random volume, as bright as 1, with that noise. */
static float *draw_views(struct v2v_data_step *step, double tau)
{
    const struct v2v_torus torus = v2v_data_step_torus(step);
    const int64_t pixels = torus.height * torus.width, samples = psf.views * HEIGHT * WIDTH;
    float *volume = small_draw(psf.slices * pixels, 2, 1.0);
    float *whole = small_draw(psf.views * pixels, 3, 1.0);
    float *views = small_draw(samples, 4, noise_of(tau));
    v2v_data_step_project(step, whole, volume);
    const double size =
        sqrt(v2v_sum_of_squares(whole, psf.views * pixels) / (double)(psf.views * pixels));
    for (int64_t i = 0; i < samples; i++) {
        const int64_t y = i / WIDTH % HEIGHT, at = i / (HEIGHT * WIDTH) * pixels + y * torus.width;
        views[i] += (float)((double)whole[at + i % WIDTH] / size);
    }
    v2v_mem_free(volume);
    v2v_mem_free(whole);
    return views;
}

/* |x - x of the twin| / |x of the twin| of the first steps from a volume of zeros. */
static void measure(double error[STEPS], double *condition, double tau)
{
    struct v2v_data_step *step = NULL;
    v2v_psf_normalize_views(&psf);
    const struct v2v_torus torus = v2v_data_step_torus_of(&psf, HEIGHT, WIDTH);
    assert_ok(v2v_data_step_create(&step, &psf, HEIGHT, WIDTH, &torus, V2V_SPLIT_SLABS, NULL));
    const int64_t voxels = psf.slices * torus.height * torus.width;
    struct twin_data_step twin = {.views = psf.views,
                                  .slices = psf.slices,
                                  .kernel_height = psf.height,
                                  .kernel_width = psf.width,
                                  .height = HEIGHT,
                                  .width = WIDTH,
                                  .torus_height = torus.height,
                                  .torus_width = torus.width,
                                  .psf = psf.data};
    float *views = draw_views(step, tau), *x = small_draw(voxels, 5, 0.0);
    double *expected = v2v_mem_alloc("test", voxels, sizeof *expected); /* of zeros */
    assert_non_null(expected);
    twin_data_step_init(&twin);
    twin_data_step_begin(&twin, views, 1.0);
    const struct twin_penalty penalty = {.constant = 1.0 / tau};
    *condition = twin_data_step_condition(&twin, &penalty);
    v2v_data_step_factor(step, &(struct v2v_penalty){.constant = 1.0 / tau});
    v2v_data_step_begin(step, views, 1.0);
    for (int i = 0; i < STEPS; i++) {
        twin_data_step_run(&twin, expected, NULL, &penalty);
        v2v_data_step_run(step, x);
        error[i] = test_relative_l2_to_double(x, expected, voxels);
    }
    twin_data_step_fini(&twin);
    v2v_data_step_destroy(&step);
    v2v_mem_free(views);
    v2v_mem_free(x);
    v2v_mem_free(expected);
}

/* The inverse is rounded to single precision: of the views themselves, which the first step meets,
 * this leaves 2^-24 of the condition; of what they are missed by, less and less. */
static void check(const char *what)
{
    for (double tau = 1.0; tau <= largest_tau; tau *= 8.0) {
        double error[STEPS], condition = 0.0;
        measure(error, &condition, tau);
        print_message("%s, tau %4g: condition %.3g, errors %.1e %.1e %.1e\n", what, tau, condition,
                      error[0], error[1], error[2]);
        assert_true(condition > 1.0 && error[0] <= fmax(1e-4, 0x1p-23 * condition));
        for (int i = 1; i < STEPS; i++) {
            assert_true(error[i] <= 1e-4);
        }
    }
}

static void views_that_differ(void **state)
{
    (void)state;
    check("views that differ");
}

static void two_views_alike(void **state)
{
    (void)state;
    memcpy(psf.data + VIEW, psf.data, VIEW * sizeof *psf.data);
    check("two views alike");
}

static void a_slice_that_no_view_sees(void **state)
{
    (void)state;
    for (int64_t v = 0; v < VIEWS; v++) {
        memset(psf.data + v * VIEW + TAPS, 0, TAPS * sizeof *psf.data);
    }
    check("a slice that no view sees");
}

/* The largest condition that there is: all of a view's light in one slice, of all frequencies, the
 * same for all views. */
static void one_slice_seen_sharp_by_all(void **state)
{
    (void)state;
    psf.slices = 1;
    memset(psf.data, 0, VIEWS * VIEW * sizeof *psf.data);
    for (int64_t v = 0; v < VIEWS; v++) {
        psf.data[v * TAPS + 2 * KERNEL_WIDTH + 2] = 1.0f;
    }
    check("one slice seen sharp by all");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(views_that_differ, setup, teardown),
        cmocka_unit_test_setup_teardown(two_views_alike, setup, teardown),
        cmocka_unit_test_setup_teardown(a_slice_that_no_view_sees, setup, teardown),
        cmocka_unit_test_setup_teardown(one_slice_seen_sharp_by_all, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
