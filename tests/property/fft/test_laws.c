/* The laws of a real transform, on sizes that are square, oblong, odd, prime and thin. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/fft/fft2.h"
#include <float.h>
#include <math.h>
#include <string.h>

static const double PI = 3.14159265358979323846;

static const int64_t sizes[][2] = {{1, 1},   {1, 8},   {8, 1},   {2, 2},   {7, 5},
                                   {12, 18}, {13, 64}, {64, 31}, {61, 30}, {48, 40}};
enum { SIZES = sizeof sizes / sizeof sizes[0] };

/* Relative L2 bound of one transform of n numbers in float: each of the log2(n) stages rounds a few
 * times (4 covers the radices in use), errors add like a random walk or better. */
static double bound(int64_t n)
{
    return 4 * (log2((double)n) + 2) * FLT_EPSILON;
}

struct fixture {
    int64_t ny, nx, half; /* half = nx/2+1 */
    struct v2v_fft2 *fft;
    float *a, *b;
    struct v2v_complex *fa, *fb;
};

static void setup(struct fixture *f, const int64_t size[2])
{
    *f = (struct fixture){.ny = size[0], .nx = size[1], .half = size[1] / 2 + 1};
    assert_ok(v2v_fft2_create(&f->fft, f->ny, f->nx));
    assert_ok(V2V_ALLOC(f->a, "test", f->ny * f->nx));
    assert_ok(V2V_ALLOC(f->b, "test", f->ny * f->nx));
    assert_ok(V2V_ALLOC(f->fa, "test", f->ny * f->half));
    assert_ok(V2V_ALLOC(f->fb, "test", f->ny * f->half));
    for (int64_t i = 0; i < f->ny * f->nx; i++) {
        f->a[i] = (float)v2v_random_normal(1, 0, (uint64_t)i);
        f->b[i] = (float)v2v_random_normal(1, 1, (uint64_t)i);
    }
}

static void teardown(struct fixture *f)
{
    v2v_mem_free(f->fb);
    v2v_mem_free(f->fa);
    v2v_mem_free(f->b);
    v2v_mem_free(f->a);
    v2v_fft2_destroy(&f->fft);
    assert_null(f->fft);
}

static double spectrum_distance(const struct v2v_complex *a, const struct v2v_complex *b, int64_t n)
{
    return test_relative_l2(&a->re, &b->re, 2 * n);
}

static double norm_of(const float *x, int64_t n)
{
    double sum = 0;
    for (int64_t i = 0; i < n; i++) {
        sum += (double)x[i] * x[i];
    }
    return sqrt(sum);
}

static void forward_matches_the_defining_sum(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct fixture f;
        setup(&f, sizes[i]);
        for (int64_t ky = 0; ky < f.ny; ky++) {
            for (int64_t kx = 0; kx < f.half; kx++) {
                double re = 0, im = 0;
                for (int64_t y = 0; y < f.ny; y++) {
                    for (int64_t x = 0; x < f.nx; x++) {
                        const double angle = -2 * PI *
                                             ((double)(ky * y % f.ny) / (double)f.ny +
                                              (double)(kx * x % f.nx) / (double)f.nx);
                        re += f.a[y * f.nx + x] * cos(angle);
                        im += f.a[y * f.nx + x] * sin(angle);
                    }
                }
                f.fb[ky * f.half + kx] = (struct v2v_complex){(float)re, (float)im};
            }
        }
        v2v_fft2_forward(f.fft, f.fa, f.a);
        assert_true(spectrum_distance(f.fa, f.fb, f.ny * f.half) <= bound(f.ny * f.nx));
        teardown(&f);
    }
}

static void inverse_of_forward_is_the_image_times_its_size(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct fixture f;
        setup(&f, sizes[i]);
        const int64_t n = f.ny * f.nx;
        memcpy(f.b, f.a, (size_t)n * sizeof *f.a);
        v2v_fft2_forward(f.fft, f.fa, f.a);
        assert_memory_equal(f.a, f.b, (size_t)n * sizeof *f.a); /* the image is kept */
        v2v_fft2_inverse(f.fft, f.b, f.fa);
        for (int64_t k = 0; k < n; k++) {
            f.b[k] /= (float)n;
        }
        assert_true(test_relative_l2(f.b, f.a, n) <= 2 * bound(n));
        teardown(&f);
    }
}

static void forward_is_linear(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct fixture f;
        setup(&f, sizes[i]);
        const int64_t n = f.ny * f.nx, m = f.ny * f.half;
        struct v2v_complex *combined = NULL;
        assert_ok(V2V_ALLOC(combined, "test", m));
        v2v_fft2_forward(f.fft, f.fa, f.a);
        v2v_fft2_forward(f.fft, f.fb, f.b);
        const double norm_a = norm_of(f.a, n), norm_b = norm_of(f.b, n);
        for (int64_t k = 0; k < n; k++) {
            f.a[k] = 2 * f.a[k] - 3 * f.b[k];
        }
        for (int64_t k = 0; k < m; k++) {
            f.fa[k].re = 2 * f.fa[k].re - 3 * f.fb[k].re;
            f.fa[k].im = 2 * f.fa[k].im - 3 * f.fb[k].im;
        }
        v2v_fft2_forward(f.fft, combined, f.a);
        /* Each term's error is relative to its own size; a half spectrum holds at least half of the
         * energy, hence the root. */
        const double size = norm_of(f.a, n);
        const double terms = size + 2 * norm_a + 3 * norm_b;
        assert_true(spectrum_distance(combined, f.fa, m) <= sqrt(2) * terms / size * bound(n));
        v2v_mem_free(combined);
        teardown(&f);
    }
}

static void parseval_holds(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct fixture f;
        setup(&f, sizes[i]);
        double image = 0, spectrum = 0;
        for (int64_t k = 0; k < f.ny * f.nx; k++) {
            image += (double)f.a[k] * f.a[k];
        }
        v2v_fft2_forward(f.fft, f.fa, f.a);
        for (int64_t ky = 0; ky < f.ny; ky++) {
            for (int64_t kx = 0; kx < f.half; kx++) {
                const struct v2v_complex s = f.fa[ky * f.half + kx];
                /* Columns other than 0 and nx/2 stand for themselves and their mirror. */
                const double twice = kx == 0 || 2 * kx == f.nx ? 1 : 2;
                spectrum += twice * ((double)s.re * s.re + (double)s.im * s.im);
            }
        }
        const double n = (double)(f.ny * f.nx);
        /* Energies carry twice the amplitudes' relative error. */
        assert_true(fabs(spectrum / n - image) <= 2 * bound(f.ny * f.nx) * image);
        teardown(&f);
    }
}

static void circular_shift_turns_phases(void **state)
{
    const int64_t dy = 3, dx = 5;
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct fixture f;
        setup(&f, sizes[i]);
        for (int64_t y = 0; y < f.ny; y++) {
            for (int64_t x = 0; x < f.nx; x++) {
                f.b[(y + dy) % f.ny * f.nx + (x + dx) % f.nx] = f.a[y * f.nx + x];
            }
        }
        v2v_fft2_forward(f.fft, f.fa, f.a);
        v2v_fft2_forward(f.fft, f.fb, f.b);
        for (int64_t ky = 0; ky < f.ny; ky++) {
            for (int64_t kx = 0; kx < f.half; kx++) {
                struct v2v_complex *s = &f.fa[ky * f.half + kx];
                const double angle = -2 * PI *
                                     ((double)(ky * dy % f.ny) / (double)f.ny +
                                      (double)(kx * dx % f.nx) / (double)f.nx);
                const double re = s->re * cos(angle) - s->im * sin(angle);
                s->im = (float)(s->re * sin(angle) + s->im * cos(angle));
                s->re = (float)re;
            }
        }
        assert_true(spectrum_distance(f.fb, f.fa, f.ny * f.half) <= 2 * bound(f.ny * f.nx));
        teardown(&f);
    }
}

static void one_plan_serves_many_threads_with_the_same_bits(void **state)
{
    enum { RUNS = 16 };
    struct fixture f;
    struct v2v_complex *spectra = NULL;
    (void)state;
    setup(&f, (const int64_t[2]){64, 60});
    const int64_t m = f.ny * f.half; /* 64 * 31: a multiple of 8, so rows of spectra are aligned */
    assert_ok(V2V_ALLOC(spectra, "test", RUNS * m));
    v2v_fft2_forward(f.fft, f.fa, f.a);
#pragma omp parallel for num_threads(4)
    for (int run = 0; run < RUNS; run++) {
        v2v_fft2_forward(f.fft, spectra + run * m, f.a);
    }
    for (int run = 0; run < RUNS; run++) {
        assert_memory_equal(spectra + run * m, f.fa, (size_t)m * sizeof *spectra);
    }
    v2v_mem_free(spectra);
    teardown(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_matches_the_defining_sum),
        cmocka_unit_test(inverse_of_forward_is_the_image_times_its_size),
        cmocka_unit_test(forward_is_linear),
        cmocka_unit_test(parseval_holds),
        cmocka_unit_test(circular_shift_turns_phases),
        cmocka_unit_test(one_plan_serves_many_threads_with_the_same_bits),
    };
    return cmocka_run_group_tests_name("fft.laws", tests, NULL, NULL);
}
