/* The first three layers of a U-Net, 95 % of its memory, in strips of rows: what lies between them
 * never exists for a large frame as a whole. For inference by minimal filtering. */
#ifndef V2V3D_NN_HEAD_H
#define V2V3D_NN_HEAD_H

#include "nn/align_conv.h"
#include "nn/layer.h"

struct v2v_head;

/* Floats of both strips that are worth their memory: a frame of 256 x 256 pixels at width 128 is
 * one strip still, without rows that are computed twice. */
#define V2V_HEAD_FLOATS ((int64_t)128 << 20)

/* What a head works on: the layers behind the alignment, the frame, and how many floats its strips
 * may take. Strips have 16 rows at least, whatever that takes. */
struct v2v_head_spec {
    const struct v2v_layer *first, *second;
    int64_t height, width;
    int64_t most_floats;
};

enum v2v_status v2v_head_create(struct v2v_head **head, const struct v2v_head_spec *spec,
                                struct v2v_align_conv *align, const struct v2v_padded *like,
                                struct v2v_workspace *workspace) V2V_MUST_CHECK;
void v2v_head_destroy(struct v2v_head **head);

/* Floats of the two strips that forward needs. */
int64_t v2v_head_floats(const struct v2v_head_spec *spec);

void v2v_head_weights_changed(struct v2v_head *head, const struct v2v_parameters *parameters);

/* out [second's channels,y,x]. */
void v2v_head_forward(struct v2v_head *head, float *out, float *strips,
                      const struct v2v_padded *features);

#endif
