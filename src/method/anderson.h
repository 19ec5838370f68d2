/** Fixed points x = g(x) where every step is dear: mixed with the steps before. */
#ifndef V2V_METHOD_ANDERSON_H
#define V2V_METHOD_ANDERSON_H

#include "v2v3d/base/status.h"
#include <stdint.h>

struct v2v_anderson;

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_anderson_create(struct v2v_anderson **anderson, int64_t count) V2V_MUST_CHECK;
void v2v_anderson_destroy(struct v2v_anderson **anderson);

/** Forget the steps before: g is another one. @kind Local. */
void v2v_anderson_restart(struct v2v_anderson *anderson);

/** The next x. @kind Local.
 *  @param  x [count] in: where g was asked; out: where to ask next @param g [count] g(x)
 *  @source D. G. Anderson, Iterative procedures for nonlinear integral equations, J. ACM 12, 547
 *  (1965) */
void v2v_anderson_step(struct v2v_anderson *anderson, double *x, const double *g);

#endif
