#ifndef V2V_METHOD_SYNTHESIS_NETWORK_H
#define V2V_METHOD_SYNTHESIS_NETWORK_H

#include "v2v3d/nn/network.h"

/** A U-Net that makes a view of what the others show at every depth: REFERENCE.md 18. */
extern const struct v2v_network_ops v2v_network_synthesis;

#endif
