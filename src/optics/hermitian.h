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

/** inverse = (B B^H + c)^-1 in double precision, rounded. B B^H is positive semidefinite and c > 0,
 *  so that elimination needs no pivots.
 *  @param c [V2V_BLOCK]
 *  @param inverse [pair,2,V2V_BLOCK] out: row by row of the upper triangle
 *  @param matrix B, [n,columns,2,V2V_BLOCK] */
void v2v_hermitian_inverse(float *inverse, double *scratch, const float *matrix, int64_t n,
                           int64_t columns, const double *c);

/** y = inverse * x; both [n,2,V2V_BLOCK]. */
void v2v_hermitian_multiply(float *y, const float *inverse, const float *x, int64_t n);

#endif
