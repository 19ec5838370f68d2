#ifndef V2V3D_OPTICS_CALIBRATION_H
#define V2V3D_OPTICS_CALIBRATION_H

#include "v2v3d/conf/calibration.h"
#include "v2v3d/io/psf_file.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Gain, shift and slope put into the PSFs: every kernel is displaced in frequency, in a window
 *  that grows by as much as the farthest goes. Where none is displaced, the gains alone.
 *  @kind   Local, the same bits on any rank
 *  @return V2V_OK | V2V_E_INPUT (another number of views) | V2V_E_MEMORY; psf is as before then */
enum v2v_status
v2v_calibration_apply_to_psf(struct v2v_psf_file *psf,
                             const struct v2v_calibration *calibration) V2V_MUST_CHECK;

/** Shading and distortion put into a view, as the microscope does.
 *  @kind Local. @param image [height,width], in place @param scratch likewise */
void v2v_calibration_distort_view(float *image, float *scratch,
                                  const struct v2v_view_calibration *view, int64_t height,
                                  int64_t width);

/** Into all views of a frame, of any size where there are no such fields (v2v_calibration_check).
 *  @kind Local. @param views [v,height,width], in place @param scratch [height,width] */
void v2v_calibration_distort(float *views, float *scratch,
                             const struct v2v_calibration *calibration, int64_t height,
                             int64_t width);

/** The transpose of that: of a back-projection. @kind Local. Parameters likewise. */
void v2v_calibration_distort_transpose(float *views, float *scratch,
                                       const struct v2v_calibration *calibration, int64_t height,
                                       int64_t width);

/** Taken out of the views of a frame.
 *  @kind Local. @param to, views [v,height,width] of the calibration
 *  @param scratch [2,height,width] */
void v2v_calibration_undistort(float *to, const float *views, float *scratch,
                               const struct v2v_calibration *calibration);

/** Where a PSF's light lies changes with depth: pixels (y, x) a slice, by least squares through the
 *  centroids, weighted by light. Volumes that are moved by one slice show views that are displaced
 *  by these. @kind Local. @param parallax [views][2] out */
void v2v_psf_parallax(double (*parallax)[2], const struct v2v_psf_file *psf);

#ifdef __cplusplus
}
#endif

#endif
