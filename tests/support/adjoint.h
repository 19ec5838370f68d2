/** One test for every adjoint: <A x, y> = <x, A^T y>, without anything to compare with but the
 *  operator itself; single columns and rows of it, dense vectors with y along A x, and drawn ones.
 */
#ifndef V2V_TEST_ADJOINT_H
#define V2V_TEST_ADJOINT_H

#include "v2v3d/par/comm.h"
#include <stdint.h>

struct test_linear {
    const char *name;
    int64_t ins, outs; /**< of this rank */
    void *self;
    void (*forward)(void *self, float *out, const float *in); /**< out [outs] = A in [ins] */
    void (*adjoint)(void *self, float *in, const float *out); /**< in [ins] = A^T out [outs] */
    double rounding;   /**< norm of a result's error in parts of its norm, see test_rounding */
    double image_unit; /**< part of itself by which each number that comes out is rounded beside */
    const struct v2v_comm *comm; /**< the ranks that share vectors; NULL: this one has all */
};

/** What is wrong, NULL: nothing. Vectors drawn are of 7 bits, which bf16 holds. The text lives
 *  until the next call. @kind Collective(comm) */
const char *test_adjoint_fault(const struct test_linear *linear);

/** Fail when A^T is not A's adjoint, or when the test could not see that it isn't. */
void test_adjoint(const struct test_linear *linear);

#endif
