/** Volumes from recordings, by any method of method/estimator.h.
 *
 *  Purpose: everything about frames, once: their ranks, padding, units, order, writing, resuming.
 *  Invariants: ranks share frames, outputs or parts of a frame, never the answer: any rank count
 *  gives the same volume to round-off, but for a network that skips tiles of a frame in slabs, each
 *  of which takes its own sample of background: such volumes differ by as much as skipping may
 *  leave out; offset and gain are one pair for a whole recording and divided out of the volume; a
 *  frame is marked done when it is on the disk.
 *
 *  Example (compiled by tests/mpi/recon):
 *
 *      V2V_TRY(v2v_recon_create(&recon, ops, &problem, info->frames, world));
 *      V2V_TRY(v2v_recon_run(recon, recording, &scaling, writer, 0, NULL));
 *  done:
 *      v2v_recon_destroy(&recon);
 */
#ifndef V2V3D_RECON_RECON_H
#define V2V3D_RECON_RECON_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/method/estimator.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The tolerance of skipping over time that is called auto. */
#define V2V_RECON_SKIP_AUTO 0.02

struct v2v_recon;

/** Lay the ranks out for `frames` frames and make the method ready, as problem->config->parallel
 *  says: ranks take frames; where there are too few of them, outputs and parts of a frame.
 *  @kind   Collective(world)
 *  @param  ops borrowed @param problem copied; its outputs and room are decided here
 *  @return V2V_OK | V2V_E_CONFIG | V2V_E_INPUT | V2V_E_MEMORY | V2V_E_INTERNAL; agreed */
enum v2v_status v2v_recon_create(struct v2v_recon **recon, const struct v2v_estimator_ops *ops,
                                 const struct v2v_problem *problem, int64_t frames,
                                 struct v2v_comm *world) V2V_MUST_CHECK;
/** @kind Collective(world); accepts NULL. */
void v2v_recon_destroy(struct v2v_recon **recon);

/** Every frame that the writer has not done yet: the mean of the method's volumes, in the units of
 *  the recording (divided by gain). Frames whose sides are no multiple of the method's unit are
 *  padded by reflection on the lower and right side and cut back.
 *  @kind   Collective(world)
 *  @param  writer created with the recording's frame count and frame size; BRANCH1 and BRANCH2 are
 *          written when `branches`
 *  @param  monitor of the method's iterations; NULL: none
 *  The watchdog is re-armed for every frame and stays armed; the caller disarms it.
 *  @return V2V_OK | V2V_STOPPED (on request: a network after a round of frames at least, what
 *          iterates after any iteration; the frames so far are written and marked done) |
 *          V2V_E_NUMERIC (frame and voxel) | V2V_E_INPUT | V2V_E_IO | V2V_E_MEMORY; agreed */
enum v2v_status v2v_recon_run(struct v2v_recon *recon, struct v2v_recording *recording,
                              const struct v2v_scaling *scaling, struct v2v_volume_writer *writer,
                              int branches, const struct v2v_monitor *monitor) V2V_MUST_CHECK;

/** What the volumes of the last run leave of their views, as far as the method knows it; zeros of
 *  frames that were done before, and, with skipping over time, of those of which little was made
 *  anew.
 *  @kind Collective(world). @param misfit [the recording's frames] out */
void v2v_recon_misfits(const struct v2v_recon *recon, struct v2v_misfit *misfit);

/** The views [v,y,x] that a finished volume gives by itself, from frame t of the file, by what the
 *  method holds of the PSFs; whole on every rank. Only where its ops `project`.
 *  @kind Collective(world). @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY; agreed */
enum v2v_status v2v_recon_project(struct v2v_recon *recon, float *views, struct v2v_volume *volumes,
                                  int64_t t) V2V_MUST_CHECK;

/** Mean over the frames of the part of the work that was done. @kind Collective(world) */
double v2v_recon_computed_part(const struct v2v_recon *recon);

/** With skipping over time, the largest change of a tile that was taken over, of the brightest
 *  light; else 0. @kind Collective(world) */
double v2v_recon_left(const struct v2v_recon *recon);

#ifdef __cplusplus
}
#endif

#endif
