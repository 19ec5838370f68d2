/** Volumes of a recording, by whatever method: what `reconstruct`, `deconvolve` and the demo share.
 */
#ifndef V2V_CLI_VOLUMES_H
#define V2V_CLI_VOLUMES_H

#include "cli/command.h"
#include "cli/storage.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/method/estimator.h"

/** What became of a recording, known to rank 0 also after a failure. */
struct v2v_volumes_result {
    double ready_s, frames_s; /**< until all was ready, tools and recording; then for the frames */
    int64_t frames, before, now; /**< of the output; done when it was opened; made by this run */
};

/** Arguments of a command that makes volumes. */
struct v2v_volumes {
    struct v2v_common common;
    const char *psf, *weights, *calibration, *input, *output;
    const char *frames; /* FIRST:COUNT; NULL: all */
    int branches, resume;
    struct v2v_storage_options storage;
    struct v2v_words inputs;           /* as the command line has them: see cli/recordings.h */
    struct v2v_volumes_result *result; /* out, where not NULL */
};

/** Rows of its options. */
#define V2V_OPTIONS_VOLUMES                                                                        \
    V2V_OPTIONS_STORAGE(struct v2v_volumes, storage),                                              \
        V2V_OPTION_CALIBRATION(struct v2v_volumes, calibration),                                   \
        V2V_OPTION_SWITCH(struct v2v_volumes, resume, "resume",                                    \
                          "go on with what an interrupted run left; a complete output stays"),     \
        V2V_OPTION_FRAMES(struct v2v_volumes, frames,                                              \
                          "these of the recording, from 0; fewer where it ends")

#define V2V_OPTION_REFRESH                                                                         \
    V2V_OPTION_SET("refresh", "recon.refresh", "N",                                                \
                   "with --skip over time: frames from one whole frame to the next (20)")

#define V2V_OPTION_NEIGHBOURS                                                                      \
    V2V_OPTION_SET("neighbours", "recon.neighbours", "N",                                          \
                   "views averaged with those of N frames on either side, moved along with what "  \
                   "moves, where they then agree but for brightness (0)")

/** The tolerance that recon.skip means to a method; 0: nothing is left out.
 *  @kind Local. @param network that the method's weights are of; NULL: it has none */
double v2v_volumes_skip(const struct v2v_number *skip, const struct v2v_estimator_ops *ops,
                        const struct v2v_network_ops *network);

/** Do the words fit together? @param frames FIRST:COUNT; all when it is not given @kind Local.
 *  @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_volumes_check(struct v2v_part *frames,
                                  const struct v2v_volumes *given) V2V_MUST_CHECK;

/** What every recording needs: read once. */
struct v2v_volumes_tools {
    const struct v2v_estimator_ops *ops;
    struct v2v_file_state weights; /**< as this rank first saw the file */
    struct v2v_psf_file psf;       /**< calibrated */
    double seconds;                /**< that it took */
};

/** PSFs, calibration, and what the weights are for; the session's configuration takes their network
 *  over. @param ops NULL: what the weights are for @kind Collective(world). @return agreed or not;
 *  v2v_volumes_end after both */
enum v2v_status v2v_volumes_begin(struct v2v_volumes_tools *tools, const struct v2v_volumes *given,
                                  const struct v2v_estimator_ops *ops,
                                  struct v2v_session *session) V2V_MUST_CHECK;
void v2v_volumes_end(struct v2v_volumes_tools *tools);

/** Read, settle, reconstruct, write given->input. @param session of which settings are decided by
 *  this recording @param monitor of a method that iterates; may be NULL.
 *  @kind Collective(world). @return agreed or not */
enum v2v_status v2v_volumes_of(const struct v2v_volumes *given,
                               const struct v2v_volumes_tools *tools,
                               const struct v2v_monitor *monitor,
                               struct v2v_session *session) V2V_MUST_CHECK;

/** All three. @kind Collective(world). @return agreed or not */
enum v2v_status v2v_volumes_make(const struct v2v_volumes *given,
                                 const struct v2v_estimator_ops *ops,
                                 const struct v2v_monitor *monitor,
                                 struct v2v_session *session) V2V_MUST_CHECK;

#endif
