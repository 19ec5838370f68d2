/** Training view to view.
 *
 *  Purpose: the loop that fits the two branches to noisy recordings: crops, physical flips, losses,
 *  gradients over the grid, Adam, checkpoints.
 *  Invariants: sample i of step s is drawn by (seed, s, i), never by rank; all ranks leave at the
 *  same step; weights, moments and sums of gradients are float32 whatever the convolutions round
 * to; RUN/weights.h5 always is a complete checkpoint, RUN/weights.prev.h5 the one before.
 *
 *  Example (compiled by tests/unit/train):
 *
 *      struct v2v_train_job job = {.config = &config, .psf = &psf, .recordings = &recording,
 *                                  .recording_count = 1, .folder = "run"};
 *      V2V_TRY(v2v_train_run(&job, &report, comm));
 *  done:
 *      return rc;
 */
#ifndef V2V3D_TRAIN_TRAIN_H
#define V2V3D_TRAIN_TRAIN_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What RUN holds: settings, a line a logged step, the newest checkpoint and the one before. */
#define V2V_RUN_CONFIG "config.yaml"
#define V2V_RUN_METRICS "metrics.jsonl"
#define V2V_RUN_WEIGHTS "weights.h5"
#define V2V_RUN_WEIGHTS_BEFORE "weights.prev.h5"

struct v2v_train_job {
    const struct v2v_config *config;
    const struct v2v_psf_file *psf;          /**< normalised as the configuration says */
    struct v2v_recording *const *recordings; /**< all with the PSFs' view count */
    struct v2v_volume *const *truths; /**< [recording_count] for networks that learn from them, else
                                           NULL */
    int64_t recording_count;
    const char *folder;  /**< RUN: made when missing */
    const char *weights; /**< start from this file; NULL: train.init by train.seed */
    int resume;          /**< go on from RUN/weights.h5, or .prev when it is bad */
    int force;           /**< an older run in RUN may be overwritten */
    double max_time_s;   /**< checkpoint and stop after this, of a linear schedule with the time
                              of earlier attempts; 0: no limit */
};

struct v2v_train_report {
    int64_t steps;     /**< done in all, resumed ones included */
    int64_t now;       /**< of them by this run */
    double last_total; /**< total loss of the last step of this run; 0: there was none */
    double seconds;
};

/** Train until config->train.steps, the time limit or a stop request. Writes RUN/metrics.jsonl
 * (step, mse, fft, pos, dc, tv, total, grad_norm, seconds and, of these, rank 0's in
 * communication), RUN/weights.h5, RUN/config.yaml.
 *  @kind   Collective(comm)
 *  @return V2V_OK | V2V_STOPPED (limit or signal: checkpoint written, unless the last
 *          loss was not finite) | V2V_E_NUMERIC |
 *          V2V_E_CONFIG | V2V_E_INPUT | V2V_E_BUSY (another run holds RUN) | V2V_E_USAGE (RUN holds
 *          a run and neither resume nor force) | V2V_E_IO | V2V_E_MEMORY; agreed */
enum v2v_status v2v_train_run(const struct v2v_train_job *job, struct v2v_train_report *report,
                              struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
