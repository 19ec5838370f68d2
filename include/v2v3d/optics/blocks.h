#ifndef V2V3D_OPTICS_BLOCKS_H
#define V2V3D_OPTICS_BLOCKS_H

#include "v2v3d/base/status.h"
#include "v2v3d/optics/shifts.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A 3 x 3 kernel over a view's features: pixels (y+k, x+l), k and l from -1 to 1. */
struct v2v_block {
    int32_t view; /**< place in the branch's list of views */
    int32_t y, x; /**< offset of the middle */
};

/** The alignment and the 3 x 3 convolution behind it as 3 x 3 convolutions of shifted views, few
 *  enough that dense kernels pay. Merged: blocks that cover all merged taps of a view, each tap
 *  given to one of them. Not merged: a block for every slice, as the reference computes. */
struct v2v_blocks {
    int64_t views, slices;
    int64_t count;
    struct v2v_block *block; /**< [count], sorted by view */
    int64_t *first;          /**< [views + 1]: a view's blocks are first[i] .. first[i+1] - 1 */
    int32_t *of;             /**< [view,z,k,l] -> block * 9 + its place in the block */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_blocks_create(struct v2v_blocks *blocks, const struct v2v_shifts *shifts,
                                  const int32_t *views, int64_t count, int merged) V2V_MUST_CHECK;
void v2v_blocks_fini(struct v2v_blocks *blocks);

#ifdef __cplusplus
}
#endif

#endif
