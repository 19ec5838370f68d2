/** The weight of total variation, without a truth. */
#ifndef METHOD_TV_LAMBDA_H
#define METHOD_TV_LAMBDA_H

#include "v2v3d/method/estimator.h"

/** Some views of a frame are left out, volumes are made of the others with more weight and with
 *  less, and the weight is taken whose volumes predict the views left out best; on two choices of
 *  them, and on a square of the frame where it varies most. Every rank computes it by itself, to
 *  the same bits.
 *  @kind Local. @param problem of the whole frame; its deconv.lambda is not read
 *  @param views [v,y,x], no offset. @return V2V_OK | V2V_E_CONFIG (fewer than three views) |
 *  V2V_E_MEMORY | V2V_E_NUMERIC (NaN or Inf) */
enum v2v_status v2v_tv_choose_lambda(double *lambda, const struct v2v_problem *problem,
                                     const float *views) V2V_MUST_CHECK;

#endif
