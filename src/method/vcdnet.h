/** Views to volume by a U-Net alone, without optics (Z. Wang et al., Nat. Methods 18, 551 (2021)):
 *  REFERENCE.md 16. */
#ifndef V2V3D_METHOD_VCDNET_H
#define V2V3D_METHOD_VCDNET_H

#include "v2v3d/nn/network.h"

extern const struct v2v_network_ops v2v_network_vcdnet;

#endif
