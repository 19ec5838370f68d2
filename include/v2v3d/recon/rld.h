/** Volumes from recordings.
 *
 *  Purpose: the trained network over a recording (network.h), and phase-space Richardson-Lucy
 *  deconvolution (rld.h).
 *  Invariants: ranks share frames or slices, never the answer: any rank count gives the same volume
 *  to round-off; offset and gain are one pair for a whole recording and divided out of the volume.
 *
 *  Example (compiled by tests/unit/recon):
 *
 *      struct v2v_rld *rld = NULL;
 *      V2V_TRY(v2v_rld_create(&rld, &psf, height, width, 0.5, V2V_SPLIT_SLICES, comm));
 *      V2V_TRY(v2v_rld_run(rld, volume, views, 10));
 *  done:
 *      v2v_rld_destroy(&rld);
 */
#ifndef V2V3D_RECON_RLD_H
#define V2V3D_RECON_RLD_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Phase-space Richardson-Lucy (REFERENCE.md 7): view by view
 *  x <- x * ((1-w) + w * A_v^T(lfi_v / A_v x) / A_v^T 1), clipped at 0. */
struct v2v_rld;

/** @kind Collective(comm). @param weight w, 0.5 in the reference @param split how the projector
 *  shares the volume over ranks @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_rld_create(struct v2v_rld **rld, const struct v2v_psf_file *psf, int64_t height,
                               int64_t width, double weight, enum v2v_split split,
                               const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_rld_destroy(struct v2v_rld **rld);

/** This rank's slices of the volume, whatever the split. @kind Local. */
struct v2v_part v2v_rld_slices(const struct v2v_rld *rld);

/** `iterations` from a constant start (whose projections have the mean of the views).
 *  @kind Collective(comm), no allocation. @param volume [slices of this rank,y,x] out
 *  @param views [v,y,x], the same on all ranks; negative values count as 0
 *  A voxel that gives a view less than 1e-4 of its PSF's sum is left alone by that view, and is 0
 *  when no view sees it; a pixel that would get less than 1e-4 of the PSF's sum from a volume of
 *  ones has no say; a projection counts as at least 1e-6 of the mean view. All floors are
 *  relative: scaled views give the scaled volume. The watchdog is re-armed for every iteration and
 *  stays armed: what follows is usually a write; the caller disarms it.
 *  @return V2V_OK | V2V_STOPPED (agreed) | V2V_E_NUMERIC (agreed) */
enum v2v_status v2v_rld_run(struct v2v_rld *rld, float *volume, const float *views,
                            int64_t iterations) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
