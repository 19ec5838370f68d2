/** How much of what a network adds to an estimate is kept, without a truth. */
#ifndef METHOD_STRENGTH_H
#define METHOD_STRENGTH_H

#include "v2v3d/method/estimator.h"

/** What is missed of views left out, and what a correction d does about it. */
struct v2v_strength_sums {
    double product, square; /**< <missed, d> and <d, d> */
};

/** The c in 0 .. 1 by which c d leaves least of `fine` missed, but no more of `all` than none of d
 *  does. @kind Local. @param fine, all with a square above 0 */
double v2v_strength_of(const struct v2v_strength_sums *fine, const struct v2v_strength_sums *all);

/** Some views of a frame are left out; x and x + d are made of the others, d the correction. What
 *  the views left out speak for is the c in 0 .. 1 of the x + c d that predicts them best, by least
 *  squares of what lies finer than 8 pixels (slow errors of brightness, which the slices add up,
 *  would outweigh all else), and not so much that more of them is missed, all told, than by x; of
 *  two choices of them together, on a square of the frame where it varies most. 1 where there are
 *  no more than two views.
 *  @kind Collective(comm), a rank a choice. @param problem of the whole frame, with weights
 *  @param views [v,y,x], no offset, the same on all ranks @param averaging of views; may be NULL
 *  @return V2V_OK | V2V_STOPPED | V2V_E_MEMORY | V2V_E_INPUT (weights) | V2V_E_NUMERIC (NaN or
 *  Inf); agreed
 *  @source REFERENCE.md 14 */
enum v2v_status v2v_strength_choose(double *strength, const struct v2v_problem *problem,
                                    const float *views, const struct v2v_averaging *averaging,
                                    const struct v2v_comm *comm) V2V_MUST_CHECK;

#endif
