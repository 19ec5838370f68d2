#ifndef V2V3D_METHOD_FUSION_H
#define V2V3D_METHOD_FUSION_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/method/estimator.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Views of a frame, averaged with those of its neighbours, structures moved to where the frame has
 *  them, where nothing but noise, and brightness as a whole, changed. */
struct v2v_fusion;

/** Floats that v2v_fusion_create takes. @kind Local. */
int64_t v2v_fusion_floats(int64_t neighbours, int64_t views, int64_t height, int64_t width);

/** @kind  Local
 *  @param neighbours frames on either side; 0: frames stay as they are
 *  @param leaves_blind bool: the frame's blind samples are V2V_BLIND in what _end and _read give,
 *         and tell nothing of its noise (tensor/blind.h); else they are dark
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_fusion_create(struct v2v_fusion **fusion, int64_t neighbours, int64_t views,
                                  int64_t height, int64_t width, int leaves_blind) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_fusion_destroy(struct v2v_fusion **fusion);

/** Start with frame t: y_t, of weight 1. @kind Local, no allocation. @param views [v,y,x] of t */
void v2v_fusion_begin(struct v2v_fusion *fusion, const float *views);

/** A neighbour whose structures are where frame t has them, as far as noise lets tell.
 *  @kind   Local, no allocation; the same bits with any number of threads
 *  @param  views [v,y,x] of t, as at begin @param neighbour [v,y,x], in the same units
 *  @return [v,y,x], until the next call; `neighbour` where frame t has no noise, or samples that
 *          are not finite
 *  @cost   as two or three passes over the views; one of 16 taps of rows where something moved
 *  @source REFERENCE.md 12 */
const float *v2v_fusion_align(struct v2v_fusion *fusion, const float *views,
                              const float *neighbour);

/** Add a neighbour u: y[v,y,x] += w f y_u, w = f^-2 / (1 + 2 max(0, E - 1.5) + 12 max(0, M - 1 -
 *  1.34 / sqrt V)), where f makes its brightness that of t, E is the mean square of the smoothed
 *  difference of the two frames about a pixel, in units of what noise makes, and M that of all
 *  views. Noise of photons follows the light, and w with
 *  it.
 *  Nothing is added where E is not finite, nor anywhere where frame t is not, or has no noise.
 *  @kind   Local, no allocation; the same bits with any number of threads
 *  @param  views [v,y,x] of t, as at begin @param neighbour [v,y,x], in the same units
 *  @cost   four passes of 17 or 25 taps over the views, one without
 *  @source REFERENCE.md 12 */
void v2v_fusion_add(struct v2v_fusion *fusion, const float *views, const float *neighbour);

/** The weighted mean; saturated samples of the frame (tensor/saturation.h) stay, and none is above.
 *  @kind Local, no allocation. @param views [v,y,x] in: the frame's; out */
void v2v_fusion_end(struct v2v_fusion *fusion, float *views);

/** Of the views that _end or _read gave last, until the next begin or read; NULL: they are of one
 *  frame. @kind Local. */
const struct v2v_averaging *v2v_fusion_averaging(const struct v2v_fusion *fusion);

/** Frame t of a recording, scaled, and fused with `neighbours` frames on either side, aligned, at
 *  the ends of a recording with more on the other one; also with those beyond a cut; in a sliding
 *  window with every so many-th, which shares no page with the next. The watchdog is re-armed for
 *  every neighbour.
 *  @kind   Local, no allocation but the recording's (v2v_recording_read_seen)
 *  @param  views [v,y,x] out
 *  @return as v2v_recording_read_seen, of any of these frames */
enum v2v_status v2v_fusion_read(struct v2v_fusion *fusion, float *views,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                int64_t t) V2V_MUST_CHECK;

/** The frame's views as they were before others were averaged in, [v,y,x], until the next one is
 *  begun or aligned; NULL: none were, or its noise is not known. @kind Local. */
const float *v2v_fusion_recorded(const struct v2v_fusion *fusion);

#ifdef __cplusplus
}
#endif

#endif
