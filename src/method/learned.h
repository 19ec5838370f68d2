/** A trained network as an estimator: any row of method/networks.h. */
#ifndef METHOD_LEARNED_H
#define METHOD_LEARNED_H

#include "v2v3d/method/estimator.h"

extern const struct v2v_estimator_ops v2v_estimator_learned;

#endif
