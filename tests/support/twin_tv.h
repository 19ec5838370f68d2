/** Total variation as REFERENCE.md 10 has it, by plain loops in double precision. */
#ifndef V2V_TEST_TWIN_TV_H
#define V2V_TEST_TWIN_TV_H

#include "twin_data_step.h"

struct twin_tv {
    double weight, depth, curvature; /**< lambda, a and c, for PSFs that sum to 1 a view */
    double tau;
    int64_t iterations;
};

/** volume [z,height,width], in units of the noise: of views that the step has begun in units of the
 *  noise, and that it extends. */
void twin_tv_run(double *volume, struct twin_data_step *step, const struct twin_tv *settings);

#endif
