/** Views and predictions as the camera has them, with the shading and distortion of a calibration:
 *  what undoes distortion takes noise away, so that a wrong one would seem to explain more. */
#ifndef V2V3D_EVAL_AS_RECORDED_H
#define V2V3D_EVAL_AS_RECORDED_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Frame t, less the offset, times the gain; samples that see nothing are V2V_BLIND.
 *  @kind   Local. @param views [v,y,x] out
 *  @param  saturated out: how many samples are (v2v_saturated_pixels); NULL: not asked for
 *  @param  blind out: how many see nothing; NULL: not asked for
 *  @return as v2v_recording_read_seen */
enum v2v_status v2v_as_recorded_read(float *views, int64_t *saturated, int64_t *blind,
                                     struct v2v_recording *recording,
                                     const struct v2v_scaling *scaling, int64_t t) V2V_MUST_CHECK;

/** Views v, v + 1, .. as a volume shows them, to compare with these.
 *  @kind Local. @param predicted [count,y,x] in place @param scratch [y,x] */
void v2v_as_recorded_predict(float *predicted, float *scratch,
                             const struct v2v_recording *recording, int64_t v, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
