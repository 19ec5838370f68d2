/** A trained network as an estimator: any row of method/networks.h. */
#ifndef METHOD_LEARNED_H
#define METHOD_LEARNED_H

#include "v2v3d/method/estimator.h"

/** The network that a problem asks for, all of its outputs. @kind Local. */
struct v2v_network_spec v2v_learned_spec(const struct v2v_problem *problem);

extern const struct v2v_estimator_ops v2v_estimator_learned;

#endif
