/* The alignment and the first 3 x 3 convolution as a convolution with sparse taps: rows of pixels
 * are gathered for one matrix product each. Exact on the one-pixel border ring too, where kernel
 * rows or columns that leave the frame are left out. */
#ifndef V2V3D_V2V_ALIGN_TAPS_H
#define V2V3D_V2V_ALIGN_TAPS_H

#include "v2v/align_conv.h"
#include "v2v/padded.h"

struct v2v_align_taps;

/* `ring_only`: the border ring's pixels alone are computed. */
enum v2v_status v2v_align_taps_create(struct v2v_align_taps **taps, const struct v2v_shifts *shifts,
                                      const struct v2v_align_conv_spec *spec,
                                      int ring_only) V2V_MUST_CHECK;
void v2v_align_taps_destroy(struct v2v_align_taps **taps);

/* The rest as in align_conv.h; the gradient of the bias is not computed here, that of the weights
 * is set. */
enum v2v_status v2v_align_taps_plan(struct v2v_align_taps *taps,
                                    const struct v2v_align_conv_plan *plan) V2V_MUST_CHECK;
void v2v_align_taps_set_weights(struct v2v_align_taps *taps, const float *weight,
                                const float *bias);
void v2v_align_taps_forward(struct v2v_align_taps *taps, float *out,
                            const struct v2v_padded *features,
                            const struct v2v_winograd_part *part);
void v2v_align_taps_backward(struct v2v_align_taps *taps, float *dweight,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features,
                             const float *dout);

#endif
