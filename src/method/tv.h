/** Total variation by maximum a posteriori: no training, one setting for all scenes. */
#ifndef METHOD_TV_H
#define METHOD_TV_H

#include "v2v3d/method/estimator.h"

extern const struct v2v_estimator_ops v2v_estimator_tv;

#endif
