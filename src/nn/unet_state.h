/* The layers of a U-Net and the stacks of images between them. */
#ifndef V2V3D_NN_UNET_STATE_H
#define V2V3D_NN_UNET_STATE_H

#include "nn/stack.h"
#include "v2v3d/nn/unet.h"

/* Stacks of a level: what enters it; between its two convolutions; the skip and what lies below,
 * joined; between the two convolutions on the way up; what leaves it. At the bottom nothing is
 * joined. */
enum { ENTERS, BETWEEN, JOINED, ABOVE, LEAVES, KINDS };
enum {
    MOST_LEVELS = V2V_PLAIN_UNET_MOST_LEVELS,
    MOST_LAYERS = 4 * MOST_LEVELS - 1,
    MOST_STACKS = KINDS * MOST_LEVELS
};

/* Layers in the order of the computation, and the stacks that they convolve and whose first
 * channels they make; the last makes the output, -1. */
struct v2v_wire {
    int from, to;
};

struct v2v_plain_unet {
    struct v2v_plain_unet_spec spec;
    int layers;
    struct v2v_layer layer[MOST_LAYERS]; /* of one image each, or of three as one */
    struct v2v_wire wire[MOST_LAYERS];
    int training; /* as planned */
    float *memory;
    struct v2v_stack stack[MOST_STACKS], gradient[MOST_STACKS];
    uint8_t *which[MOST_LEVELS]; /* of the pools below the levels */
    float *scratch;              /* gradient of three images as one, in training */
};

static inline int v2v_unet_stack(int level, int kind)
{
    return KINDS * level + kind;
}

#endif
