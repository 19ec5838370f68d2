/** What a run that makes volumes says of frames unlike the one whose quality it tells. */
#ifndef V2V_CLI_VOLUMES_FRAMES_H
#define V2V_CLI_VOLUMES_FRAMES_H

#include "cli/volumes_quality.h"

/** Warn of a frame that is hardly anywhere as dark as its offset says: the reference, or the last
 *  one, where the offset may have drifted; not where the recording's own darkest samples were told
 *  already, or the offset is none.
 *  @kind Collective(world) @param is_odd out: one was @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT;
 *  agreed */
enum v2v_status v2v_volumes_judge_offset(int *is_odd, const float *reference, int64_t shown,
                                         const struct v2v_volumes_made *made,
                                         const struct v2v_session *session) V2V_MUST_CHECK;

/** Warn of frames that show nothing, as where light or camera failed, of those of which a view is
 *  less than half as bright as in the reference, or more than twice, beside the other views, that
 *  are saturated or have another zero, and of those whose views their volume explains worse than
 *  another frame's does, as where views moved (REFERENCE.md 11). Ranks share the frames.
 *  @kind   Collective(world)
 *  @param  reference [v,y,x] as recorded, less the offset, of frame `shown`, which shows something;
 *          without blind samples (v2v_blind_fill) @param is_zero_open bool: of the zero nothing
 *          was said yet
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT; agreed */
enum v2v_status v2v_volumes_judge_frames(const float *reference, int64_t shown, int is_zero_open,
                                         const struct v2v_volumes_made *made,
                                         const struct v2v_session *session) V2V_MUST_CHECK;

#endif
