#include "optics/spectrum_block.h"
#include "v2v3d/base/clones.h"
#include <string.h>

/* Spectra are read a block of each in turn, more of them than the processor looks ahead in. */
static inline void ask_ahead(const float *from)
{
    enum { AHEAD = 8 * V2V_BLOCK_FLOATS };
    __builtin_prefetch(from + AHEAD);
    __builtin_prefetch(from + AHEAD + V2V_BLOCK);
}

V2V_SIMD_CLONES
void v2v_block_split(float *split, const struct v2v_complex *spectra, int64_t stride, int64_t n,
                     int64_t width)
{
    for (int64_t i = 0; i < n; i++) {
        float *restrict re = split + i * V2V_BLOCK_FLOATS;
        float *restrict im = re + V2V_BLOCK;
        const struct v2v_complex *from = spectra + i * stride;
        ask_ahead(&from->re);
        if (width == V2V_BLOCK) {
#pragma omp simd
            for (int64_t f = 0; f < V2V_BLOCK; f++) {
                re[f] = from[f].re;
                im[f] = from[f].im;
            }
        } else {
            for (int64_t f = 0; f < V2V_BLOCK; f++) {
                re[f] = f < width ? from[f].re : 0.0f;
                im[f] = f < width ? from[f].im : 0.0f;
            }
        }
    }
}

V2V_SIMD_CLONES
void v2v_block_merge(struct v2v_complex *spectra, const float *split, int64_t stride, int64_t n,
                     int64_t width)
{
    for (int64_t i = 0; i < n; i++) {
        const float *re = split + i * V2V_BLOCK_FLOATS;
        const float *im = re + V2V_BLOCK;
        struct v2v_complex *restrict to = spectra + i * stride;
        if (width == V2V_BLOCK) {
#pragma omp simd
            for (int64_t f = 0; f < V2V_BLOCK; f++) {
                to[f].re = re[f];
                to[f].im = im[f];
            }
        } else {
            for (int64_t f = 0; f < width; f++) {
                to[f].re = re[f];
                to[f].im = im[f];
            }
        }
    }
}

V2V_SIMD_CLONES
void v2v_block_project(double *sum, const float *otf, const float *slice, int64_t slices)
{
    double re[V2V_BLOCK] = {0}, im[V2V_BLOCK] = {0};
    for (int64_t z = 0; z < slices; z++, otf += V2V_BLOCK_FLOATS, slice += V2V_BLOCK_FLOATS) {
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            const double b_re = slice[f], b_im = slice[V2V_BLOCK + f];
            re[f] += otf[f] * b_re - otf[V2V_BLOCK + f] * b_im;
            im[f] += otf[f] * b_im + otf[V2V_BLOCK + f] * b_re;
        }
    }
    memcpy(sum, re, sizeof re);
    memcpy(sum + V2V_BLOCK, im, sizeof im);
}

V2V_SIMD_CLONES
void v2v_block_round(struct v2v_complex *spectrum, const double *sum, int64_t width)
{
#pragma omp simd
    for (int64_t f = 0; f < width; f++) {
        spectrum[f].re = (float)sum[f];
        spectrum[f].im = (float)sum[V2V_BLOCK + f];
    }
}

/* Four sums, so that none waits for another's addition. */
V2V_SIMD_CLONES
void v2v_block_rest(float *rest, const float *recorded, const float *otf, const float *slice,
                    int64_t slices)
{
    float re_re[V2V_BLOCK] = {0}, im_im[V2V_BLOCK] = {0};
    float re_im[V2V_BLOCK] = {0}, im_re[V2V_BLOCK] = {0};
    for (int64_t z = 0; z < slices; z++, otf += V2V_BLOCK_FLOATS, slice += V2V_BLOCK_FLOATS) {
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            re_re[f] += otf[f] * slice[f];
            im_im[f] += otf[V2V_BLOCK + f] * slice[V2V_BLOCK + f];
            re_im[f] += otf[f] * slice[V2V_BLOCK + f];
            im_re[f] += otf[V2V_BLOCK + f] * slice[f];
        }
    }
#pragma omp simd
    for (int64_t f = 0; f < V2V_BLOCK; f++) {
        rest[f] = recorded[f] - (re_re[f] - im_im[f]);
        rest[V2V_BLOCK + f] = recorded[V2V_BLOCK + f] - (re_im[f] + im_re[f]);
    }
}

V2V_SIMD_CLONES
void v2v_block_project_adjoint(float *slice, const float *otf, const float *view, int64_t slices)
{
    float re[V2V_BLOCK], im[V2V_BLOCK];
    memcpy(re, view, sizeof re);
    memcpy(im, view + V2V_BLOCK, sizeof im);
    for (int64_t z = 0; z < slices; z++, otf += V2V_BLOCK_FLOATS, slice += V2V_BLOCK_FLOATS) {
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            slice[f] += otf[f] * re[f] + otf[V2V_BLOCK + f] * im[f];
            slice[V2V_BLOCK + f] += otf[f] * im[f] - otf[V2V_BLOCK + f] * re[f];
        }
    }
}

V2V_SIMD_CLONES
void v2v_block_add(float *numbers, const float *others, int64_t n)
{
#pragma omp simd
    for (int64_t i = 0; i < n * V2V_BLOCK_FLOATS; i++) {
        numbers[i] += others[i];
    }
}

V2V_SIMD_CLONES
void v2v_block_descend(float *step, const float *x, int64_t n)
{
#pragma omp simd
    for (int64_t i = 0; i < n * V2V_BLOCK_FLOATS; i++) {
        step[i] = x[i] - step[i];
    }
}

V2V_SIMD_CLONES
void v2v_block_move(float *change, float *next, float *x, float relax, float unit, int64_t slices)
{
    float squares[V2V_BLOCK] = {0}, whole[V2V_BLOCK] = {0};
    for (int64_t i = 0; i < 2 * slices; i++, next += V2V_BLOCK, x += V2V_BLOCK) {
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            const float d = next[f] - x[f];
            const float moved = unit * d, size = unit * next[f];
            squares[f] += moved * moved;
            whole[f] += size * size;
            next[f] += d;
            x[f] += relax * d;
        }
    }
    memcpy(change, squares, sizeof squares);
    memcpy(change + V2V_BLOCK, whole, sizeof whole);
}
