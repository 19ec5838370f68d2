#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/eval/metrics.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SLICES = 3, HEIGHT = 34, WIDTH = 37, COUNT = SLICES * HEIGHT * WIDTH };
enum { CROP = 10, WINDOW = 11 };

/** A sparse bright scene: an eighth of the voxels uniform in [0,1), the others 0. */
static void fill(float *volume, uint64_t seed)
{
    for (int64_t i = 0; i < COUNT; i++) {
        int bright = v2v_random_below(seed, 0, (uint64_t)i, 8) == 0;
        volume[i] = bright ? (float)v2v_random_uniform(seed, 1, (uint64_t)i) : 0;
    }
}

static struct v2v_scores scores_of(const float *truth, const float *volume, int fit)
{
    struct v2v_scores scores;
    assert_ok(v2v_scores_of(&scores, truth, volume, SLICES, HEIGHT, WIDTH, fit));
    return scores;
}

static void equal_volumes_have_ssim_1_and_infinite_psnr(void **state)
{
    (void)state;
    static float truth[COUNT];
    fill(truth, 1);
    struct v2v_scores scores = scores_of(truth, truth, 0);
    assert_true(isinf(scores.psnr) && scores.psnr > 0);
    /* Every pixel's quotient is 1 up to some ten roundings of 1.1e-16. */
    assert_true(fabs(scores.ssim - 1) < 1e-14);
}

static double signal_at(const float *volume, double background, int64_t z, int64_t y, int64_t x)
{
    double value = (double)volume[(z * HEIGHT + CROP + y) * WIDTH + CROP + x] - background;
    return value > 0 ? value : 0;
}

/** SSIM with the window as one two-dimensional sum: a plain twin. */
static double plain_ssim(const float *a, const float *b, const struct v2v_scores *s)
{
    double sum = 0;
    int64_t valid = 0;
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t y = 0; y + WINDOW <= HEIGHT - 2 * CROP; y++) {
            for (int64_t x = 0; x + WINDOW <= WIDTH - 2 * CROP; x++, valid++) {
                double w = 0, ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
                for (int k = 0; k < WINDOW * WINDOW; k++) {
                    int dy = k / WINDOW, dx = k % WINDOW;
                    double r2 = (dy - 5) * (dy - 5) + (dx - 5) * (dx - 5);
                    double g = exp(-r2 / (2 * 1.5 * 1.5));
                    double p = signal_at(a, s->background_truth, z, y + dy, x + dx);
                    double q = signal_at(b, s->background_volume, z, y + dy, x + dx);
                    w += g, ma += g * p, mb += g * q;
                    aa += g * p * p, bb += g * q * q, ab += g * p * q;
                }
                ma /= w, mb /= w, aa = aa / w - ma * ma, bb = bb / w - mb * mb;
                ab = ab / w - ma * mb;
                sum += (2 * ma * mb + 1e-4) * (2 * ab + 9e-4) /
                       ((ma * ma + mb * mb + 1e-4) * (aa + bb + 9e-4));
            }
        }
    }
    return sum / (double)valid;
}

static void ssim_equals_its_plain_definition(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    fill(truth, 1);
    fill(volume, 2);
    for (int64_t i = 0; i < COUNT; i++) {
        volume[i] = 0.5f * truth[i] + 0.5f * volume[i];
    }
    struct v2v_scores scores = scores_of(truth, volume, 0);
    /* 121 terms of at most 1 and eps 1.1e-16, divided by at least 9e-4: 1.5e-11. */
    assert_true(fabs(scores.ssim - plain_ssim(truth, volume, &scores)) < 1.5e-11);
    assert_true(scores.ssim < 0.99);
}

static void an_empty_volume_has_the_psnr_of_the_truths_power(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    fill(truth, 3);
    struct v2v_scores scores = scores_of(truth, volume, 0);
    double power = 0;
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t y = 0; y < HEIGHT - 2 * CROP; y++) {
            for (int64_t x = 0; x < WIDTH - 2 * CROP; x++) {
                power += pow(signal_at(truth, scores.background_truth, z, y, x), 2);
            }
        }
    }
    double pixels = SLICES * (HEIGHT - 2 * CROP) * (WIDTH - 2 * CROP);
    assert_true(fabs(scores.psnr + 10 * log10(power / pixels)) < 1e-9); /* 714 terms x eps x dB */
    assert_true(scores.background_volume == 0);
}

static void constant_volumes_are_all_background(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    for (int64_t i = 0; i < COUNT; i++) {
        truth[i] = 0.25f;
        volume[i] = 0.5f;
    }
    struct v2v_scores scores = scores_of(truth, volume, 1);
    assert_true(scores.background_truth == 0.25 && scores.background_volume == 0.5);
    assert_true(isinf(scores.psnr) && scores.scale == 1);
}

static void a_fitted_scale_undoes_a_scaling(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    fill(truth, 4);
    for (int64_t i = 0; i < COUNT; i++) {
        volume[i] = 0.25f * truth[i]; /* exact, and so is its histogram */
    }
    struct v2v_scores scores = scores_of(truth, volume, 1);
    assert_true(fabs(scores.scale - 4) < 1e-12); /* 714 terms x eps x 4 */
    assert_true(scores.psnr > 200);              /* squares of 1e-12 leave 240 dB */
    assert_true(scores_of(truth, volume, 0).psnr < 30);
}

static void bad_volumes_are_refused(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    struct v2v_scores scores;
    assert_int_equal(v2v_scores_of(&scores, truth, volume, SLICES, 30, WIDTH, 0), V2V_E_INPUT);
    assert_int_equal(v2v_scores_of(&scores, truth, volume, SLICES, HEIGHT, 30, 0), V2V_E_INPUT);
    assert_ok(v2v_scores_of(&scores, truth, volume, 1, 31, 31, 0));
    volume[HEIGHT * WIDTH + 2 * WIDTH + 5] = NAN;
    assert_int_equal(v2v_scores_of(&scores, truth, volume, SLICES, HEIGHT, WIDTH, 0), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "volume: NaN or Inf at slice 1, row 2, column 5"));
}

/** The example of the header. */
static enum v2v_status example(const float *truth, const float *volume)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scores scores;
    V2V_TRY(v2v_scores_of(&scores, truth, volume, SLICES, HEIGHT, WIDTH, 0));
    printf("%.2f dB, SSIM %.3f\n", scores.psnr, scores.ssim);
done:
    return rc;
}

static void the_headers_example_runs(void **state)
{
    (void)state;
    static float truth[COUNT], volume[COUNT];
    fill(truth, 5);
    fill(volume, 6);
    assert_ok(example(truth, volume));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_volumes_have_ssim_1_and_infinite_psnr),
        cmocka_unit_test(ssim_equals_its_plain_definition),
        cmocka_unit_test(an_empty_volume_has_the_psnr_of_the_truths_power),
        cmocka_unit_test(constant_volumes_are_all_background),
        cmocka_unit_test(a_fitted_scale_undoes_a_scaling),
        cmocka_unit_test(bad_volumes_are_refused),
        cmocka_unit_test(the_headers_example_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
