/* How views are met by a volume, where that is known. */
#include "small_optics.h"

#include "eval/uncertainty.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/optics/projector.h"

#include <stdlib.h>
#include <string.h>

enum { HEIGHT = 48, WIDTH = 40, PIXELS = HEIGHT * WIDTH };
enum { SAMPLES = VIEWS * PIXELS, VOXELS = SLICES * PIXELS };
#define EPS 6e-8

static struct v2v_match of_view[VIEWS];
static double displaced[VIEWS];

/* An object that keeps a kernel's size from the border. */
static void fill_inside(float *volume)
{
    for (int i = 0; i < VOXELS; i++) {
        const int y = i / WIDTH % HEIGHT, x = i % WIDTH;
        const int inside = y >= KERNEL_HEIGHT && y < HEIGHT - KERNEL_HEIGHT && x >= KERNEL_WIDTH &&
                           x < WIDTH - KERNEL_WIDTH;
        volume[i] = inside ? (float)v2v_random_uniform(3, 0, (uint64_t)i) : 0.0f;
    }
}

/* Of the views that a volume gives, times `scale`. */
static enum v2v_status match_volume(struct v2v_match *match, const struct v2v_psf_file *psf,
                                    const float *volume, float *views, float scale)
{
    static float projected[SAMPLES];
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_match_project(projected, psf, volume, HEIGHT, WIDTH, scale, NULL));
    V2V_TRY(v2v_match_frame(match, of_view, displaced, views, projected, VIEWS, HEIGHT, WIDTH));
done:
    return rc;
}

static void an_exact_volume_has_no_residual_and_all_the_light(void **state)
{
    (void)state;
    static float volume[VOXELS], views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    struct v2v_match match;
    double light = 0.0, recorded = 0.0;
    fill_inside(volume);
    small_views(views, volume, &psf, HEIGHT, WIDTH);
    assert_ok(match_volume(&match, &psf, volume, views, 1.0f));
    /* one view's transforms or all: at most float32's rounding of a few additions; the square of
     * what is missed is a difference of sums in double precision */
    assert_true(v2v_match_residual(&match, 1.0) < 10 * EPS);
    assert_true(fabs(v2v_match_flux(&match) - 1.0) < 10 * EPS);
    for (int i = 0; i < SAMPLES; i++) {
        recorded += (double)views[i];
    }
    for (int i = 0; i < VOXELS; i++) { /* a slice's light of a view: all kernels' sum */
        const float *kernels = psf.data + i / PIXELS * KERNEL_HEIGHT * KERNEL_WIDTH;
        for (int k = 0; k < KERNEL_HEIGHT * KERNEL_WIDTH && volume[i] > 0.0f; k++) {
            for (int v = 0; v < VIEWS; v++) {
                light += (double)volume[i] *
                         (double)kernels[v * SLICES * KERNEL_HEIGHT * KERNEL_WIDTH + k];
            }
        }
    }
    assert_true(fabs(recorded / light - 1.0) < test_rounding(KERNEL_HEIGHT * KERNEL_WIDTH));
    assert_ok(match_volume(&match, &psf, volume, views, 0.5f));
    assert_true(fabs(v2v_match_flux(&match) - 0.5) < 10 * EPS);
    assert_true(fabs(v2v_match_scale(&match) - 2.0) < 20 * EPS);
    v2v_psf_file_fini(&psf);
}

static void residual_is_free_of_scale(void **state)
{
    (void)state;
    const struct v2v_match twice = {.yy = 30.0, .yp = 60.0, .pp = 120.0};
    const struct v2v_match orthogonal = {.yy = 30.0, .pp = 30.0};
    assert_true(v2v_match_scale(&twice) == 0.5 && v2v_match_residual(&twice, 0.5) == 0.0);
    assert_true(v2v_match_scale(&orthogonal) == 0.0 && v2v_match_residual(&orthogonal, 0.0) == 1.0);
}

static void noise_alone_is_one_sigma(void **state)
{
    (void)state;
    static float volume[VOXELS], clean[SAMPLES], views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    struct v2v_match match;
    const double sigma = 0.1;
    double sum = 0.0;
    fill_inside(volume);
    small_views(clean, volume, &psf, HEIGHT, WIDTH);
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = clean[i] + (float)(sigma * v2v_random_normal(5, 0, (uint64_t)i));
        sum += (double)clean[i];
    }
    assert_ok(match_volume(&match, &psf, volume, views, 1.0f));
    /* sigma of each view by 1833 differences of four pixels, which overlap: 3 % of a view, 1.5 % of
     * all, and a bit more light than noise; the residual itself 1 / sqrt(2 * 7680) = 0.8 % */
    assert_true(fabs(v2v_match_sigmas(&match, 1.0) - 1.0) < 0.06);
    /* five standard errors of the sum of the noise */
    assert_true(fabs(v2v_match_flux(&match) - 1.0) < 5 * sigma * sqrt(SAMPLES) / sum);
    v2v_psf_file_fini(&psf);
}

/* From room for all views down to twice what one takes. As above, one view's transforms or all: at
 * most float32's rounding of a few additions. */
static void views_that_memory_has_no_room_for_together_match_alike(void **state)
{
    (void)state;
    static float volume[VOXELS], views[SAMPLES];
    struct v2v_psf_file psf = small_psf();
    struct v2v_match all, match;
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = (float)v2v_random_uniform(3, 0, (uint64_t)i);
    }
    for (int i = 0; i < SAMPLES; i++) {
        views[i] = (float)v2v_random_uniform(4, 0, (uint64_t)i);
    }
    assert_ok(match_volume(&all, &psf, volume, views, 1.0f));
    for (int together = VIEWS; together >= 1; together--) {
        struct v2v_psf_file some = psf;
        some.views = together;
        v2v_mem_set_limit(v2v_mem_held() + 2 * (size_t)v2v_projector_bytes(&some, HEIGHT, WIDTH,
                                                                           V2V_SPLIT_SLICES, 1));
        const enum v2v_status rc = match_volume(&match, &psf, volume, views, 1.0f);
        v2v_mem_set_limit(0);
        assert_ok(rc);
        assert_true(fabs(match.pp / all.pp - 1.0) < 10 * EPS);
        assert_true(fabs(match.yp / all.yp - 1.0) < 10 * EPS);
        assert_true(match.yy == all.yy && match.noise == all.noise);
    }
    v2v_psf_file_fini(&psf);
}

static void dark_views_have_no_flux(void **state)
{
    (void)state;
    static float scratch[PIXELS], dark[PIXELS], bright[PIXELS];
    bright[7] = 1.0f;
    struct v2v_match match = v2v_match_of(scratch, dark, bright, HEIGHT, WIDTH);
    assert_true(isnan(v2v_match_flux(&match)) && isnan(v2v_match_sigmas(&match, 1.0)));
    assert_true(isnan(v2v_match_residual(&match, 1.0)) && v2v_match_scale(&match) == 0.0);
    match = v2v_match_of(scratch, bright, dark, HEIGHT, WIDTH);
    assert_true(v2v_match_flux(&match) == 0.0 && v2v_match_residual(&match, 1.0) == 1.0);
    assert_true(v2v_match_scale(&match) == 1.0);
}

/* Of views that differ from the volume's in brightness, the one that differs most. */
static void the_oddest_view_is_told(void **state)
{
    (void)state;
    double times = 0.0;
    for (int v = 0; v < VIEWS; v++) {
        const double gain = v == 1 ? 1.2 : v == 2 ? 0.5 : 1.0;
        of_view[v] = (struct v2v_match){.structure = {.yy = gain * gain,
                                                      .yp = gain,
                                                      .pp = 1.0,
                                                      .squares = 100.0,
                                                      .differences = 6400.0,
                                                      .light = 1.0}};
    }
    assert_int_equal(v2v_match_odd_view(&times, of_view, VIEWS), 2);
    assert_true(times > 0.4 && times < 0.5); /* the others together are brighter than 1 */
    memset(of_view, 0, sizeof of_view);
    assert_int_equal(v2v_match_odd_view(&times, of_view, VIEWS), -1); /* dark, in a dark volume */
}

/* What overflows is no perfect match. */
static void a_projection_that_is_no_number_has_no_residual(void **state)
{
    (void)state;
    static float scratch[PIXELS], recorded[PIXELS], projected[PIXELS];
    recorded[7] = 1.0f;
    projected[7] = NAN;
    const struct v2v_match match = v2v_match_of(scratch, recorded, projected, HEIGHT, WIDTH);
    const double scale = v2v_match_scale(&match);
    assert_true(isnan(v2v_match_residual(&match, scale)));
    assert_true(isnan(v2v_match_sigmas(&match, scale)));
    assert_true(isnan(v2v_match_flux(&match)));
}

static void unknown_figures_are_left_out_of_the_mean(void **state)
{
    (void)state;
    const double x[6] = {1.0, NAN, NAN, NAN, 5.0, NAN};
    assert_true(v2v_mean_of_known(x, 3, 2) == 3.0);
    assert_true(isnan(v2v_mean_of_known(x + 1, 3, 2)));
    assert_true(isnan(v2v_mean_of_known(x, 0, 1)));
}

/* Two volumes of independent noise: half of their difference is as uncertain as their mean. */
static void uncertainty_is_the_standard_error_of_the_mean(void **state)
{
    (void)state;
    static float a[VOXELS], b[VOXELS], c[VOXELS], scratch[PIXELS];
    double mean = 0.0, predicted = 0.0;
    for (int i = 0; i < VOXELS; i++) {
        a[i] = (float)(2.0 + 0.3 * v2v_random_normal(11, 0, (uint64_t)i));
        b[i] = (float)(2.0 + 0.3 * v2v_random_normal(11, 1, (uint64_t)i));
        c[i] = 0.5f * a[i] + 0.5f * b[i];
    }
    v2v_uncertainty_of(a, b, c, scratch, SLICES, HEIGHT, WIDTH);
    for (int i = 0; i < VOXELS; i++) {
        mean += ((double)c[i] - 2.0) * ((double)c[i] - 2.0) / VOXELS;
        predicted += (double)a[i] * (double)a[i] / VOXELS;
        assert_true(a[i] > 0.0f);
    }
    /* standard error of a variance of n normal samples: sqrt(2 / n) of it, 1.3 % for 11520; those
     * at the edges of a slice count more in the windows */
    assert_true(fabs(mean / (0.3 * 0.3 / 2) - 1.0) < 0.065);
    assert_true(fabs(predicted / (0.3 * 0.3 / 2) - 1.0) < 0.065);
}

/* Squares neither overflow nor vanish: powers of two change no bit. */
static void uncertainty_scales_with_the_volumes(void **state)
{
    (void)state;
    static const float scales[] = {0x1p100f, 0x1p-100f};
    static float a[PIXELS], b[PIXELS], c[PIXELS], plain[PIXELS], scratch[PIXELS];
    for (int s = 0; s < 3; s++) {
        const float scale = s > 0 ? scales[s - 1] : 1.0f;
        for (int i = 0; i < PIXELS; i++) {
            a[i] = scale * (float)v2v_random_uniform(13, 0, (uint64_t)i);
            b[i] = scale * (float)v2v_random_uniform(13, 1, (uint64_t)i);
            c[i] = scale * (float)v2v_random_uniform(13, 2, (uint64_t)i);
        }
        v2v_uncertainty_of(a, b, c, scratch, 1, HEIGHT, WIDTH);
        for (int i = 0; i < PIXELS; i++) {
            plain[i] = s > 0 ? plain[i] : a[i];
            assert_true(a[i] == scale * plain[i] && a[i] > 0.0f);
        }
    }
}

/* Errors that grow as the inverse of the number of views: by 3 with all of them, by 6 with half. */
static void uncertainty_has_the_bias_of_both(void **state)
{
    (void)state;
    static float a[PIXELS], b[PIXELS], c[PIXELS], scratch[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        a[i] = b[i] = 10.0f - 6.0f;
        c[i] = 10.0f - 3.0f;
    }
    v2v_uncertainty_of(a, b, c, scratch, 1, HEIGHT, WIDTH);
    for (int i = 0; i < PIXELS; i++) {
        assert_true(fabs((double)a[i] - 3.0) < 4 * 3.0 * EPS);
    }
}

static void a_difference_is_spread_over_five_pixels(void **state)
{
    (void)state;
    static float a[PIXELS], b[PIXELS], c[PIXELS], scratch[PIXELS];
    enum { Y = 20, X = 11 };
    a[Y * WIDTH + X] = 10.0f;
    c[Y * WIDTH + X] = 5.0f;
    v2v_uncertainty_of(a, b, c, scratch, 1, HEIGHT, WIDTH);
    for (int i = 0; i < PIXELS; i++) {
        const int near = abs(i / WIDTH - Y) <= 2 && abs(i % WIDTH - X) <= 2;
        assert_true(fabs((double)a[i] - (near ? 1.0 : 0.0)) < 4 * EPS); /* sqrt(25 / 25) */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_exact_volume_has_no_residual_and_all_the_light),
        cmocka_unit_test(residual_is_free_of_scale),
        cmocka_unit_test(noise_alone_is_one_sigma),
        cmocka_unit_test(views_that_memory_has_no_room_for_together_match_alike),
        cmocka_unit_test(dark_views_have_no_flux),
        cmocka_unit_test(the_oddest_view_is_told),
        cmocka_unit_test(a_projection_that_is_no_number_has_no_residual),
        cmocka_unit_test(unknown_figures_are_left_out_of_the_mean),
        cmocka_unit_test(uncertainty_is_the_standard_error_of_the_mean),
        cmocka_unit_test(uncertainty_scales_with_the_volumes),
        cmocka_unit_test(uncertainty_has_the_bias_of_both),
        cmocka_unit_test(a_difference_is_spread_over_five_pixels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
