/** Linear equations of few unknowns and a positive matrix that is known by its products alone:
 *  M. R. Hestenes and E. Stiefel, J. Res. Natl. Bur. Stand. 49, 409 (1952). */
#ifndef V2V3D_TENSOR_CONJUGATE_GRADIENTS_H
#define V2V3D_TENSOR_CONJUGATE_GRADIENTS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_conjugate_gradients {
    int64_t count;         /**< of unknowns */
    int steps;             /**< at most */
    double enough;         /**< they end where less of the right side's square is left */
    double *way, *product; /**< [count] room */
    /** product [count] = the matrix times `way`. Collective where it is: the same numbers on all
     *  ranks of one program, as steps go by them */
    void (*multiply)(void *of, double *product, const double *way);
    void *of;
};

/** The solution from 0. Ends where the matrix is not positive along the way. @kind as multiply.
 *  @param x [count] out @param rest [count]: the right side, then what is left of it */
void v2v_conjugate_gradients_solve(const struct v2v_conjugate_gradients *self, double *x,
                                   double *rest);

#ifdef __cplusplus
}
#endif

#endif
