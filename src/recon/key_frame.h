/** Which frame the others of its group are taken over from: the first one that isn't odd, as one
 *  that lacks a view, or that shows something in a view that others don't, nor dim beside others.
 *
 *  The choice is the recording's alone: a range of its frames, ranks and resuming change nothing.
 */
#ifndef RECON_KEY_FRAME_H
#define RECON_KEY_FRAME_H

#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"

struct v2v_key_frames;

/** Floats that the below takes. @kind Local. */
int64_t v2v_key_frames_floats(int64_t views, int64_t height, int64_t width);

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_key_frames_create(struct v2v_key_frames **keys, int64_t views, int64_t height,
                                      int64_t width) V2V_MUST_CHECK;
void v2v_key_frames_destroy(struct v2v_key_frames **keys);

/** The key frame of a group (REFERENCE.md 12).
 *  @kind Local. @param key out: `first`, if all that are looked at are odd or dim
 *  @param views scratch [v,y,x] @param first of the group; may lie before a cut
 *  @param count frames of the group
 *  @return V2V_OK | as v2v_recording_read_seen */
enum v2v_status v2v_key_frames_choose(struct v2v_key_frames *keys, int64_t *key, float *views,
                                      struct v2v_recording *recording,
                                      const struct v2v_scaling *scaling, int64_t first,
                                      int64_t count) V2V_MUST_CHECK;

#endif
