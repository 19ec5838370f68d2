/** What a forward pass has to compute and to move, whatever computes it. */
#ifndef V2V_TEST_WORK_H
#define V2V_TEST_WORK_H

#include "network/network_table.h"
#include "v2v3d/optics/shifts.h"

struct v2v_work {
    double macs;  /**< multiply-adds */
    double bytes; /**< read and written, float32 */
};

/** Multiply-adds of a layer for one frame pixel as the reference computes it, once a view (encoder)
 *  or once a branch of `branch_views` views (U-Net):
 *      kernel^2 * in * out * (grow / shrink / stride)^2
 *  @kind Local */
double v2v_work_layer(const struct v2v_net_layer *layer, const struct v2v_model_spec *spec,
                      int64_t branch_views);

/** Weights of a layer, biases left out. @kind Local */
double v2v_work_weights(const struct v2v_net_layer *layer, const struct v2v_model_spec *spec,
                        int64_t branch_views);

/** One pass of one layer of the encoder (one view) or of the U-Net of branch 0 or 1, over a frame
 *  of `pixels`, counted as v2v_work_of does. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_work_of_layer(struct v2v_work *work, const struct v2v_net_layer *layer,
                                  const struct v2v_model_spec *spec,
                                  const struct v2v_shifts *shifts, int branch,
                                  double pixels) V2V_MUST_CHECK;

/** One forward pass of both branches over a frame of [height,width].
 *
 *  macs: the sum over layers, less what the specification's shortcuts leave out:
 *    - merging (every_slice 0): the first layer multiplies each of its merged taps once, taps *
 *      features * 8n a pixel instead of 9 * branch_views * slices * features * 8n;
 *    - Winograd (winograd 1): F(4x4,3x3) multiplies 36 times instead of 144 for a tile of
 *      16 outputs, so layers of kernel 3 and stride 1 keep a quarter. The merged first layer has
 *      that as well as 3 x 3 blocks, or takes its taps as they are, whichever is less.
 *    Additions, transforms and the border ring are left out: this is a floor.
 *  bytes: every layer reads its weights and its input once (before upsampling; the first one the
 *    features that it aligns) and writes its output once.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY
 *  @source REFERENCE.md 4 and 8 */
enum v2v_status v2v_work_of(struct v2v_work *work, const struct v2v_model_spec *spec,
                            const struct v2v_shifts *shifts, int64_t height,
                            int64_t width) V2V_MUST_CHECK;

#endif
