/** What a run that makes volumes says of their quality by itself. */
#ifndef V2V_CLI_VOLUMES_QUALITY_H
#define V2V_CLI_VOLUMES_QUALITY_H

#include "cli/command.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/recon/recon.h"

/** Finished volumes and what they were made of; everything is borrowed. */
struct v2v_volumes_made {
    const char *output;
    const struct v2v_estimator_ops *ops;
    struct v2v_recon **recon;        /**< that made them; its memory is given back */
    const struct v2v_psf_file *psf;  /**< calibrated */
    struct v2v_recording *recording; /**< cut to the volumes' frames */
    const struct v2v_scaling *scaling;
    const struct v2v_misfit *misfit; /**< [frames] of the volumes, as v2v_recon_misfits */
    int64_t first;                   /**< number of their first frame before the cut */
};

/** One line on how the first frame that shows something, and lacks no view, meets its views, what
 *  that warns of, and frames unlike it; a volume is none the worse without it.
 *  @kind Collective(world) */
void v2v_volumes_report_quality(const struct v2v_volumes_made *made,
                                const struct v2v_session *session);

#endif
