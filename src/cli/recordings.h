/** Volumes of several recordings in one run: which they are, what their outputs are called, and
 *  what becomes of the others when one fails. */
#ifndef V2V_CLI_RECORDINGS_H
#define V2V_CLI_RECORDINGS_H

#include "cli/volumes.h"

/** Rows of the options of a command that makes volumes of recordings. */
#define V2V_OPTION_RECORDINGS                                                                      \
    {                                                                                              \
        .name = "input", .kind = V2V_OPTION_LIST, .at = offsetof(struct v2v_volumes, inputs),      \
        .value = "FILE...", .required = 1,                                                         \
        .help = "recordings; 'rec_*.h5' means all of such names, @FILE those listed in it, one a " \
                "line"                                                                             \
    }
#define V2V_OPTION_VOLUMES_OUTPUT(text)                                                            \
    V2V_OPTION_OUTPUT(struct v2v_volumes, output,                                                  \
                      text "; of several recordings a folder, or a name with %n for theirs")

/** v2v_volumes_make for each recording of given->inputs, one after the other. A recording that
 *  fails by itself (bad input, or another run is at work on its output) is told, and does not keep
 *  the others from their volumes; any other failure ends the run.
 *  @kind Collective(world). @return agreed: V2V_OK | that of the first recording that failed */
enum v2v_status v2v_recordings_make(const struct v2v_volumes *given,
                                    const struct v2v_estimator_ops *ops,
                                    struct v2v_session *session) V2V_MUST_CHECK;

#endif
