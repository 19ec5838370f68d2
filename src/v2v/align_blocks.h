/* The alignment and the first 3 x 3 convolution as 3 x 3 convolutions of shifted views by minimal
 * filtering, or in bf16 by oneDNN. Merged: exact inside the one-pixel border ring. Not merged, a
 * block for every slice: exact everywhere, the shifted planes end where the frame does. */
#ifndef V2V3D_V2V_ALIGN_BLOCKS_H
#define V2V3D_V2V_ALIGN_BLOCKS_H

#include "v2v/align_conv.h"
#include "v2v/padded.h"

struct v2v_align_blocks;

enum v2v_status v2v_align_blocks_create(struct v2v_align_blocks **blocks,
                                        const struct v2v_shifts *shifts,
                                        const struct v2v_align_conv_spec *spec) V2V_MUST_CHECK;
void v2v_align_blocks_destroy(struct v2v_align_blocks **blocks);

/* The rest as in align_conv.h; the gradient of the bias is not computed here, that of the weights
 * is set, or added to. */
int v2v_align_blocks_takes_blocked(const struct v2v_align_blocks *blocks);
enum v2v_status v2v_align_blocks_plan(struct v2v_align_blocks *blocks,
                                      const struct v2v_align_conv_plan *plan) V2V_MUST_CHECK;
void v2v_align_blocks_set_weights(struct v2v_align_blocks *blocks, const float *weight,
                                  const float *bias);
void v2v_align_blocks_forward(struct v2v_align_blocks *blocks, float *out,
                              const struct v2v_padded *features,
                              const struct v2v_winograd_part *part);
void v2v_align_blocks_backward(struct v2v_align_blocks *blocks, float *dweight,
                               struct v2v_padded *dfeatures, const struct v2v_padded *features,
                               const float *dout, int sets);

#endif
