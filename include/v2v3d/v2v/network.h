#ifndef V2V3D_V2V_NETWORK_H
#define V2V3D_V2V_NETWORK_H

#include "v2v3d/nn/network.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The paper's network as a method: two volumes, from the even and from the odd views; the
 *  encoder's parameters are one group, each U-Net's another. */
extern const struct v2v_network_ops v2v_network_v2v;

#ifdef __cplusplus
}
#endif

#endif
