/** Denoising of a recording by itself, a view at a time (X. Li et al., Nat. Biotechnol. 41, 282
 *  (2023)): REFERENCE.md 16. */
#ifndef V2V3D_METHOD_DEEPCAD_H
#define V2V3D_METHOD_DEEPCAD_H

#include "v2v3d/nn/network.h"

extern const struct v2v_network_ops v2v_network_deepcad;

#endif
