/** Total variation by maximum a posteriori: no training, one setting for all scenes. */
#ifndef METHOD_TV_H
#define METHOD_TV_H

#include "v2v3d/method/estimator.h"

extern const struct v2v_estimator_ops v2v_estimator_tv;

/** Weight of the runs from here on. @kind Local. */
void v2v_tv_set_lambda(struct v2v_estimator *estimator, double lambda);

#endif
