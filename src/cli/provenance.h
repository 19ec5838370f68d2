/** Where a volume came from, as attributes of its file. */
#ifndef V2V_CLI_PROVENANCE_H
#define V2V_CLI_PROVENANCE_H

#include "cli/command.h"
#include "cli/origin.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"

/** Attributes that tell how a volume was made; the texts live until _fini. */
enum { V2V_PROVENANCE_MOST = 16 };
struct v2v_provenance {
    struct v2v_attribute item[V2V_PROVENANCE_MOST];
    int64_t count;
    char *config;
    char psf_crc32c[16], weights_crc32c[16], written[32], task[32];
    struct v2v_origin origin;
};

/** @kind Collective(world): rank 0 reads `weights` (may be NULL) for its checksum; agreed */
enum v2v_status v2v_provenance_init(struct v2v_provenance *provenance,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, const char *weights,
                                    const struct v2v_scaling *scaling) V2V_MUST_CHECK;

/** Add where the frames come from. @kind Collective(world), agreed */
enum v2v_status v2v_provenance_origin(struct v2v_provenance *provenance,
                                      const struct v2v_session *session, const char *recording,
                                      int64_t first_frame) V2V_MUST_CHECK;

/** Add `task` (V2V_VOLUME_TASK): a hash of what was added so far, the origin among it, of the
 *  calibration, and of the number of frames and the datasets of the output. Ranks, threads and the
 *  rest of the configuration's section `parallel` are not in it: they don't change what is
 *  computed. @kind Collective(world), agreed */
enum v2v_status v2v_provenance_task(struct v2v_provenance *provenance,
                                    const struct v2v_session *session, int64_t frames,
                                    unsigned datasets) V2V_MUST_CHECK;
void v2v_provenance_fini(struct v2v_provenance *provenance);

#endif
