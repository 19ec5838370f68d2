#ifndef V2V3D_OP_WINOGRAD_H
#define V2V3D_OP_WINOGRAD_H

#include "v2v3d/base/status.h"
#include "v2v3d/op/gradients.h"
#include "v2v3d/op/pool.h"
#include "v2v3d/op/tiles.h"
#include "v2v3d/op/workspace.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What a convolution reads as one input channel: pixel (y,x) is base[offset + y * pitch + x] for
 *  y0 <= y < y1 and x0 <= x < x1, and zero elsewhere. */
struct v2v_plane {
    int64_t offset;
    int64_t y0, y1, x0, x1;
    int64_t owner; /**< planes that share memory are neighbours in the list and have one owner */
};

/** A 3 x 3 convolution by Winograd minimal filtering, over planes that may lie anywhere: 36
 *  multiply-adds a channel pair for every tile of 4 x 4 pixels, not 144. */
struct v2v_winograd_spec {
    int64_t in, out;
    int64_t height, width;         /**< convolved */
    int64_t out_rows;              /**< that the output array holds; 0: all */
    const struct v2v_plane *plane; /**< [in], copied */
    int64_t pitch;
    int half;    /**< 1: pixel (y,x) of a plane is read at (y/2, x/2): nearest upsampling by 2 */
    int stride2; /**< 1: the output has every second row and column */
    float slope; /**< negative slope of the fused activation, 1: none */
    int training;
    int keeps; /**< 1: each backward pass is for what the forward pass before it was given, whose
                    transformed planes are kept: 9/4 of their size. Whole images alone */
    int sets;  /**< 1: a backward pass sets its planes, which share no memory; 0: it adds to them */
    int64_t chunk_floats;            /**< most values at a time; 0: as measured fastest */
    struct v2v_workspace *workspace; /**< shared with other operators */
    struct v2v_pool *pool;           /**< of transformed weights; may be NULL */
};

struct v2v_winograd;

/** Plan for the threads that OpenMP has now. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_winograd_create(struct v2v_winograd **winograd,
                                    const struct v2v_winograd_spec *spec) V2V_MUST_CHECK;
void v2v_winograd_destroy(struct v2v_winograd **winograd);

/** Transform the weights; the bias is borrowed. @param weight [out,in,3,3] @param bias [out].
 *  @kind Local. */
void v2v_winograd_set_weights(struct v2v_winograd *winograd, const float *weight,
                              const float *bias);

/** out = leaky(conv + bias), [out,y,x]. @kind Local. */
void v2v_winograd_forward(struct v2v_winograd *winograd, float *out, const float *base);

/** A part of the tiles, to the bits of the whole. */
struct v2v_winograd_part {
    const struct v2v_tile_run *run; /**< [runs], no tile twice, row after row */
    int64_t runs;
    int64_t first_row; /**< row of tiles that comes first in out [out,out_rows,x] */
    int64_t shift;     /**< planes are read so many floats from their offsets */
    const struct v2v_tiles *in_list, *out_list; /**< planes, or channels of out, are of these tiles
                              alone (v2v_tiles_line); these images have no stride and no `half`.
                              NULL: whole images */
};

/** The same for these tiles alone; the rest of out is left as it is. @kind Local. */
void v2v_winograd_forward_part(struct v2v_winograd *winograd, float *out, const float *base,
                               const struct v2v_winograd_part *part);

/** Planes at `to->din` += adjoint of the convolution applied to dout [out,y,x], or are set to it
 *  (see `sets`, which an activation before the input asks for); weights' gradient [out,in,3,3] for
 *  the planes at `base`, after their activation. All share one transform of dout. The sums' order
 *  depends on the sizes alone. @kind Local. */
void v2v_winograd_backward(struct v2v_winograd *winograd, const struct v2v_gradients *to,
                           const float *base, const float *dout);

#ifdef __cplusplus
}
#endif

#endif
