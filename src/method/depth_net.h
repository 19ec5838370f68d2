/** A small network that corrects a volume: convolutions in the plane, the same for every slice,
 *  between which each slice takes some channels from its neighbours.
 *
 *  Purpose: what makes a volume better where an estimator is biased, learnt from volumes alone; one
 *  set of weights serves any number of slices and views and any optics.
 *  Invariants: no biases, so that features times s give the volume times s, to the bit where s is a
 *  power of two; weights of the last layer of zero give the first feature.
 *
 *  In the interface of nn/network.h, the "views" of a frame are its features, volumes each:
 *  [V2V_FEATURES,slices,y,x], of which the first one is corrected. Sides are even.
 */
#ifndef V2V3D_METHOD_DEPTH_NET_H
#define V2V3D_METHOD_DEPTH_NET_H

#include "method/features.h"
#include "v2v3d/nn/network.h"

/* A tile with so many pixels around it has its values in the whole; it begins at even pixels. */
enum { DEPTH_NET_HALO = 8 };

extern const struct v2v_network_ops v2v_network_depth_net;

#endif
