#ifndef V2V3D_SIM_RECORDING_H
#define V2V3D_SIM_RECORDING_H

#include "v2v3d/io/recording.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/sim/noise.h"
#include "v2v3d/sim/planes.h"
#include "v2v3d/sim/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A microscope that records volumes or scenes of one size. */
struct v2v_simulator;

/** With a calibration (else NULL), which the PSFs have taken up, views are shaded and distorted.
 *  @kind Collective(comm): depth slices are split over ranks; NULL: this rank alone.
 *  @param psf, calibration, comm borrowed; psf without `data`: cameras, for planes
 *  @return V2V_OK | V2V_E_INPUT (calibration of other views or frames) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_simulator_create(struct v2v_simulator **simulator,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     const struct v2v_calibration *calibration,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** What to record: a volume, whose frames come over and over, a scene, or planes. */
struct v2v_simulation {
    struct v2v_volume *volume;       /**< or NULL */
    const struct v2v_scene *scene;   /**< or NULL */
    const struct v2v_planes *planes; /**< or NULL */
    struct v2v_noise noise;          /**< its level is set */
    uint64_t seed;                   /**< of the noise */
    int64_t frames;
    double pixel_size_um, slice_spacing_um; /**< to state; 0: not stated */
    double frame_interval_s;                /**< likewise */
    const char *output; /**< the noisy recording; a camera's is uint16 and states its offset */
    const char *clean;  /**< the recording without noise, in the mean; NULL: not written */
    const char *truth; /**< the scene as a volume, one frame where it is still; NULL: not written */
};

/** Project and add noise. The noise level is that of the first frame's clean views, for the whole
 *  recording; sample i of frame t draws number i of stream t, whatever the ranks. A frame that
 *  differs from the others is projected once. The watchdog is re-armed for every frame and stays
 *  armed; the caller disarms it. Files get their names one after the other, the recording last.
 *  @kind Collective(comm of create).
 *  @return V2V_OK | V2V_E_USAGE (no frames) | V2V_E_INPUT (slices that are not the PSFs'; a scene
 *  too dark) | V2V_E_IO ..; agreed */
enum v2v_status v2v_simulator_record(struct v2v_simulator *simulator,
                                     struct v2v_simulation *simulation) V2V_MUST_CHECK;

/** @kind Collective(comm of create); accepts NULL; nulls the pointer. */
void v2v_simulator_destroy(struct v2v_simulator **simulator);

#ifdef __cplusplus
}
#endif

#endif
