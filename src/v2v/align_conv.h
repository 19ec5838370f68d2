/* Alignment and the first 3 x 3 convolution of a U-Net in one (REFERENCE.md 8): the aligned
 * features never exist. */
#ifndef V2V3D_V2V_ALIGN_CONV_H
#define V2V3D_V2V_ALIGN_CONV_H

#include "v2v/padded.h"
#include "v2v3d/op/conv.h"
#include "v2v3d/op/winograd.h"
#include "v2v3d/optics/shifts.h"

struct v2v_align_conv;

struct v2v_align_conv_spec {
    const int32_t *views; /* the branch's views, in network order */
    int64_t view_count;
    int64_t features, out;
    float slope;     /* of the activation after it */
    int every_slice; /* 1: taps are not merged, as the reference computes */
    struct v2v_conv_method method;
};

enum v2v_status v2v_align_conv_create(struct v2v_align_conv **conv, const struct v2v_shifts *shifts,
                                      const struct v2v_align_conv_spec *spec) V2V_MUST_CHECK;
void v2v_align_conv_destroy(struct v2v_align_conv **conv);

/* Can the next plan's output be blocked? Where the blocks can be computed so, not in training. */
int v2v_align_conv_takes_blocked(const struct v2v_align_conv *conv);

/* Scratch for features of the sizes of `like`. */
struct v2v_align_conv_plan {
    const struct v2v_padded *like;
    int64_t out_rows; /* that the output array holds */
    int training;
    int out_form;  /* enum v2v_form */
    int is_listed; /* parts alone, in bf16 by v2v_tile_conv, blocked */
};

enum v2v_status v2v_align_conv_plan(struct v2v_align_conv *conv,
                                    const struct v2v_align_conv_plan *plan) V2V_MUST_CHECK;

/* Merge the full weights [out,(view,feature,z),3,3]; bias [out] is borrowed. */
void v2v_align_conv_set_weights(struct v2v_align_conv *conv, const float *weight,
                                const float *bias);

/* out[o,y,x], or blocked as planned, = leaky(bias + sum of taps), for a part of the tiles as
 * v2v_winograd_forward_part (its shift is 0); NULL: all. */
void v2v_align_conv_forward(struct v2v_align_conv *conv, float *out,
                            const struct v2v_padded *features,
                            const struct v2v_winograd_part *part);

/* dweight and dbias are set, dfeatures are added to; dout is the gradient before the activation and
 * is used up. */
void v2v_align_conv_backward(struct v2v_align_conv *conv, float *dweight, float *dbias,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features,
                             float *dout);

#endif
