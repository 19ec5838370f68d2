/** The microscope as linear operators.
 *
 *  Purpose: point spread functions, forward projection and its exact adjoint, and the alignment
 *  shifts that the network's first layer needs.
 *  Invariants: the PSF centre is pixel c = ceil(K/2)-1 of a K-pixel side (REFERENCE.md 2); frames
 * are zero outside; adjoint means adjoint, to round-off, for odd and even K.
 *
 *  Example (compiled by tests/unit/optics):
 *
 *      V2V_TRY(v2v_psf_read(&psf, "psf/2psam", "", V2V_NORMALIZE_VIEW, comm));
 *      V2V_TRY(v2v_projector_create(&projector, &psf, 256, 256, V2V_SPLIT_SLICES, comm));
 *      v2v_projector_forward(projector, views, volume, NULL, psf.views, 1.0f);
 *  done:
 *      v2v_projector_destroy(&projector);
 *      v2v_psf_file_fini(&psf);
 */
#ifndef V2V3D_OPTICS_PSF_H
#define V2V3D_OPTICS_PSF_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The centre pixel of a side of `side` pixels: ceil(side/2)-1 (REFERENCE.md 2). @kind Local. */
static inline int64_t v2v_psf_centre(int64_t side)
{
    return (side + 1) / 2 - 1;
}

/** Read a set (see v2v_psf_file_read) and apply `normalize` (enum v2v_normalize).
 *  @kind Collective(comm). @return as v2v_psf_file_read */
enum v2v_status v2v_psf_read(struct v2v_psf_file *psf, const char *path, const char *without,
                             int normalize, const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Scale every view so that it sums to 1 over z, y, x: volumes then carry the units of the views
 *  (a constant volume 1 projects to views of 1 away from the border). Double-precision sums.
 *  @kind Local. */
void v2v_psf_normalize_views(struct v2v_psf_file *psf);

/** Likewise every slice of a view that is not dark. @kind Local. */
void v2v_psf_normalize_slices(struct v2v_psf_file *psf);

/** Set by scalar wave optics: see v2v_optics_settings. For each view the sub-aperture of the pupil
 *  at the view's tilt is propagated to every slice by the angular spectrum; two-photon excitation
 *  is the intensity squared. Views are those of the list of tilts; or the untilted one and rings,
 *  from the inner to the outer.
 *  @kind Local. @return V2V_OK | V2V_E_CONFIG (sub-aperture or a tilt outside the pupil, a list
 *  that cannot be read, a shift out of the PSF, sampling too coarse) | V2V_E_MEMORY
 *  @source REFERENCE.md 15 */
enum v2v_status v2v_psf_simulate(struct v2v_psf_file *psf,
                                 const struct v2v_optics_settings *settings) V2V_MUST_CHECK;

/** A copy without negative light, which displacing a PSF by parts of pixels leaves beside its peak:
 *  0 there, and a slice's sum as it was. @kind Local. @param copy _fini after both
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_psf_positive(struct v2v_psf_file *copy,
                                 const struct v2v_psf_file *psf) V2V_MUST_CHECK;

/** What a view's PSF sums to, mean over the views; 1 where all is dark. @kind Local. */
double v2v_psf_light(const struct v2v_psf_file *psf);

/** Standard deviation that white noise of 1 in all views has in a voxel of their back-projection,
 *  root mean square over the slices: by it noise is told from light. @kind Local. */
double v2v_psf_voxel_noise(const struct v2v_psf_file *psf);

/** That of the sharpest slice (v2v_sharpness_of_image): no image of light through the optics has
 *  more, but for noise. @kind Local. */
double v2v_psf_sharpness(const struct v2v_psf_file *psf);

/** E of the de-crosstalk loss: mean over z of the slice sums of view 0. @kind Local. */
double v2v_psf_energy_mean(const struct v2v_psf_file *psf);

#ifdef __cplusplus
}
#endif

#endif
