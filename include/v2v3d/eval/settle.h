/** Settings that a method leaves to a recording, as noise and weight of total variation. */
#ifndef V2V3D_EVAL_SETTLE_H
#define V2V3D_EVAL_SETTLE_H

#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/method/estimator.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Decide them by the recording's first frame that shows something above its noise and lacks no
 *  view (a shutter may open late), whatever frames are asked for: a range has the bits of the
 *  whole. Nothing is read where nothing is left open.
 *  @kind   Collective(comm)
 *  @param  config in and out: deconv and recon
 *  @param  problem of the recording's frames, with that configuration
 *  @return V2V_OK | V2V_STOPPED | V2V_E_MEMORY | V2V_E_INPUT (reading) | V2V_E_CONFIG |
 *          V2V_E_NUMERIC; agreed */
enum v2v_status v2v_settle_by_frame(struct v2v_config *config, const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem,
                                    struct v2v_recording *recording,
                                    const struct v2v_scaling *scaling,
                                    const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
