/** The network's layers as REFERENCE.md 4 tells them, apart from room nn: what the twin computes by
 *  and what the multiply-adds are counted by. */
#ifndef V2V_TEST_NETWORK_TABLE_H
#define V2V_TEST_NETWORK_TABLE_H

#include "v2v3d/v2v/model.h"

enum { V2V_NET_ALIGNED = 0, V2V_NET_SLICES = -1, V2V_NET_FEATURES = -2 };

/** A convolution with zero padding (kernel-1)/2. Channels are numbers in the encoder and multiples
 *  of the width in a U-Net, or V2V_NET_... */
struct v2v_net_layer {
    const char *name;
    int in, out;
    int kernel, stride;
    int shrink;   /**< sides of what it reads: the frame's, divided by this */
    int grow;     /**< what it reads is upsampled by this first */
    double slope; /**< of the leaky ReLU right behind it; 1: none */
};

/** Closed by a NULL name. One encoder pass a view; one U-Net pass a branch. */
extern const struct v2v_net_layer v2v_net_encoder[], v2v_net_unet[];

/** The layer of that name in a table; it must be there. @kind Local */
const struct v2v_net_layer *v2v_net_find(const struct v2v_net_layer *table, const char *name);

/** What a layer's entry `in` or `out` means for a network of `spec` with `branch_views` views in
 *  the branch; in_unet: the entry is of v2v_net_unet. @kind Local */
int64_t v2v_net_channels(int entry, int in_unet, const struct v2v_model_spec *spec,
                         int64_t branch_views);

#endif
