/* Loss terms and gradients for views and volumes of any size, against plain loops in double
 * precision over REFERENCE.md 5.
 *
 * Bounds: an error e_i = ||d_i - exact|| of the difference d_i between a projection and its view is
 * what tests/stress/optics/test_projector_inputs.c derives. It changes the mean square by
 * 2 e ||d|| + e^2 and, spread over frequencies, every modulus of the transform by about
 * rho = e + 2 u sqrt(log2(n)) ||d||, u = 2^-24. The gradient of a modulus is D / |D|, off by rho /
 * |D| and never by more than 2. Adjoints carry errors of view gradients as the kernels' sums say.
 */
#include "hard_input.h"
#include "held_out.h"
#include "support.h"
#include "twin_projector.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/loss/loss.h"
#include "v2v3d/tensor/statistics.h"

#include <complex.h>
#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, SIDE = 32, KERNEL = 7, BRANCHES = 2, BINS = 256 };
enum { PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, TAPS = KERNEL * KERNEL };
enum { Y0 = 3, X0 = 2, NY = 27, NX = 26, AREA = NY * NX, HOT = PIXELS + 17 * SIDE + 5 };

static const double unit = 0x1p-24;
static const double pi = 3.14159265358979323846;

static struct v2v_config config;
static struct v2v_psf_file psf;
static struct v2v_projector *projector;
static struct v2v_loss *loss;
static double weight[V2V_LOSS_TERMS];
static float views[VIEWS * PIXELS], volume[BRANCHES][VOXELS], dvolume[BRANCHES][VOXELS];

/* What the twin finds, and how far float32 may be from it. */
struct judged {
    double terms[V2V_LOSS_TERMS], allowed[V2V_LOSS_TERMS];
    double gradient[BRANCHES][VOXELS];
    double allowed_gradient; /* in norm over both branches */
};

static void setup(int profile)
{
    struct v2v_loss_setup setup = {.settings = &config.loss,
                                   .psf = &psf,
                                   .reduce = V2V_REDUCE_SUM,
                                   .height = SIDE,
                                   .width = SIDE,
                                   .window = {Y0, Y0 + NY, X0, X0 + NX}};
    v2v_config_defaults(&config);
    config.loss.profile = profile;
    psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * TAPS));
    for (int64_t i = 0; i < VIEWS * SLICES * TAPS; i++) {
        psf.data[i] = (float)v2v_random_uniform(73, 0, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    v2v_loss_weights(weight, &config.loss);
    assert_ok(v2v_projector_create(&projector, &psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    setup.projector = projector;
    test_hold_out_halves(&setup, VIEWS);
    assert_ok(v2v_loss_create(&loss, &setup));
}

static void teardown(void)
{
    v2v_loss_destroy(&loss);
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Views as they come; volumes of the same size, a seventh of them below zero. */
static void fill(enum test_hard which)
{
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        views[i] = test_hard_sample(which, i, SIDE, HOT);
    }
    for (int64_t i = 0; i < BRANCHES * VOXELS; i++) {
        float value = test_hard_sample(which, 3 * i + 1, SIDE, HOT);
        volume[i / VOXELS][i % VOXELS] = i % 7 == 0 ? -0.5f * value : value;
    }
}

static double size_of(const double *x, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += x[i] * x[i];
    }
    return sqrt(sum);
}

/* ---- transforms ---- */

/* to[k] = sum from[i] exp(sign 2 pi i k i / n) along one axis. */
static void transform_axis(double complex *to, const double complex *from, int64_t n, int64_t step,
                           double sign)
{
    for (int64_t k = 0; k < n; k++) {
        to[k * step] = 0.0;
        for (int64_t i = 0; i < n; i++) {
            to[k * step] +=
                from[i * step] * cexp(sign * 2.0 * pi * I * (double)(k * i % n) / (double)n);
        }
    }
}

static void transform(double complex *x, double sign)
{
    static double complex half[AREA];
    for (int64_t y = 0; y < NY; y++) {
        transform_axis(half + y * NX, x + y * NX, NX, 1, sign);
    }
    for (int64_t column = 0; column < NX; column++) {
        transform_axis(x + column, half + column, NY, NX, sign);
    }
}

/* ---- the terms of a view ---- */

struct view_error {
    double difference; /* ||d - exact|| */
    double gradient;   /* of dL/dprojection */
};

/* How far the projection of view v may be off; that of nothing is nothing. */
static double projector_error(int64_t v, const float *slices)
{
    double stages = 3.0 * log2((double)((SIDE + KERNEL) * (SIDE + KERNEL))) + 4.0, sum = 0.0;
    for (int64_t z = 0; z < SLICES; z++) {
        double kernel = 0.0;
        for (int64_t i = 0; i < TAPS; i++) {
            kernel += (double)psf.data[(v * SLICES + z) * TAPS + i];
        }
        sum += kernel * sqrt(v2v_sum_of_squares(slices + z * PIXELS, PIXELS));
    }
    return sum > 0.0 ? 2.0 * sqrt(stages) * (unit * sum + 0x1p-149 * sqrt((double)PIXELS)) : 0.0;
}

/* The Fourier term of one view: adds its value, its gradient and their errors. */
static void judge_spectrum(struct judged *j, struct view_error *error, double *gradient,
                           const double *difference, double mean)
{
    static double complex spectrum[AREA];
    int squared = config.loss.profile == V2V_LOSS_PAPER;
    double w = weight[V2V_LOSS_FFT] * mean, directions = 0.0;
    double own = 2.0 * unit * sqrt(log2((double)AREA));
    double rho = error->difference + own * size_of(difference, AREA);
    for (int i = 0; i < AREA; i++) {
        spectrum[i] = difference[i];
    }
    transform(spectrum, -1.0);
    for (int i = 0; i < AREA; i++) {
        double size = cabs(spectrum[i]);
        double off = squared ? 2.0 * rho
                             : fmin(2.0, size > 0.0  ? rho / size
                                         : rho > 0.0 ? 2.0
                                                     : 0.0);
        j->terms[V2V_LOSS_FFT] += mean * (squared ? size * size : size);
        j->allowed[V2V_LOSS_FFT] += mean * (squared ? 2.0 * rho * size + rho * rho : rho);
        spectrum[i] = squared ? 2.0 * spectrum[i] : size > 0.0 ? spectrum[i] / size : 0.0;
        off += own * cabs(spectrum[i]);
        directions += off * off;
    }
    transform(spectrum, 1.0);
    for (int i = 0; i < AREA; i++) {
        gradient[i] += w * creal(spectrum[i]);
    }
    error->gradient += w * sqrt((double)AREA * directions);
}

/* Branch b against view v: adds to terms and to dL/dvolume[b]. */
static void judge_view(struct judged *j, int b, int64_t v, int64_t seen)
{
    static double exact[VOXELS], projection[PIXELS];
    static double difference[AREA], gradient[AREA];
    const struct twin_shape shape = {SLICES, KERNEL, KERNEL, SIDE, SIDE};
    double count = (double)(seen * AREA), w = 2.0 * weight[V2V_LOSS_MSE] / count;
    for (int i = 0; i < VOXELS; i++) {
        exact[i] = (double)volume[b][i];
    }
    twin_project(projection, exact, psf.data + v * SLICES * TAPS, &shape);
    for (int i = 0; i < AREA; i++) {
        int at = (Y0 + i / NX) * SIDE + X0 + i % NX;
        difference[i] = projection[at] - (double)views[v * PIXELS + at];
        gradient[i] = w * difference[i];
    }
    double size = size_of(difference, AREA);
    struct view_error error = {.difference = projector_error(v, volume[b]) + unit * size};
    error.gradient = w * (error.difference + 3.0 * unit * size);
    j->terms[V2V_LOSS_MSE] += size * size / count;
    j->allowed[V2V_LOSS_MSE] +=
        (2.0 * error.difference * size + error.difference * error.difference) / count;
    judge_spectrum(j, &error, gradient, difference, 1.0 / count);
    memset(projection, 0, sizeof projection);
    for (int i = 0; i < AREA; i++) {
        projection[(Y0 + i / NX) * SIDE + X0 + i % NX] = gradient[i];
    }
    twin_project_adjoint(j->gradient[b], projection, psf.data + v * SLICES * TAPS, &shape);
    /* The adjoint of one view: every slice's kernel sums to less than 1, all of them to 1; its own
     * stages as in projector_error. */
    double stages = 3.0 * log2((double)((SIDE + KERNEL) * (SIDE + KERNEL))) + 4.0;
    j->allowed_gradient += error.gradient + 2.0 * unit * sqrt(stages) * size_of(gradient, AREA);
}

/* ---- the terms of the volumes ---- */

static double background(void)
{
    static float mean_view[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        double sum = 0.0;
        for (int v = 0; v < VIEWS; v++) {
            sum += (double)views[v * PIXELS + i];
        }
        mean_view[i] = (float)(sum / VIEWS);
    }
    return v2v_background(mean_view, PIXELS, BINS, 0) / (v2v_psf_energy_mean(&psf) * SLICES);
}

/* Positivity and de-crosstalk are double sums of what float32 holds exactly. */
static void judge_levels(struct judged *j)
{
    double floor = background();
    double dc = config.loss.profile == V2V_LOSS_REFERENCE ? 1.0 / VOXELS : 1.0;
    for (int i = 0; i < VOXELS; i++) {
        double a = (double)volume[0][i], b = (double)volume[1][i], lack = floor - 0.5 * (a + b);
        j->terms[V2V_LOSS_DC] += dc * fmax(lack, 0.0);
        j->terms[V2V_LOSS_POS] += fmax(-a, 0.0) + fmax(-b, 0.0);
        for (int k = 0; k < BRANCHES; k++) {
            j->gradient[k][i] -= lack > 0.0 ? 0.5 * dc * weight[V2V_LOSS_DC] : 0.0;
            j->gradient[k][i] -= volume[k][i] < 0.0f ? weight[V2V_LOSS_POS] : 0.0;
        }
    }
    for (int term = V2V_LOSS_POS; term <= V2V_LOSS_DC; term++) {
        j->allowed[term] = 1e-12 * fabs(j->terms[term]);
    }
}

/* Axial smoothness: bends are float32 sums of six numbers; where one is within their rounding its
 * sign is anyone's guess, worth 2 |(2,1,1)| steps in the gradient of either branch. */
static void judge_smoothness(struct judged *j)
{
    double tv = 1.0 / ((SLICES - 2) * PIXELS), step = 0.5 * weight[V2V_LOSS_TV] * tv, guesses = 0.0;
    for (int i = PIXELS; i < VOXELS - PIXELS; i++) {
        double bend = 0.0, moduli = 0.0;
        for (int k = 0; k < BRANCHES; k++) {
            const float *x = volume[k] + i;
            double before = (double)x[-PIXELS], after = (double)x[PIXELS], here = (double)x[0];
            bend += 0.5 * (2.0 * here - before - after);
            moduli += 0.5 * (2.0 * fabs(here) + fabs(before) + fabs(after));
        }
        double off = 6.0 * unit * moduli + 0x1p-149, sign = (bend > 0.0) - (bend < 0.0);
        j->terms[V2V_LOSS_TV] += tv * fabs(bend);
        j->allowed[V2V_LOSS_TV] += tv * off;
        guesses += bend != 0.0 && fabs(bend) <= off ? 2.0 * 4.0 * 6.0 : 0.0;
        for (int k = 0; k < BRANCHES; k++) {
            double *g = j->gradient[k] + i;
            g[0] += 2.0 * step * sign;
            g[-PIXELS] -= step * sign;
            g[PIXELS] -= step * sign;
        }
    }
    j->allowed_gradient += step * sqrt(guesses);
}

static void judge(struct judged *j)
{
    memset(j, 0, sizeof *j);
    for (int b = 0; b < BRANCHES; b++) {
        int64_t seen = b == 0 ? VIEWS / 2 : (VIEWS + 1) / 2;
        for (int64_t v = 1 - b; v < VIEWS; v += BRANCHES) {
            judge_view(j, b, v, seen);
        }
    }
    judge_levels(j);
    judge_smoothness(j);
    for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
        j->terms[V2V_LOSS_TOTAL] += weight[i] * j->terms[i];
        j->allowed[V2V_LOSS_TOTAL] += weight[i] * j->allowed[i];
    }
    /* the terms' shares are added one after the other, weights are rounded to float32 */
    j->allowed_gradient += 8.0 * unit * size_of(&j->gradient[0][0], BRANCHES * VOXELS);
}

static double relative(double error, double size)
{
    return size > 0.0 ? error / size : error;
}

static void check(int profile)
{
    static struct judged j;
    setup(profile);
    print_message("%-10s %9s | %9s %9s | %9s %9s | %9s %9s\n",
                  profile == V2V_LOSS_PAPER ? "paper" : "reference", "total", "fft off", "bound",
                  "total off", "bound", "gradient", "bound");
    for (int which = 0; which < TEST_HARD_INPUTS; which++) {
        double terms[V2V_LOSS_TERMS], off[V2V_LOSS_TERMS], error = 0.0;
        float *const gradients[BRANCHES] = {dvolume[0], dvolume[1]};
        const float *const volumes[BRANCHES] = {volume[0], volume[1]};
        fill(which);
        judge(&j);
        v2v_loss_evaluate(loss, terms, 3, gradients, volumes, views);
        for (int i = 0; i < V2V_LOSS_TERMS; i++) {
            off[i] = fabs(terms[i] - j.terms[i]);
        }
        for (int i = 0; i < BRANCHES * VOXELS; i++) {
            double d = (double)dvolume[i / VOXELS][i % VOXELS] - j.gradient[i / VOXELS][i % VOXELS];
            error += d * d;
        }
        error = sqrt(error);
        double size = size_of(&j.gradient[0][0], BRANCHES * VOXELS);
        double fft = j.terms[V2V_LOSS_FFT], total = j.terms[V2V_LOSS_TOTAL];
        print_message("%-10s %9.2e | %9.1e %9.1e | %9.1e %9.1e | %9.1e %9.1e\n",
                      test_hard_name(which), terms[V2V_LOSS_TOTAL],
                      relative(off[V2V_LOSS_FFT], fft), relative(j.allowed[V2V_LOSS_FFT], fft),
                      relative(off[V2V_LOSS_TOTAL], total),
                      relative(j.allowed[V2V_LOSS_TOTAL], total), relative(error, size),
                      relative(j.allowed_gradient, size));
        assert_true(isfinite(terms[V2V_LOSS_TOTAL]));
        assert_int_equal(v2v_first_not_finite(&dvolume[0][0], BRANCHES * VOXELS), -1);
        for (int i = 0; i < V2V_LOSS_TERMS; i++) {
            assert_true(off[i] <= j.allowed[i]);
        }
        assert_true(error <= j.allowed_gradient);
    }
    teardown();
}

static void losses_and_gradients_of_the_reference_err_as_transforms_do(void **state)
{
    (void)state;
    check(V2V_LOSS_REFERENCE);
}

static void losses_and_gradients_of_the_paper_err_as_transforms_do(void **state)
{
    (void)state;
    check(V2V_LOSS_PAPER);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(losses_and_gradients_of_the_reference_err_as_transforms_do),
        cmocka_unit_test(losses_and_gradients_of_the_paper_err_as_transforms_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
