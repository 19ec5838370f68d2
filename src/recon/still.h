/** What did not change since a key frame is taken over from it; what did is reconstructed by
 *  itself, in windows of the frame.
 *
 *  A frame depends on itself and on its key frame alone, so that ranks, order and resuming change
 *  nothing.
 */
#ifndef RECON_STILL_H
#define RECON_STILL_H

#include "v2v3d/method/estimator.h"

struct v2v_still;

/** Local: can this method's frames be taken over in part? @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_still_allow(struct v2v_grid_work *work, const struct v2v_estimator_ops *ops,
                                const struct v2v_problem *problem) V2V_MUST_CHECK;

/** @kind  Collective(shard)
 *  @param whole of whole frames, one output of whole slices; borrowed @param problem as whole's,
 *         with the tolerance in skip; what it points to is borrowed
 *  @return V2V_OK | V2V_E_MEMORY, also where the limit leaves no room for windows; agreed */
enum v2v_status v2v_still_create(struct v2v_still **still, struct v2v_estimator *whole,
                                 const struct v2v_problem *problem) V2V_MUST_CHECK;
void v2v_still_destroy(struct v2v_still **still);

/** Bytes that windows take on this rank at most, once there are some. @kind Local. */
int64_t v2v_still_planned(const struct v2v_still *still);

/** A key frame: its views [v,y,x] and its volume [slices,y,x], of the last run of `whole`.
 *  @kind Collective(shard), no allocation. */
void v2v_still_keep(struct v2v_still *still, const float *views, const float *volume);

/** The key frame's volume [slices,y,x] once more. @kind Local. */
void v2v_still_recall(const struct v2v_still *still, float *volume);

/** The volume of a frame of a key frame's group. @kind Collective(shard); a window of a size unlike
 *  the last one's is allocated anew
 *  @param  part out: computed of the frame, 0 .. 1 @param volume [slices,y,x] out
 *  @param  views [v,y,x] @param recorded those of the frame alone, whose noise is even, to tell by
 *          what changed; NULL: views are
 *  @return V2V_OK | as run and create of the method; agreed */
enum v2v_status v2v_still_run(struct v2v_still *still, double *part, float *volume,
                              const float *views, const float *recorded) V2V_MUST_CHECK;

/** The largest change that was left out so far, of the brightest light. @kind Local. */
double v2v_still_left(const struct v2v_still *still);

#endif
