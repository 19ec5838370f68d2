#ifndef V2V3D_SIM_RECORDING_H
#define V2V3D_SIM_RECORDING_H

#include "v2v3d/io/recording.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/sim/noise.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Project a volume (frame t of the recording shows frame t mod T of the volume) and add noise.
 *  The noise level is that of the first frame's clean views, for the whole recording; sample i of
 *  frame t draws number i of stream t, whatever the ranks. A distinct volume frame is projected
 *  once; with a calibration (else NULL), which the PSFs have taken up, its views are shaded and
 *  distorted. The watchdog is re-armed for every frame and stays armed; the caller disarms it.
 *  @kind Collective(comm): depth slices are split over ranks. @return agreed */
enum v2v_status v2v_simulate_recording(const char *output, struct v2v_volume *volume,
                                       const struct v2v_psf_file *psf, struct v2v_noise *noise,
                                       uint64_t seed, int64_t frames,
                                       const struct v2v_calibration *calibration,
                                       const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
