/** Volumes of a recording, by whatever method: what `reconstruct`, `deconvolve` and the demo share.
 */
#ifndef V2V_CLI_VOLUMES_H
#define V2V_CLI_VOLUMES_H

#include "cli/command.h"
#include "v2v3d/method/estimator.h"

/** Arguments of a command that makes volumes. */
struct v2v_volumes {
    struct v2v_common common;
    const char *psf, *weights, *calibration, *input, *output;
    const char *frames; /* FIRST:COUNT; NULL: all */
    int branches, resume;
    double *seconds; /* [2] out, where not NULL: until all is ready, and then for the frames */
};

/** Rows of its options. */
#define V2V_OPTIONS_VOLUMES                                                                        \
    V2V_OPTION_CALIBRATION(struct v2v_volumes, calibration),                                       \
        V2V_OPTION_SWITCH(struct v2v_volumes, resume, "resume",                                    \
                          "go on with what an interrupted run left; a complete output stays"),     \
    {                                                                                              \
        .name = "frames", .kind = V2V_OPTION_TEXT, .at = offsetof(struct v2v_volumes, frames),     \
        .value = "FIRST:COUNT", .help = "these of the recording, from 0; fewer where it ends"      \
    }

#define V2V_OPTION_NEIGHBOURS                                                                      \
    V2V_OPTION_SET(                                                                                \
        "neighbours", "recon.neighbours", "N",                                                     \
        "views averaged with those of N frames on either side where nothing changed (0)")

/** The tolerance that recon.skip means; 0: nothing is left out. @kind Local */
double v2v_volumes_skip(const struct v2v_number *skip, double automatic);

/** Read, settle, reconstruct, write.
 *  @param ops NULL: what the weights are for @param monitor of a method that iterates; may be NULL.
 *  @kind Collective(world). @return agreed or not */
enum v2v_status v2v_volumes_make(const struct v2v_volumes *given,
                                 const struct v2v_estimator_ops *ops,
                                 const struct v2v_monitor *monitor,
                                 struct v2v_session *session) V2V_MUST_CHECK;

#endif
