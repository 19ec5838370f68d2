#include "optics/spectrum_block.h"
#include "v2v3d/base/clones.h"
#include <string.h>

V2V_SIMD_CLONES
void v2v_block_split(float *split, const struct v2v_complex *spectra, int64_t stride, int64_t n,
                     int64_t width)
{
    for (int64_t i = 0; i < n; i++) {
        float *restrict re = split + i * V2V_BLOCK_FLOATS;
        float *restrict im = re + V2V_BLOCK;
        const struct v2v_complex *from = spectra + i * stride;
#pragma omp simd
        for (int64_t f = 0; f < width; f++) {
            re[f] = from[f].re;
            im[f] = from[f].im;
        }
        if (width < V2V_BLOCK) {
            memset(re + width, 0, (size_t)(V2V_BLOCK - width) * sizeof *re);
            memset(im + width, 0, (size_t)(V2V_BLOCK - width) * sizeof *im);
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
#pragma omp simd
        for (int64_t f = 0; f < width; f++) {
            to[f].re = re[f];
            to[f].im = im[f];
        }
    }
}

/* OTFs come from memory, front to back. The processor's own looking ahead ends with each page of
 * 4 KB, which is two slices. */
static inline void ask_ahead(const float *otf)
{
    enum { AHEAD = 8 * V2V_BLOCK_FLOATS, LINE = 16 };
    for (int64_t k = 0; k < V2V_BLOCK_FLOATS; k += LINE) {
        __builtin_prefetch(otf + AHEAD + k);
    }
}

V2V_SIMD_CLONES
void v2v_block_project(double *sum, const float *otf, const float *slice, int64_t slices)
{
    double *restrict sum_re = sum;
    double *restrict sum_im = sum + V2V_BLOCK;
    memset(sum, 0, V2V_BLOCK_FLOATS * sizeof *sum);
    for (int64_t z = 0; z < slices; z++) {
        const float *a_re = otf + z * V2V_BLOCK_FLOATS, *a_im = a_re + V2V_BLOCK;
        const float *b_re = slice + z * V2V_BLOCK_FLOATS, *b_im = b_re + V2V_BLOCK;
        ask_ahead(a_re);
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            const double re = b_re[f], im = b_im[f];
            sum_re[f] += a_re[f] * re - a_im[f] * im;
            sum_im[f] += a_re[f] * im + a_im[f] * re;
        }
    }
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

V2V_SIMD_CLONES
void v2v_block_rest(float *rest, const float *recorded, const double *sum)
{
#pragma omp simd
    for (int64_t f = 0; f < V2V_BLOCK_FLOATS; f++) {
        rest[f] = (float)(recorded[f] - sum[f]);
    }
}

V2V_SIMD_CLONES
void v2v_block_project_adjoint(float *slice, const float *otf, const float *view, int64_t slices)
{
    const float *b_re = view, *b_im = view + V2V_BLOCK;
    for (int64_t z = 0; z < slices; z++) {
        const float *a_re = otf + z * V2V_BLOCK_FLOATS, *a_im = a_re + V2V_BLOCK;
        float *restrict sum_re = slice + z * V2V_BLOCK_FLOATS;
        float *restrict sum_im = sum_re + V2V_BLOCK;
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            sum_re[f] += a_re[f] * b_re[f] + a_im[f] * b_im[f];
            sum_im[f] += a_re[f] * b_im[f] - a_im[f] * b_re[f];
        }
    }
}
