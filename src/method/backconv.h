/** The smallest network that can be trained view to view: three convolutions of the back-projected
 *  views, the same for both halves. What it is good for: to show what a method has to bring. */
#ifndef V2V3D_METHOD_BACKCONV_H
#define V2V3D_METHOD_BACKCONV_H

#include "v2v3d/nn/network.h"

extern const struct v2v_network_ops v2v_network_backconv;

#endif
