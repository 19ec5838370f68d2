/** Total variation's volume and what it misses of the views, put right by a network of slices. */
#ifndef METHOD_UNROLLED_H
#define METHOD_UNROLLED_H

#include "v2v3d/method/estimator.h"

/** The volume of total variation that the last run corrected, [z,y,x]: lent. @kind Local. */
const float *v2v_unrolled_start(const struct v2v_estimator *estimator);

extern const struct v2v_estimator_ops v2v_estimator_unrolled;

#endif
