#ifndef V2V3D_EVAL_FIRST_SEEN_H
#define V2V3D_EVAL_FIRST_SEEN_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The first frame of a recording that shows something above its noise, less the offset; if a view
 *  of it is dark, the first of the next few that lacks none. Where none shows anything, the first
 *  with a sample above the offset, or frame 0. Rank 0 reads, so that all have the same.
 *  @kind  Collective(comm)
 *  @param is_seen bool, out: does it show something?
 *  @return V2V_OK | V2V_E_INPUT (a frame that cannot be read) | V2V_E_MEMORY; agreed
 *  @source REFERENCE.md 10 */
enum v2v_status v2v_first_seen(int64_t *frame, int *is_seen, struct v2v_recording *recording,
                               const struct v2v_scaling *scaling,
                               const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
