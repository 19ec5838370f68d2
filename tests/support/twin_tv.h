/** Total variation as REFERENCE.md 10 has it, by plain loops in double precision. */
#ifndef V2V_TEST_TWIN_TV_H
#define V2V_TEST_TWIN_TV_H

#include "twin_data_step.h"

struct twin_tv {
    double weight, depth, curvature; /**< lambda, a and c, for PSFs that sum to 1 a view */
    double sparse;                   /**< what x costs */
    struct twin_pace {
        double step;        /**< of the duals */
        double plain;       /**< of x in the operator K */
    } pace, pace_if_filled; /**< .. from iteration 11 on, where light fills more than half */
    int64_t iterations;
};

/** The penalty of a step towards the views. */
struct twin_penalty twin_tv_penalty(const struct twin_tv *settings, const struct twin_pace *pace);

/** volume [z,height,width], in units of the noise: of views that the step has begun in units of the
 *  noise, and that it extends. @return the longest volume on the way, what is below 0 with it, over
 *  this one: a part of it is what rounding leaves */
double twin_tv_run(double *volume, struct twin_data_step *step, const struct twin_tv *settings);

#endif
