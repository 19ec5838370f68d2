#ifndef V2V3D_OPTICS_PSF_FIT_H
#define V2V3D_OPTICS_PSF_FIT_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** How near a model comes to a set, view by view. */
struct v2v_psf_likeness {
    int64_t views;
    double *correlation; /**< [views] sum h g / sqrt(sum h^2 sum g^2), over all slices; owned */
    double *centroid;    /**< [views] largest distance of the centroids of a slice, pixels; owned */
};

/** @kind Local. @param a, b of the same shape. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_psf_compare(struct v2v_psf_likeness *likeness, const struct v2v_psf_file *a,
                                const struct v2v_psf_file *b) V2V_MUST_CHECK;
void v2v_psf_likeness_fini(struct v2v_psf_likeness *likeness);

/** Change the settings so that v2v_psf_simulate gives the set: pixel size and slice spacing where
 *  the set does not state them, the tilt of every view, sub-aperture, pinhole (where the settings
 *  have one), focus, and the aberrations that are asked for. The settings' aperture, indices,
 *  wavelength, photons and sampling are believed. What is lowered is the mean over views of
 *  1 - correlation of the intensities (the root of a two-photon set).
 *
 *  The set tells pixel size and slice spacing apart only by rays that are steep: the paraxial field
 *  depends on spacing / pixel^2 alone.
 *  @kind   Local, OpenMP threads
 *  @param  settings in: where to begin; out: fitted, with a list of tilts
 *  @param  modes [count] Noll indices of aberrations to fit, 1 .. V2V_ZERNIKE_MOST
 *  @return V2V_OK | V2V_E_CONFIG (as v2v_psf_simulate) | V2V_E_INPUT (the set is not square) |
 *          V2V_E_INTERNAL (the optimiser fails) | V2V_E_MEMORY
 *  @cost   about 2000 * 13 slices of a view, each as by v2v_psf_simulate; deterministic */
enum v2v_status v2v_psf_fit(struct v2v_optics_settings *settings, const struct v2v_psf_file *psf,
                            const int64_t *modes, int64_t count) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
