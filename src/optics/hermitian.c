#include "optics/hermitian.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/clones.h"
#include <string.h>

/* An entry of a block's matrices: one elimination for all of them, where LAPACK takes them one by
 * one (tests/bench/iteration.md compares). */
struct entry {
    double re[V2V_BLOCK], im[V2V_BLOCK];
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
static void product(struct entry *sum, const double *a, const double *b, int64_t columns)
{
    double re[V2V_BLOCK] = {0}, im[V2V_BLOCK] = {0};
    for (int64_t z = 0; z < columns; z++, a += V2V_BLOCK_FLOATS, b += V2V_BLOCK_FLOATS) {
#pragma omp simd
        for (int f = 0; f < V2V_BLOCK; f++) {
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
    for (int f = 0; f < V2V_BLOCK; f++) {
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
    double inverse_d[V2V_BLOCK];
    struct entry *pivot = &a[lower(k, k)];
    for (int f = 0; f < V2V_BLOCK; f++) {
        inverse_d[f] = 1.0 / pivot->re[f];
    }
    for (int64_t i = 0; i < n; i++) {
        column[i] = a[i < k ? lower(k, i) : lower(i, k)];
        for (int f = 0; i < k && f < V2V_BLOCK; f++) {
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
        for (int f = 0; f < V2V_BLOCK; f++) {
            to->re[f] = column[i].re[f] * inverse_d[f];
            to->im[f] = (i < k ? -column[i].im[f] : column[i].im[f]) * inverse_d[f];
        }
    }
    for (int f = 0; f < V2V_BLOCK; f++) {
        pivot->re[f] = -inverse_d[f];
        pivot->im[f] = 0.0;
    }
}

void v2v_hermitian_inverse(float *inverse, double *scratch, const double *matrix, int64_t n,
                           int64_t columns)
{
    const int64_t stride = columns * V2V_BLOCK_FLOATS;
    struct entry *a = (struct entry *)(void *)scratch, *column = a + v2v_hermitian_pairs(n);
    for (int64_t i = 0; i < n; i++) {
        for (int64_t j = 0; j <= i; j++) {
            product(&a[lower(i, j)], matrix + i * stride, matrix + j * stride, columns);
        }
        for (int f = 0; f < V2V_BLOCK; f++) {
            a[lower(i, i)].re[f] += 1.0;
        }
    }
    for (int64_t k = 0; k < n; k++) {
        sweep(a, column, n, k);
    }
    for (int64_t i = 0; i < n; i++) {
        for (int64_t j = i; j < n; j++, inverse += V2V_BLOCK_FLOATS) {
            const struct entry *from = &a[lower(j, i)];
            for (int f = 0; f < V2V_BLOCK; f++) {
                inverse[f] = (float)-from->re[f];
                inverse[V2V_BLOCK + f] = (float)from->im[f]; /* conjugate: the other half */
            }
        }
    }
}

/* Row i of the upper triangle: y_i = its sum, what came from above included, and what it adds to
 * the rows below. @param row its entries from the diagonal on, n of them */
V2V_SIMD_CLONES
static void multiply_row(float *y_i, const float *row, const float *x_i, int64_t n)
{
    float re[V2V_BLOCK], im[V2V_BLOCK];
#pragma omp simd
    for (int64_t f = 0; f < V2V_BLOCK; f++) { /* the diagonal is real */
        re[f] = y_i[f] + row[f] * x_i[f];
        im[f] = y_i[V2V_BLOCK + f] + row[f] * x_i[V2V_BLOCK + f];
    }
    for (int64_t j = 1; j < n; j++) {
        const float *m = row + j * V2V_BLOCK_FLOATS, *x_j = x_i + j * V2V_BLOCK_FLOATS;
        float *restrict y_j = y_i + j * V2V_BLOCK_FLOATS;
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            re[f] += m[f] * x_j[f] - m[V2V_BLOCK + f] * x_j[V2V_BLOCK + f];
            im[f] += m[f] * x_j[V2V_BLOCK + f] + m[V2V_BLOCK + f] * x_j[f];
            y_j[f] += m[f] * x_i[f] + m[V2V_BLOCK + f] * x_i[V2V_BLOCK + f];
            y_j[V2V_BLOCK + f] += m[f] * x_i[V2V_BLOCK + f] - m[V2V_BLOCK + f] * x_i[f];
        }
    }
    memcpy(y_i, re, sizeof re);
    memcpy(y_i + V2V_BLOCK, im, sizeof im);
}

void v2v_hermitian_multiply(float *y, const float *inverse, const float *x, int64_t n)
{
    memset(y, 0, (size_t)(n * V2V_BLOCK_FLOATS) * sizeof *y);
    for (int64_t i = 0; i < n; i++) {
        multiply_row(y + i * V2V_BLOCK_FLOATS, inverse, x + i * V2V_BLOCK_FLOATS, n - i);
        inverse += (n - i) * V2V_BLOCK_FLOATS;
    }
}
