/* Every term against plain loops in double precision, and what the window leaves out. */
#include "held_out.h"
#include "support.h"

#include "loss/terms.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/loss/loss.h"

#include <math.h>
#include <string.h>

enum { MOST = 12, COUNT = 6 * 40 };
enum { VIEWS = 5, SLICES = 3, SIDE = 32, KERNEL = 5, PIXELS = SIDE * SIDE };

#define WEIGHT 0.25 /* exact in float32 */

static void fill(float *x, int64_t count, uint64_t stream, double mean)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(mean + 0.3 * v2v_random_normal(41, stream, (uint64_t)i));
    }
}

/* Sums are of float32 values in double precision, in another order: 1e-13 of a few hundred terms.
 */
static void assert_sum(double sum, double expected)
{
    assert_true(fabs(sum - expected) <= 1e-13 * fabs(expected));
}

/* ---- single terms ---- */

/* COUNT voxels as one row of `slices`, of the first of two outputs, and their mean a sum. */
static struct v2v_term_volume row_of(int profile, int64_t slices)
{
    return (struct v2v_term_volume){.profile = profile,
                                    .slices = slices,
                                    .width = COUNT / slices,
                                    .stride = COUNT / slices,
                                    .slice = 1.0 / (double)(slices > 2 ? slices - 2 : 1),
                                    .share = 0.5,
                                    .background = 0.2};
}

static double sum_over_slices(v2v_volume_term *term, struct v2v_term_volume row, float *gradient,
                              const float *a, const float *b)
{
    double sum = 0.0;
    for (row.z = 0; row.z < row.slices; row.z++) {
        const int64_t at = row.z * row.stride;
        sum += term(&row, gradient + at, a + at, b + at, WEIGHT);
    }
    return sum;
}

static void mse_is_the_mean_square(void **state)
{
    (void)state;
    float d[COUNT], gradient[COUNT] = {0};
    const struct v2v_term_view view = {.ny = 6, .nx = COUNT / 6, .compared = COUNT};
    double expected = 0.0;
    fill(d, COUNT, 0, 0.1);
    for (int i = 0; i < COUNT; i++) {
        expected += (double)d[i] * d[i] / COUNT;
    }
    assert_sum(v2v_term_mse(&view, gradient, d, WEIGHT), expected);
    for (int i = 0; i < COUNT; i++) { /* two roundings */
        double g = WEIGHT * 2.0 * d[i] / COUNT;
        assert_true(fabs(gradient[i] - g) <= 2 * 6e-8 * fabs(g));
    }
}

static void positivity_sums_what_is_below_zero(void **state)
{
    (void)state;
    float x[COUNT], gradient[COUNT];
    const struct v2v_term_volume row = row_of(V2V_LOSS_REFERENCE, 5);
    double expected = 0.0;
    fill(x, COUNT, 1, 0.0);
    fill(gradient, COUNT, 2, 0.0);
    x[0] = 0.0f;
    float before[COUNT];
    memcpy(before, gradient, sizeof before);
    for (int i = 0; i < COUNT; i++) {
        expected += x[i] < 0.0f ? -(double)x[i] : 0.0;
    }
    assert_sum(sum_over_slices(v2v_term_pos, row, gradient, x, x), expected);
    for (int i = 0; i < COUNT; i++) {
        assert_true(gradient[i] == before[i] - (x[i] < 0.0f ? (float)WEIGHT : 0.0f));
    }
}

static void crosstalk_sums_what_the_mean_lacks(void **state)
{
    (void)state;
    float a[COUNT], b[COUNT], gradient[COUNT] = {0};
    const struct v2v_term_volume row = row_of(V2V_LOSS_PAPER, 5);
    double expected = 0.0;
    fill(a, COUNT, 3, 0.2);
    fill(b, COUNT, 4, 0.2);
    for (int i = 0; i < COUNT; i++) {
        double lack = row.background - 0.5 * ((double)a[i] + b[i]);
        expected += lack > 0.0 ? 0.5 * lack : 0.0; /* half of it is the other output's */
    }
    assert_sum(sum_over_slices(v2v_term_dc, row, gradient, a, b), expected);
    for (int i = 0; i < COUNT; i++) {
        int lacks = 0.5 * ((double)a[i] + b[i]) < row.background;
        assert_true(gradient[i] == (lacks ? (float)(-0.5 * WEIGHT) : 0.0f));
    }
}

static void smoothness_sums_the_second_difference_over_z(void **state)
{
    (void)state;
    enum { DEPTH = 6, AREA = COUNT / DEPTH };
    float a[COUNT], b[COUNT], gradient[COUNT] = {0};
    struct v2v_term_volume row = row_of(V2V_LOSS_REFERENCE, DEPTH);
    double expected = 0.0, slope[COUNT] = {0.0};
    fill(a, COUNT, 5, 0.2);
    fill(b, COUNT, 6, 0.2);
    for (int i = AREA; i < COUNT - AREA; i++) {
        double m[3];
        for (int k = 0; k < 3; k++) {
            int j = i + (k - 1) * AREA;
            m[k] = 0.5 * ((double)a[j] + b[j]);
        }
        double bend = 2.0 * m[1] - m[0] - m[2], sign = bend > 0.0 ? 0.5 : -0.5;
        expected += 0.5 * fabs(bend);
        slope[i] += 2.0 * WEIGHT * sign;
        slope[i - AREA] -= WEIGHT * sign;
        slope[i + AREA] -= WEIGHT * sign;
    }
    /* each bend, of size 1, is made of six float32 roundings */
    double sum = sum_over_slices(v2v_term_tv, row, gradient, a, b);
    assert_true(fabs(sum - expected) <= 6 * 6e-8 * (DEPTH - 2) * AREA);
    for (int i = 0; i < COUNT; i++) {
        assert_true((double)gradient[i] == slope[i]); /* eighths */
    }
    for (int64_t slices = 1; slices <= 2; slices++) {
        row = row_of(V2V_LOSS_REFERENCE, slices);
        assert_true(sum_over_slices(v2v_term_tv, row, gradient, a, b) == 0.0);
    }
}

/* ---- Fourier term ---- */

/* sum over all frequencies of |D|^p and its gradient, by the definition. */
static double plain_fourier(double *gradient, const float *image, int ny, int nx, int squared)
{
    double sum = 0.0;
    memset(gradient, 0, sizeof(double) * (size_t)(ny * nx));
    for (int k = 0; k < ny * nx; k++) {
        double re = 0.0, im = 0.0;
        double turn_y = 2.0 * acos(-1.0) * (k / nx) / ny, turn_x = 2.0 * acos(-1.0) * (k % nx) / nx;
        for (int i = 0; i < ny * nx; i++) {
            double angle = turn_y * (i / nx) + turn_x * (i % nx);
            re += image[i] * cos(angle);
            im -= image[i] * sin(angle);
        }
        double size = sqrt(re * re + im * im), factor = squared ? 2.0 : 1.0 / size;
        sum += squared ? size * size : size;
        for (int i = 0; i < ny * nx; i++) {
            double angle = turn_y * (i / nx) + turn_x * (i % nx);
            gradient[i] += factor * (re * cos(angle) - im * sin(angle));
        }
    }
    return sum;
}

/* Transforms of about 100 samples lose 3 roundings of 6e-8 of the mean modulus in each coefficient:
 * the sum 2e-7; a phase loses more where its modulus is small, ten times that in the mean square:
 * 2e-6, to be doubled for the inverse. */
static void check_fourier(int ny, int nx, int squared)
{
    float image[MOST * MOST], got[MOST * MOST] = {0}, *scratch = NULL;
    double gradient[MOST * MOST];
    struct v2v_complex *spectrum = NULL;
    struct v2v_fft2 *fft = NULL;
    fill(image, ny * nx, (uint64_t)(10 * ny + nx), 0.2);
    assert_ok(V2V_ALLOC(scratch, "test", ny * nx));
    assert_ok(V2V_ALLOC(spectrum, "test", ny * (nx / 2 + 1)));
    assert_ok(v2v_fft2_create(&fft, ny, nx));
    struct v2v_term_view view = {.profile = squared ? V2V_LOSS_PAPER : V2V_LOSS_REFERENCE,
                                 .ny = ny,
                                 .nx = nx,
                                 .compared = 1.0,
                                 .fft = fft,
                                 .spectrum = spectrum,
                                 .scratch = scratch};
    double expected = plain_fourier(gradient, image, ny, nx, squared);
    double alone = v2v_term_fft(&view, got, image, 0.0);
    assert_true(got[0] == 0.0f); /* weight 0: no gradient */
    double sum = v2v_term_fft(&view, got, image, WEIGHT);
    assert_true(sum == alone);
    assert_true(fabs(sum - expected) <= (squared ? 4e-7 : 2e-7) * expected);
    for (int i = 0; i < ny * nx; i++) {
        gradient[i] *= WEIGHT;
    }
    assert_true(test_relative_l2_to_double(got, gradient, ny * nx) <= 4e-6);
    v2v_fft2_destroy(&fft);
    v2v_mem_free(spectrum);
    v2v_mem_free(scratch);
    assert_int_equal(v2v_mem_held(), 0);
}

static void fourier_term_matches_its_definition_at_odd_and_even_sizes(void **state)
{
    (void)state;
    static const int size[][2] = {{8, 12}, {7, 12}, {8, 11}, {9, 7}, {1, 8}, {8, 1}, {2, 2}};
    for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
        check_fourier(size[i][0], size[i][1], 0);
        check_fourier(size[i][0], size[i][1], 1);
    }
}

static void a_difference_of_zero_has_no_slope(void **state)
{
    (void)state;
    float image[64] = {0}, gradient[64] = {0}, *scratch = NULL;
    struct v2v_complex *spectrum = NULL;
    struct v2v_fft2 *fft = NULL;
    assert_ok(V2V_ALLOC(scratch, "test", 64));
    assert_ok(V2V_ALLOC(spectrum, "test", 8 * 5));
    assert_ok(v2v_fft2_create(&fft, 8, 8));
    struct v2v_term_view view = {
        .ny = 8, .nx = 8, .compared = 64.0, .fft = fft, .spectrum = spectrum, .scratch = scratch};
    assert_true(v2v_term_fft(&view, gradient, image, WEIGHT) == 0.0);
    for (int i = 0; i < 64; i++) {
        assert_true(gradient[i] == 0.0f);
    }
    v2v_fft2_destroy(&fft);
    v2v_mem_free(spectrum);
    v2v_mem_free(scratch);
}

/* ---- the whole loss ---- */

struct judged {
    struct v2v_psf_file psf;
    struct v2v_config config;
    struct v2v_projector *projector;
    struct v2v_loss *loss;
    float views[VIEWS * PIXELS], volume[2][SLICES * PIXELS], dvolume[2][SLICES * PIXELS];
};

static void create_loss(struct judged *j, struct v2v_window window)
{
    struct v2v_loss_setup setup = {.settings = &j->config.loss,
                                   .psf = &j->psf,
                                   .reduce = V2V_REDUCE_SUM,
                                   .height = SIDE,
                                   .width = SIDE,
                                   .window = window,
                                   .projector = j->projector};
    test_hold_out_halves(&setup, VIEWS);
    assert_ok(v2v_loss_create(&j->loss, &setup));
}

static void judge_init(struct judged *j, int profile, struct v2v_window window)
{
    memset(j, 0, sizeof *j);
    v2v_config_defaults(&j->config);
    j->config.loss.profile = profile;
    j->psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(j->psf.data, "test", VIEWS * SLICES * KERNEL * KERNEL));
    for (int64_t i = 0; i < VIEWS * SLICES * KERNEL * KERNEL; i++) {
        j->psf.data[i] = (float)v2v_random_uniform(41, 7, (uint64_t)i);
    }
    v2v_psf_normalize_views(&j->psf);
    fill(j->views, VIEWS * PIXELS, 8, 0.5);
    fill(&j->volume[0][0], 2 * SLICES * PIXELS, 9, 0.4);
    assert_ok(v2v_projector_create(&j->projector, &j->psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    create_loss(j, window);
}

static void judge_fini(struct judged *j)
{
    v2v_loss_destroy(&j->loss);
    v2v_projector_destroy(&j->projector);
    v2v_psf_file_fini(&j->psf);
    assert_int_equal(v2v_mem_held(), 0);
}

static void judge(struct judged *j, double *terms)
{
    float *const dvolume[2] = {j->dvolume[0], j->dvolume[1]};
    const float *const volume[2] = {j->volume[0], j->volume[1]};
    v2v_loss_evaluate(j->loss, terms, 3, dvolume, volume, j->views);
}

/* Parseval: sum |D|^2 = N sum d^2, so the paper's term is N times the mean square. The transform's
 * round-off is 4e-7 of it, see above; the mean square's is far less. */
static void the_papers_fourier_term_is_the_mean_square_times_the_pixels(void **state)
{
    (void)state;
    static const struct v2v_window window[] = {{3, 30, 2, 29}, {4, 28, 0, 32}, {0, 31, 6, 26}};
    static struct judged j;
    double terms[V2V_LOSS_TERMS];
    for (size_t i = 0; i < sizeof window / sizeof *window; i++) {
        const struct v2v_window *w = &window[i];
        double pixels = (double)((w->y1 - w->y0) * (w->x1 - w->x0));
        judge_init(&j, V2V_LOSS_PAPER, *w);
        judge(&j, terms);
        double parseval = pixels * terms[V2V_LOSS_MSE];
        assert_true(fabs(terms[V2V_LOSS_FFT] - parseval) <= 4e-7 * parseval);
        judge_fini(&j);
    }
}

/* Add 1 to every view's pixels outside (or inside) of the window. */
static void disturb(struct judged *j, const struct v2v_window *w, int inside)
{
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        int64_t y = i / SIDE % SIDE, x = i % SIDE;
        int within = y >= w->y0 && y < w->y1 && x >= w->x0 && x < w->x1;
        j->views[i] += within == inside ? 1.0f : 0.0f;
    }
}

static void pixels_outside_of_the_window_do_not_matter(void **state)
{
    (void)state;
    static struct judged j;
    static float before[2][SLICES * PIXELS];
    const struct v2v_window window = {5, 27, 4, 31};
    double terms[V2V_LOSS_TERMS], other[V2V_LOSS_TERMS];
    judge_init(&j, V2V_LOSS_REFERENCE, window);
    v2v_loss_destroy(&j.loss);
    /* the background of the de-crosstalk term is the whole frame's */
    j.config.loss.weight[V2V_LOSS_DC] = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
    create_loss(&j, window);
    judge(&j, terms);
    memcpy(before, j.dvolume, sizeof before);
    disturb(&j, &window, 0);
    judge(&j, other);
    assert_true(other[V2V_LOSS_TOTAL] == terms[V2V_LOSS_TOTAL]);
    assert_memory_equal(before, j.dvolume, sizeof before);
    disturb(&j, &window, 1);
    judge(&j, other);
    assert_true(other[V2V_LOSS_MSE] != terms[V2V_LOSS_MSE]);
    assert_true(other[V2V_LOSS_FFT] != terms[V2V_LOSS_FFT]);
    judge_fini(&j);
}

static void settings_resolve_to_the_profiles_weights(void **state)
{
    (void)state;
    static const double expected[][V2V_LOSS_TERMS] = {
        [V2V_LOSS_REFERENCE] = {1.0, 0.5, 1e-3, 1e-2, 1e-3, 1.0},
        [V2V_LOSS_PAPER] = {1.0, 0.1, 0.0, 1.0, 0.0, 1.0},
    };
    double weights[V2V_LOSS_TERMS];
    struct v2v_config config;
    v2v_config_defaults(&config);
    for (int profile = V2V_LOSS_REFERENCE; profile <= V2V_LOSS_PAPER; profile++) {
        config.loss.profile = profile;
        v2v_loss_weights(weights, &config.loss);
        assert_memory_equal(weights, expected[profile], sizeof weights);
    }
    config.loss.weight[V2V_LOSS_FFT] = (struct v2v_number){V2V_NUMBER_NONE, 3.0};
    config.loss.weight[V2V_LOSS_TV] = (struct v2v_number){V2V_NUMBER_GIVEN, 3.0};
    v2v_loss_weights(weights, &config.loss);
    assert_true(weights[V2V_LOSS_FFT] == 0.0 && weights[V2V_LOSS_TV] == 3.0);
}

/* The example of loss.h. */
static enum v2v_status header_example(double *terms, const struct v2v_config *config,
                                      const struct v2v_psf_file *psf, float *const *dvolume,
                                      const float *const *volume, const float *views)
{
    enum v2v_status rc = V2V_OK;
    static const int32_t odd[] = {1, 3}, even[] = {0, 2, 4};
    struct v2v_loss *loss = NULL;
    struct v2v_loss_setup setup = {.settings = &config->loss,
                                   .psf = psf,
                                   .reduce = V2V_REDUCE_SUM,
                                   .height = SIDE,
                                   .width = SIDE,
                                   .window = {4, SIDE - 4, 4, SIDE - 4},
                                   .outputs = 2,
                                   .held_out = {{odd, 2}, {even, 3}}};
    V2V_TRY(v2v_projector_create(&setup.projector, psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    V2V_TRY(v2v_loss_create(&loss, &setup));
    v2v_loss_evaluate(loss, terms, 3, dvolume, volume, views);
done:
    v2v_loss_destroy(&loss);
    v2v_projector_destroy(&setup.projector);
    return rc;
}

static void header_example_sums_the_weighted_terms(void **state)
{
    (void)state;
    static struct judged j;
    double terms[V2V_LOSS_TERMS], weights[V2V_LOSS_TERMS], total = 0.0;
    judge_init(&j, V2V_LOSS_REFERENCE, (struct v2v_window){0, SIDE, 0, SIDE});
    float *const dvolume[2] = {j.dvolume[0], j.dvolume[1]};
    const float *const volume[2] = {j.volume[0], j.volume[1]};
    assert_ok(header_example(terms, &j.config, &j.psf, dvolume, volume, j.views));
    v2v_loss_weights(weights, &j.config.loss);
    for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
        total += weights[i] * terms[i];
    }
    assert_sum(terms[V2V_LOSS_TOTAL], total);
    judge_fini(&j);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(mse_is_the_mean_square),
        cmocka_unit_test(positivity_sums_what_is_below_zero),
        cmocka_unit_test(crosstalk_sums_what_the_mean_lacks),
        cmocka_unit_test(smoothness_sums_the_second_difference_over_z),
        cmocka_unit_test(fourier_term_matches_its_definition_at_odd_and_even_sizes),
        cmocka_unit_test(a_difference_of_zero_has_no_slope),
        cmocka_unit_test(the_papers_fourier_term_is_the_mean_square_times_the_pixels),
        cmocka_unit_test(pixels_outside_of_the_window_do_not_matter),
        cmocka_unit_test(settings_resolve_to_the_profiles_weights),
        cmocka_unit_test(header_example_sums_the_weighted_terms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
