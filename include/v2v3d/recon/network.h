#ifndef V2V3D_RECON_NETWORK_H
#define V2V3D_RECON_NETWORK_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/par/grid.h"
#include "v2v3d/v2v/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The trained network over every frame of a recording: the mean of the two volumes, in the units
 * of the recording (divided by gain). Frames go round the data ranks; with branch_size 2 each rank
 * of a pair computes one branch. Frames whose sides are no multiple of 32 are padded by reflection
 * on the lower and right side and cut back. Frames that the writer has done already are left out.
 *  @kind   Collective(grid->world)
 *  @param  model planned by this function; holds the branches of grid; NULL on an idle rank
 *  @param  writer created with the recording's frame count and frame size; BRANCH1 and BRANCH2 are
 *          written when `branches`
 *  @param  computed_part mean over the frames of v2v_model_computed_part, on all ranks
 *  The watchdog is re-armed for every frame and stays armed; the caller disarms it.
 *  @return V2V_OK | V2V_STOPPED (on request, after a round of frames at least; the frames so far
 * are written and marked done) | V2V_E_NUMERIC (frame and voxel) | V2V_E_INPUT | V2V_E_IO |
 * V2V_E_MEMORY; agreed
 */
enum v2v_status v2v_reconstruct(struct v2v_model *model, struct v2v_recording *recording,
                                const struct v2v_scaling *scaling, struct v2v_volume_writer *writer,
                                int branches, const struct v2v_grid *grid,
                                double *computed_part) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
