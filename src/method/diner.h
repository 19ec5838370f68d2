/** A frame's volume as an implicit field whose projections are fitted to the views: DINER. */
#ifndef METHOD_DINER_H
#define METHOD_DINER_H

#include "v2v3d/method/estimator.h"

extern const struct v2v_estimator_ops v2v_estimator_diner;

#endif
