#include "optics/tridiagonal.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/clones.h"
#include <math.h>

void v2v_tridiagonal_factor(double *inverse_d, const double *p, double depth, int64_t slices)
{
    for (int64_t z = 0; z < slices; z++) {
        const double neighbours = (double)(z > 0) + (double)(z + 1 < slices);
        double *own = inverse_d + z * V2V_BLOCK;
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            const double eliminated = z > 0 ? depth * depth * own[f - V2V_BLOCK] : 0.0;
            own[f] = 1.0 / (p[f] + depth * neighbours - eliminated);
        }
    }
}

V2V_SIMD_CLONES
void v2v_tridiagonal_solve(float *numbers, const float *inverse_d, float depth, int64_t slices)
{
    float re[V2V_BLOCK] = {0}, im[V2V_BLOCK] = {0};
    for (int64_t z = 0; z < slices; z++, numbers += V2V_BLOCK_FLOATS, inverse_d += V2V_BLOCK) {
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            re[f] = inverse_d[f] * (numbers[f] + depth * re[f]);
            im[f] = inverse_d[f] * (numbers[V2V_BLOCK + f] + depth * im[f]);
            numbers[f] = re[f];
            numbers[V2V_BLOCK + f] = im[f];
        }
    }
    numbers -= V2V_BLOCK_FLOATS; /* the last slice is done */
    inverse_d -= V2V_BLOCK;
    for (int64_t z = slices - 1; z > 0; z--) {
        numbers -= V2V_BLOCK_FLOATS;
        inverse_d -= V2V_BLOCK;
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            re[f] = numbers[f] + depth * inverse_d[f] * re[f];
            im[f] = numbers[V2V_BLOCK + f] + depth * inverse_d[f] * im[f];
            numbers[f] = re[f];
            numbers[V2V_BLOCK + f] = im[f];
        }
    }
}

V2V_SIMD_CLONES
void v2v_tridiagonal_root(double *root, const float *numbers, const double *inverse_d, double depth,
                          int64_t slices)
{
    double re[V2V_BLOCK] = {0}, im[V2V_BLOCK] = {0}; /* of L^-1 numbers, over the pivot */
    for (int64_t z = 0; z < slices; z++) {
        const double *d = inverse_d + z * V2V_BLOCK;
#pragma omp simd
        for (int64_t f = 0; f < V2V_BLOCK; f++) {
            const double own = sqrt(d[f]);
            const double y_re = numbers[f] + depth * re[f];
            const double y_im = numbers[V2V_BLOCK + f] + depth * im[f];
            root[f] = own * y_re;
            root[V2V_BLOCK + f] = own * y_im;
            re[f] = d[f] * y_re;
            im[f] = d[f] * y_im;
        }
        root += V2V_BLOCK_FLOATS;
        numbers += V2V_BLOCK_FLOATS;
    }
}
