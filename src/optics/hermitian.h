/** Small Hermitian matrices, one a frequency, V2V_BLOCK of them side by side. */
#ifndef V2V3D_SRC_OPTICS_HERMITIAN_H
#define V2V3D_SRC_OPTICS_HERMITIAN_H

#include <stdint.h>

/** Entries of an upper triangle with its diagonal. */
static inline int64_t v2v_hermitian_pairs(int64_t n)
{
    return n * (n + 1) / 2;
}

/** Doubles that v2v_hermitian_inverse works in. */
int64_t v2v_hermitian_scratch(int64_t n);

/** inverse = (1 + B B^H)^-1 in double precision, rounded. B B^H is positive semidefinite, so that
 *  elimination needs no pivots.
 *  @param inverse [pair,2,V2V_BLOCK] out: row by row of the upper triangle
 *  @param matrix B, [n,columns,2,V2V_BLOCK] */
void v2v_hermitian_inverse(float *inverse, double *scratch, const double *matrix, int64_t n,
                           int64_t columns);

/** y = inverse * x; both [n,2,V2V_BLOCK]. */
void v2v_hermitian_multiply(float *y, const float *inverse, const float *x, int64_t n);

#endif
