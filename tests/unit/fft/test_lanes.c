/* Transforms of sixteen signals side by side against sums in double precision. */
#include "fft/lanes.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include <float.h>
#include <math.h>
#include <string.h>

/* Every radix alone, twice, and beside others; sizes of frames. */
static const int64_t sizes[] = {1,  2,  3,  4,  5,  7,   8,   9,   16,  25,  49,
                                12, 35, 42, 84, 90, 105, 140, 210, 280, 560, 1050};
enum { SIZES = sizeof sizes / sizeof *sizes, MOST = 1050, FLOATS = (MOST + 1) * V2V_LANES };

struct fixture {
    struct v2v_fft_lanes *plan;
    struct v2v_lanes lanes;
    float *planes, *re, *im; /* of the signals as they were */
    int64_t n;
};

static void setup(struct fixture *f, int64_t n)
{
    *f = (struct fixture){.n = n};
    assert_ok(v2v_fft_lanes_create(&f->plan, n));
    assert_ok(V2V_ALLOC(f->planes, "test", 4 * FLOATS));
    assert_ok(V2V_ALLOC(f->re, "test", FLOATS));
    assert_ok(V2V_ALLOC(f->im, "test", FLOATS));
    f->lanes = (struct v2v_lanes){f->planes, f->planes + FLOATS, f->planes + 2 * FLOATS,
                                  f->planes + 3 * FLOATS};
    for (int64_t i = 0; i < FLOATS; i++) {
        f->lanes.re[i] = f->re[i] = (float)v2v_random_normal(3, 0, (uint64_t)i);
        f->lanes.im[i] = f->im[i] = (float)v2v_random_normal(3, 1, (uint64_t)i);
    }
}

static void teardown(struct fixture *f)
{
    v2v_fft_lanes_destroy(&f->plan);
    assert_null(f->plan);
    v2v_mem_free(f->planes);
    v2v_mem_free(f->re);
    v2v_mem_free(f->im);
}

/* Squares of what number k of a lane differs by, and of what it should be. */
static void compare(double squares[2], const struct fixture *f, int64_t k, int64_t lane, double re,
                    double im)
{
    const double d_re = re - (double)f->lanes.re[k * V2V_LANES + lane];
    const double d_im = im - (double)f->lanes.im[k * V2V_LANES + lane];
    squares[0] += d_re * d_re + d_im * d_im;
    squares[1] += re * re + im * im;
}

/* Roundings of five steps at most, and of what makes real spectra, add up as squares: the root of 8
 * times 1.4 epsilon. */
static void assert_close(const double squares[2])
{
    assert_true(squares[1] > 0.0);
    assert_true(sqrt(squares[0] / squares[1]) <= 4.0 * (double)FLT_EPSILON);
}

typedef void transform(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes);

/* Sample x of a lane: of real signals re and im are samples in turn. */
static void sample_of(double sample[2], const struct fixture *f, int64_t x, int64_t lane,
                      int is_real)
{
    const int64_t at = (is_real ? x / 2 : x) * V2V_LANES + lane;
    sample[0] = (double)(is_real && x % 2 != 0 ? f->im : f->re)[at];
    sample[1] = is_real ? 0.0 : (double)f->im[at];
}

/* Some numbers of some lanes; exp(sign 2 pi i k x / length). */
static void check(transform *run, int64_t n, double sign, int is_real)
{
    struct fixture f;
    double squares[2] = {0.0, 0.0}, sample[2];
    const int64_t numbers = is_real ? n + 1 : n, length = is_real ? 2 * n : n;
    setup(&f, n);
    run(f.plan, &f.lanes);
    for (int64_t lane = 0; lane < V2V_LANES; lane += 5) {
        for (int64_t k = 0; k < numbers; k += n / 80 + 1) {
            double re = 0.0, im = 0.0;
            for (int64_t x = 0; x < length; x++) {
                const double angle =
                    sign * 2.0 * acos(-1.0) * (double)(k * x % length) / (double)length;
                sample_of(sample, &f, x, lane, is_real);
                re += sample[0] * cos(angle) - sample[1] * sin(angle);
                im += sample[0] * sin(angle) + sample[1] * cos(angle);
            }
            compare(squares, &f, k, lane, re, im);
        }
    }
    assert_close(squares);
    teardown(&f);
}

static void forward_and_inverse_are_the_sums_that_they_stand_for(void **state)
{
    (void)state;
    for (int k = 0; k < SIZES; k++) {
        check(v2v_fft_lanes_forward, sizes[k], -1.0, 0);
        check(v2v_fft_lanes_inverse, sizes[k], 1.0, 0);
    }
}

static void the_spectrum_of_real_signals_is_the_sum_that_it_stands_for(void **state)
{
    (void)state;
    for (int k = 0; k < SIZES; k++) {
        check(v2v_fft_lanes_real_forward, sizes[k], -1.0, 1);
    }
}

static void real_signals_come_back_times_their_length(void **state)
{
    (void)state;
    for (int s = 0; s < SIZES; s++) {
        struct fixture f;
        double squares[2] = {0.0, 0.0};
        setup(&f, sizes[s]);
        v2v_fft_lanes_real_forward(f.plan, &f.lanes);
        for (int64_t lane = 0; lane < V2V_LANES; lane++) { /* of which no note is taken */
            f.lanes.im[lane] = f.lanes.im[f.n * V2V_LANES + lane] = 77.0f;
        }
        v2v_fft_lanes_real_inverse(f.plan, &f.lanes);
        for (int64_t i = 0; i < f.n * V2V_LANES; i++) {
            compare(squares, &f, i / V2V_LANES, i % V2V_LANES, 2.0 * (double)f.n * f.re[i],
                    2.0 * (double)f.n * f.im[i]);
        }
        assert_close(squares);
        teardown(&f);
    }
}

static void assert_same_lane(const struct fixture *f, int64_t lane, const struct fixture *g,
                             int64_t other, int64_t numbers)
{
    for (int64_t k = 0; k < numbers; k++) {
        const int64_t a = k * V2V_LANES + lane, b = k * V2V_LANES + other;
        assert_memory_equal(&f->lanes.re[a], &g->lanes.re[b], sizeof(float));
        assert_memory_equal(&f->lanes.im[a], &g->lanes.im[b], sizeof(float));
    }
}

static void a_signal_gets_the_same_bits_in_any_lane_beside_any_others(void **state)
{
    const int64_t from = 3, to = 14;
    (void)state;
    for (int s = 0; s < SIZES; s++) {
        struct fixture f, g;
        setup(&f, sizes[s]);
        setup(&g, sizes[s]);
        for (int64_t i = 0; i < g.n; i++) {
            for (int64_t lane = 0; lane < V2V_LANES; lane++) {
                const int64_t at = i * V2V_LANES + lane;
                g.lanes.re[at] = lane == to ? f.re[i * V2V_LANES + from] : NAN;
                g.lanes.im[at] = lane == to ? f.im[i * V2V_LANES + from] : NAN;
            }
        }
        v2v_fft_lanes_real_forward(f.plan, &f.lanes);
        v2v_fft_lanes_real_forward(g.plan, &g.lanes);
        assert_same_lane(&f, from, &g, to, f.n + 1);
        v2v_fft_lanes_real_inverse(f.plan, &f.lanes);
        v2v_fft_lanes_real_inverse(g.plan, &g.lanes);
        assert_same_lane(&f, from, &g, to, f.n);
        teardown(&f);
        teardown(&g);
    }
}

/* Signals of n numbers, each `stride` floats on: into lanes and back, nothing beside them touched.
 */
static void check_turns(int64_t n, int64_t signals)
{
    enum { NUMBERS = 40, STRIDE = 2 * NUMBERS + 3 };
    static float memory[V2V_LANES * STRIDE], back[V2V_LANES * STRIDE];
    static float re[NUMBERS * V2V_LANES], im[NUMBERS * V2V_LANES];
    static struct v2v_complex beside[NUMBERS * (V2V_LANES + 1)];
    memset(re, 0x7f, sizeof re);
    memset(im, 0x7f, sizeof im);
    for (int64_t i = 0; i < V2V_LANES * STRIDE; i++) {
        memory[i] = (float)(i + 1);
        back[i] = -1.0f;
    }
    v2v_lanes_take(re, im, memory, STRIDE, n, signals);
    for (int64_t i = 0; i < n * V2V_LANES; i++) {
        const int64_t s = i % V2V_LANES, k = i / V2V_LANES;
        assert_true(re[i] == (s < signals ? memory[s * STRIDE + 2 * k] : 0.0f));
        assert_true(im[i] == (s < signals ? memory[s * STRIDE + 2 * k + 1] : 0.0f));
    }
    v2v_lanes_give(back, STRIDE, re, im, 2.0f, n, signals);
    for (int64_t i = 0; i < V2V_LANES * STRIDE; i++) {
        const int is_given = i / STRIDE < signals && i % STRIDE < 2 * n;
        assert_true(back[i] == (is_given ? 2.0f * memory[i] : -1.0f));
    }
    for (int64_t i = 0; i < NUMBERS * (V2V_LANES + 1); i++) {
        beside[i] = (struct v2v_complex){-1.0f, -1.0f};
    }
    v2v_lanes_give_beside(beside, V2V_LANES + 1, re, im, n, signals);
    for (int64_t i = 0; i < NUMBERS * (V2V_LANES + 1); i++) {
        const int64_t s = i % (V2V_LANES + 1), k = i / (V2V_LANES + 1);
        const int is_given = s < signals && k < n;
        assert_true(beside[i].re == (is_given ? re[k * V2V_LANES + s] : -1.0f));
        assert_true(beside[i].im == (is_given ? im[k * V2V_LANES + s] : -1.0f));
    }
    memset(re, 0x7f, sizeof re);
    memset(im, 0x7f, sizeof im);
    v2v_lanes_take_beside(re, im, beside, V2V_LANES + 1, n, signals);
    for (int64_t i = 0; i < n * V2V_LANES; i++) {
        const int64_t s = i % V2V_LANES, k = i / V2V_LANES;
        assert_true(re[i] == (s < signals ? memory[s * STRIDE + 2 * k] : 0.0f));
        assert_true(im[i] == (s < signals ? memory[s * STRIDE + 2 * k + 1] : 0.0f));
    }
}

static void numbers_go_into_lanes_and_back(void **state)
{
    (void)state;
    for (int64_t n = 0; n <= 40; n += n < 10 ? 1 : 10) {
        for (int64_t signals = 1; signals <= V2V_LANES; signals += 3) {
            check_turns(n, signals);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_and_inverse_are_the_sums_that_they_stand_for),
        cmocka_unit_test(the_spectrum_of_real_signals_is_the_sum_that_it_stands_for),
        cmocka_unit_test(real_signals_come_back_times_their_length),
        cmocka_unit_test(a_signal_gets_the_same_bits_in_any_lane_beside_any_others),
        cmocka_unit_test(numbers_go_into_lanes_and_back),
    };
    return cmocka_run_group_tests_name("fft.lanes", tests, NULL, NULL);
}
