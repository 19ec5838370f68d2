/** Views of views, by a network that knows nothing of optics: a stage before any method that makes
 *  volumes.
 *
 *  Purpose: DeepCAD, which makes frames of a view from frames of it, and view synthesis, which
 *  makes a view from the others; whatever has V2V_TRAIT_VIEWS.
 *  Invariants: the network is run on tiles of a fixed size, in time as in the plane, which overlap
 *  by a margin that is cut off again; where a tile lies depends on the recording's size alone, so
 *  that any number of ranks gives the same bits.
 *
 *  Example (compiled by tests/mpi/recon):
 *
 *      struct v2v_denoise_job job = {.config = &config, .weights = "run/weights.h5",
 *                                    .recording = recording, .scaling = &scaling,
 *                                    .output = "denoised.h5"};
 *      V2V_TRY(v2v_denoise_run(&job, &report, comm));
 *  done:
 *      return rc;
 */
#ifndef V2V3D_RECON_DENOISE_H
#define V2V3D_RECON_DENOISE_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_denoise_job {
    const struct v2v_config *config;   /**< model.method has V2V_TRAIT_VIEWS */
    const char *weights;               /**< its file */
    struct v2v_recording *recording;   /**< to denoise */
    const struct v2v_scaling *scaling; /**< what the network sees of it; undone in the output */
    struct v2v_recording *clean;       /**< the same without noise, to compare with; NULL: none */
    double zero_of_clean;              /**< counts of it without light */
    const char *output;                /**< recording to write, in the units of the input */
};

struct v2v_denoise_report {
    double seconds; /**< of the whole run, with the making of the network */
    /** With a clean recording: peak signal-to-noise ratio of all samples before and after, dB; the
     *  peak is the largest clean sample; both count from their own zero. Else NaN. */
    double psnr_before, psnr_after;
};

/** @kind   Collective(comm)
 *  @return V2V_OK | V2V_STOPPED | V2V_E_INPUT (a clean recording of other sizes; weights) |
 *          V2V_E_USAGE (the output's name) | V2V_E_BUSY | V2V_E_CONFIG | V2V_E_IO | V2V_E_MEMORY |
 *          V2V_E_NUMERIC; agreed; without V2V_OK there is no output
 *  @cost   a rank holds the frames of one network input, all views of them, twice */
enum v2v_status v2v_denoise_run(const struct v2v_denoise_job *job,
                                struct v2v_denoise_report *report,
                                const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
