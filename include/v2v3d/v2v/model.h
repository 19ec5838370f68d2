/** The two-branch network of REFERENCE.md 4.
 *
 *  Purpose: encoder, alignment + first convolution in merged form, and one U-Net a branch, each
 *  with forward and backward. Invariants: parameters are always the full, published tensors
 *  (REFERENCE.md's names and shapes); v2v_model_plan takes what one frame size needs, nothing is
 *  allocated inside a step; a rank may hold one branch or both.
 *
 *  Example (compiled by tests/unit/v2v):
 *
 *      struct v2v_model_spec spec = {.views = 13, .slices = 39, .width = 32, .features = 4,
 *                                    .branches = V2V_BRANCH_BOTH, .volume_scale = 1.0};
 *      V2V_TRY(v2v_model_create(&model, &spec, &shifts));
 *      V2V_TRY(v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model),
 *                               V2V_RULE_HASH, 7));
 *      V2V_TRY(v2v_model_plan(model, 128, 128, 0));
 *      v2v_model_forward(model, volume1, volume2, views);
 *  done:
 *      v2v_model_destroy(&model);
 */
#ifndef V2V3D_V2V_MODEL_H
#define V2V3D_V2V_MODEL_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/optics/shifts.h"
#include "v2v3d/par/grid.h"
#include "v2v3d/tensor/fields.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_BRANCH_1 = 1, V2V_BRANCH_2 = 2, V2V_BRANCH_BOTH = 3 };

/** Height and width of what the network takes are multiples of this. */
#define V2V_MODEL_GRID 32

/** Slabs that one rank can compute by itself. */
#define V2V_MODEL_MOST_SLABS 64

struct v2v_model_spec {
    int64_t views, slices, width, features;
    unsigned branches;   /**< V2V_BRANCH_...: what this rank holds */
    int backend;         /**< enum v2v_backend */
    int winograd;        /**< 1: 3 x 3 convolutions by Winograd where it is faster */
    int precision;       /**< V2V_PRECISION_F32, or _BF16: 3 x 3 convolutions that are not too small
                              in bf16, none by Winograd; needs v2v_op_bf16 */
    int every_slice;     /**< 1: the first convolution takes every slice by itself, as the
                              reference does; 0: taps that read the same pixel are merged */
    double volume_scale; /**< volume = this * the network's output */
    int split;           /**< enum v2v_view_split */
    int64_t split_seed;  /**< of V2V_VIEWS_RANDOM */
    int unaligned;       /**< 1: features are not shifted before the first convolution */
    double skip;         /**< tiles whose light is below this part of the brightest are not
                              computed; 0: all are. By Winograd, or in bf16 where
                              v2v_tile_conv_usable, and not in training */
    int64_t slabs;       /**< of rows that a frame is cut into; 0 and 1: it is not. Results depend
                              on their number by round-off, and not on who computes them */
    const struct v2v_comm *shard; /**< ranks that compute one slab each; NULL: this one all. It has
                                       as many ranks as there are slabs, or one; borrowed */
};

struct v2v_model;

/** @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT (shifts of another view or slice count)
 */
enum v2v_status v2v_model_create(struct v2v_model **model, const struct v2v_model_spec *spec,
                                 const struct v2v_shifts *shifts) V2V_MUST_CHECK;
void v2v_model_destroy(struct v2v_model **model);

const struct v2v_model_spec *v2v_model_spec(const struct v2v_model *model);

/** The table of all parameters that this rank holds (encoder, then its U-Nets), and the arenas of
 *  their values and gradients (fields->total floats each). @kind Local. */
const struct v2v_fields *v2v_model_fields(const struct v2v_model *model);
float *v2v_model_weights(struct v2v_model *model);
float *v2v_model_gradients(struct v2v_model *model);

/** What the choice of a process grid has to know of frames of [height,width]: rows, cuts, and an
 *  estimate of the memory that inference takes. @kind Local. */
void v2v_model_describe_work(struct v2v_grid_work *work, const struct v2v_model_spec *spec,
                             int64_t height, int64_t width);

/** Create primitives and workspace for frames of [height,width], multiples of V2V_MODEL_GRID; again
 *  with another size replaces the plan. `training`: keep what backward needs. Without training,
 *  Winograd computes full-size layers in strips of rows, and so does bf16 with a tolerance of
 *  skipping or where memory is limited; where it is, or a large frame is cut into slabs, one
 *  branch's weights at a time are packed, for every frame, and where that is not enough the strips
 *  are smaller. Training where memory is limited transforms inputs again that it would keep.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL */
enum v2v_status v2v_model_plan(struct v2v_model *model, int64_t height, int64_t width,
                               int training) V2V_MUST_CHECK;

/** What the next plans leave free where memory is limited, for arrays that are taken later: these
 *  floats, and more for each row of the volumes that this rank computes. @kind Local. */
void v2v_model_leave_room(struct v2v_model *model, int64_t floats, int64_t floats_a_row);

/** Rows of the volumes that this rank computes: all, or its slab's; none where there are fewer rows
 *  than slabs. After v2v_model_plan. @kind Local. */
struct v2v_part v2v_model_rows(const struct v2v_model *model);
/** Likewise rank `rank` of the shard. @kind Local. */
struct v2v_part v2v_model_rows_of(const struct v2v_model *model, int rank);

/** Volumes of the branches that this rank holds from all views; weights that changed since the last
 *  call need v2v_model_weights_changed before.
 *  @kind Collective(shard), deterministic for a thread count. @param volume1, volume2 [z,rows,x]
 *  out, rows those of v2v_model_rows; NULL for a branch not held. @param views [v,y,x], of which
 *  only the held branches' views are read when nothing is skipped */
void v2v_model_forward(struct v2v_model *model, float *volume1, float *volume2, const float *views);

/** The part of this rank's full-size layers that the last forward computed, 0 .. 1. @kind Local. */
double v2v_model_computed_part(const struct v2v_model *model);

/** Merge and repack after the weights were set or stepped; needless before v2v_model_plan, which
 *  does it. @kind Local. */
void v2v_model_weights_changed(struct v2v_model *model);

/** From now on backward tells `ready` (NULL: nobody) of gradients [first, first + count) of the
 * arena that it will not touch again, after every layer of a U-Net and after the encoder, with
 * several slabs on one rank after their sum; every float once a call of backward. @kind Local. */
void v2v_model_watch_gradients(struct v2v_model *model,
                               void (*ready)(void *context, int64_t first, int64_t count),
                               void *context);

/** Set the gradients to what the last forward makes of dL/dvolume [z,rows,x]; with several slabs
 *  the encoder's to the sum over all of them, the U-Nets' to that over this rank's; the sum over
 * the shard, in the order of its ranks, is left to the caller.
 *  @kind Collective(shard) */
void v2v_model_backward(struct v2v_model *model, const float *dvolume1, const float *dvolume2);

#ifdef __cplusplus
}
#endif

#endif
