#include "optics/hermitian.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/clones.h"
#include <string.h>

/* Matrices of one elimination: LAPACK takes them one by one (tests/bench/README.md compares). */
enum { LANES = 16 };

/* An entry of LANES matrices. */
struct entry {
    double re[LANES], im[LANES];
};

/* Entry (i,j), j <= i, of a lower triangle. */
static int64_t lower(int64_t i, int64_t j)
{
    return i * (i + 1) / 2 + j;
}

int64_t v2v_hermitian_scratch(int64_t n)
{
    return (v2v_hermitian_pairs(n) + n) * (int64_t)(sizeof(struct entry) / sizeof(double));
}

/* sum over z of a[z] conj(b[z]). */
V2V_SIMD_CLONES
static void product(struct entry *sum, const float *a, const float *b, int64_t columns)
{
    double re[LANES] = {0}, im[LANES] = {0};
    for (int64_t z = 0; z < columns; z++, a += V2V_BLOCK_FLOATS, b += V2V_BLOCK_FLOATS) {
#pragma omp simd
        for (int f = 0; f < LANES; f++) {
            const double a_re = a[f], a_im = a[V2V_BLOCK + f];
            const double b_re = b[f], b_im = b[V2V_BLOCK + f];
            re[f] += a_re * b_re + a_im * b_im;
            im[f] += a_im * b_re - a_re * b_im;
        }
    }
    memcpy(sum->re, re, sizeof re);
    memcpy(sum->im, im, sizeof im);
}

/* a -= b conj(c) / d. */
static inline void take_away(struct entry *restrict a, const struct entry *b, const struct entry *c,
                             const double *inverse_d)
{
#pragma omp simd
    for (int f = 0; f < LANES; f++) {
        const double re = b->re[f] * inverse_d[f], im = b->im[f] * inverse_d[f];
        a->re[f] -= re * c->re[f] + im * c->im[f];
        a->im[f] -= im * c->re[f] - re * c->im[f];
    }
}

/* Pivot k of a symmetric Gauss-Jordan elimination in place; all n of them leave minus the inverse.
 * column: [n], scratch. */
V2V_SIMD_CLONES
static void sweep(struct entry *a, struct entry *column, int64_t n, int64_t k)
{
    double inverse_d[LANES];
    struct entry *pivot = &a[lower(k, k)];
    for (int f = 0; f < LANES; f++) {
        inverse_d[f] = 1.0 / pivot->re[f];
    }
    for (int64_t i = 0; i < n; i++) {
        column[i] = a[i < k ? lower(k, i) : lower(i, k)];
        for (int f = 0; i < k && f < LANES; f++) {
            column[i].im[f] = -column[i].im[f];
        }
    }
    for (int64_t i = 0; i < n; i++) {
        for (int64_t j = 0; i != k && j <= i; j++) {
            if (j != k) {
                take_away(&a[lower(i, j)], &column[i], &column[j], inverse_d);
            }
        }
    }
    for (int64_t i = 0; i < n; i++) {
        struct entry *to = &a[i < k ? lower(k, i) : lower(i, k)];
#pragma omp simd
        for (int f = 0; f < LANES; f++) {
            to->re[f] = column[i].re[f] * inverse_d[f];
            to->im[f] = (i < k ? -column[i].im[f] : column[i].im[f]) * inverse_d[f];
        }
    }
    for (int f = 0; f < LANES; f++) {
        pivot->re[f] = -inverse_d[f];
        pivot->im[f] = 0.0;
    }
}

/* LANES frequencies from `at` on. */
static void invert(float *inverse, struct entry *a, const float *matrix, int64_t n, int64_t columns,
                   double c, int64_t at)
{
    const int64_t stride = columns * V2V_BLOCK_FLOATS;
    struct entry *column = a + v2v_hermitian_pairs(n);
    for (int64_t i = 0; i < n; i++) {
        for (int64_t j = 0; j <= i; j++) {
            product(&a[lower(i, j)], matrix + i * stride + at, matrix + j * stride + at, columns);
        }
        for (int f = 0; f < LANES; f++) {
            a[lower(i, i)].re[f] += c;
        }
    }
    for (int64_t k = 0; k < n; k++) {
        sweep(a, column, n, k);
    }
    for (int64_t i = 0; i < n; i++) {
        for (int64_t j = i; j < n; j++, inverse += V2V_BLOCK_FLOATS) {
            const struct entry *from = &a[lower(j, i)];
            for (int f = 0; f < LANES; f++) {
                inverse[at + f] = (float)-from->re[f];
                inverse[V2V_BLOCK + at + f] = (float)from->im[f]; /* conjugate: the other half */
            }
        }
    }
}

void v2v_hermitian_inverse(float *inverse, double *scratch, const float *matrix, int64_t n,
                           int64_t columns, double c)
{
    struct entry *a = (struct entry *)(void *)scratch;
    for (int64_t at = 0; at < V2V_BLOCK; at += LANES) {
        invert(inverse, a, matrix, n, columns, c, at);
    }
}

/* y_i += m x_j, and y_j += conj(m) x_i where they are two. */
static inline void multiply_pair(float *restrict y_i, float *restrict y_j, const float *m,
                                 const float *x_i, const float *x_j)
{
#pragma omp simd
    for (int64_t f = 0; f < V2V_BLOCK; f++) {
        const float re = m[f], im = m[V2V_BLOCK + f];
        y_i[f] += re * x_j[f] - im * x_j[V2V_BLOCK + f];
        y_i[V2V_BLOCK + f] += re * x_j[V2V_BLOCK + f] + im * x_j[f];
        y_j[f] += re * x_i[f] + im * x_i[V2V_BLOCK + f];
        y_j[V2V_BLOCK + f] += re * x_i[V2V_BLOCK + f] - im * x_i[f];
    }
}

V2V_SIMD_CLONES
void v2v_hermitian_multiply(float *y, const float *inverse, const float *x, int64_t n)
{
    memset(y, 0, (size_t)(n * V2V_BLOCK_FLOATS) * sizeof *y);
    for (int64_t i = 0; i < n; i++) {
        const float *x_i = x + i * V2V_BLOCK_FLOATS;
        float *restrict y_i = y + i * V2V_BLOCK_FLOATS;
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) { /* real */
            y_i[f] += inverse[f] * x_i[f];
            y_i[V2V_BLOCK + f] += inverse[f] * x_i[V2V_BLOCK + f];
        }
        inverse += V2V_BLOCK_FLOATS;
        for (int64_t j = i + 1; j < n; j++, inverse += V2V_BLOCK_FLOATS) {
            multiply_pair(y_i, y + j * V2V_BLOCK_FLOATS, inverse, x_i, x + j * V2V_BLOCK_FLOATS);
        }
    }
}
