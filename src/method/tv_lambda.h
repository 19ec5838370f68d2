/** The weights of total variation, without a truth. */
#ifndef METHOD_TV_LAMBDA_H
#define METHOD_TV_LAMBDA_H

#include "v2v3d/method/estimator.h"

/** Numbers of what deconv.lambda and deconv.sparsity say. `auto`: views of a frame are left out,
 *  volumes are made of the others with more weight and with less, and the weight is taken
 *  whose volumes predict the views left out best; on two choices of them, and on a square of
 *  the frame where it varies most (what of it: v2v_square_views).
 *  `default`: as the noise says; where the square's volume misses its views by more than their
 *  noise, as where they are out of register, as `auto`; where half of that surely predicts one
 *  choice of views better, the weight downhill from there that predicts both best, if it surely
 *  does and is below 0.6 of it (0.2 of sharp PSFs), as of points and lines; else, of PSFs of few
 *  slices, the weight uphill that predicts both best, above 1.2 of it. Of three views that is not
 *  asked, of one or two nothing is. A sparsity that is left open is 0, but 1 where less is
 *  wanted and it predicts better still. The ranks of a host share the volumes, never the answer.
 *  @kind Collective(world). @param deconv in and out, both then of mode V2V_NUMBER_GIVEN unless
 *  lambda was @param problem of the whole frame; its deconv.lambda is not read
 *  @param views [v,y,x], no offset
 *  @param averaging of views; may be NULL
 *  @return V2V_OK | V2V_STOPPED | V2V_E_CONFIG (auto: fewer than three views) | V2V_E_MEMORY |
 *  V2V_E_NUMERIC (NaN or Inf)
 *  @source REFERENCE.md 10 */
enum v2v_status v2v_tv_settle_weights(struct v2v_deconv_settings *deconv,
                                      const struct v2v_problem *problem, const float *views,
                                      const struct v2v_averaging *averaging,
                                      const struct v2v_comm *world) V2V_MUST_CHECK;

#endif
