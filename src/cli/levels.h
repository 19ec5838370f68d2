/** Frames against the levels that a network was trained at: `reconstruct`, `evaluate`. */
#ifndef V2V_CLI_LEVELS_H
#define V2V_CLI_LEVELS_H

#include "cli/command.h"
#include "v2v3d/io/level.h"

enum { V2V_LEVELS_TEXT = 256 };

/** A sentence about the frame that is farthest outside, "" where none is worth a warning.
 *  @kind Collective(world). @return V2V_OK or as v2v_level_judge; agreed
 *  @param first number of the recording's first frame */
enum v2v_status v2v_levels_compare(char text[V2V_LEVELS_TEXT], const struct v2v_level_range *range,
                                   int is_homogeneous, struct v2v_recording *recording,
                                   const struct v2v_scaling *scaling, int64_t first,
                                   const struct v2v_session *session) V2V_MUST_CHECK;

#endif
