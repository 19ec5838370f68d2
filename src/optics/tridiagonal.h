/** Symmetric tridiagonal matrices along z, one a frequency, V2V_BLOCK of them side by side:
 *  P = p + depth Z^T Z, with Z the forward differences of the slices. P = L D L^T, where L has ones
 *  and, below them, minus depth over the pivot before. */
#ifndef V2V3D_SRC_OPTICS_TRIDIAGONAL_H
#define V2V3D_SRC_OPTICS_TRIDIAGONAL_H

#include <stdint.h>

/** One over the pivots D. @param inverse_d [slices,V2V_BLOCK] out @param p [V2V_BLOCK], above 0
 *  @param depth 0 at least */
void v2v_tridiagonal_factor(double *inverse_d, const double *p, double depth, int64_t slices);

/** numbers <- P^-1 numbers, [slices,2,V2V_BLOCK]. @param inverse_d [slices,V2V_BLOCK] */
void v2v_tridiagonal_solve(float *numbers, const float *inverse_d, float depth, int64_t slices);

/** root = D^-1/2 L^-1 numbers, so that root^T conj(root) of two is that of their numbers with P^-1
 *  between; all [slices,2,V2V_BLOCK]. */
void v2v_tridiagonal_root(double *root, const float *numbers, const double *inverse_d, double depth,
                          int64_t slices);

#endif
