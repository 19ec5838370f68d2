#ifndef V2V3D_OP_TILE_CONV_H
#define V2V3D_OP_TILE_CONV_H

#include "v2v3d/base/status.h"
#include "v2v3d/op/winograd.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A 3 x 3 convolution in bf16 with sums in float32, of listed tiles alone. What one hands to the
 *  next is blocked (op/blocked.h), an image of one row: the tiles side by side in the list's order,
 *  each with its 16 pixels. */
struct v2v_tile_conv_spec {
    int64_t in, out;
    int64_t height, width;         /**< convolved, whole tiles */
    const struct v2v_plane *plane; /**< [in] of a plain input, copied; NULL: it is listed tiles */
    int64_t pitch;
    int half;           /**< as in v2v_winograd_spec */
    int64_t in_pixels;  /**< of a listed input, that its array holds */
    int64_t out_pixels; /**< of a listed output; 0: it is plain, the whole image [out,y,x] */
    int stride2;        /**< 1: a plain output has every second row and column */
    float slope;        /**< negative slope of the fused activation, 1: none */
    struct v2v_workspace *workspace;
    struct v2v_pool *pool; /**< of packed weights; may be NULL */
};

struct v2v_tile_conv;

/** Has the processor instructions for bf16, the tile unit's or AVX-512's? @kind Local. */
int v2v_tile_conv_usable(void);

/** Plan for the threads that OpenMP has now; where v2v_tile_conv_usable. @kind Local.
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_tile_conv_create(struct v2v_tile_conv **conv,
                                     const struct v2v_tile_conv_spec *spec) V2V_MUST_CHECK;
void v2v_tile_conv_destroy(struct v2v_tile_conv **conv);

/** Pack the weights; the bias is borrowed. @kind Local. @param weight [out,in,3,3] @param bias
 *  [out] */
void v2v_tile_conv_set_weights(struct v2v_tile_conv *conv, const float *weight, const float *bias);

/** Tiles of a part, as of v2v_winograd_part: a listed input's first pixel is number -shift of its
 *  list, a listed output begins with row `first_row` of tiles, a plain one is whole. A pixel that a
 *  list does not have is the nearest one that it has, as v2v_tiles_line takes it. The sum of an
 *  output has the same order whatever part it is in, and whatever the threads.
 *  @kind Local. @param in base of the planes, or listed tiles */
void v2v_tile_conv_forward(struct v2v_tile_conv *conv, float *out, const float *in,
                           const struct v2v_winograd_part *part);

#ifdef __cplusplus
}
#endif

#endif
