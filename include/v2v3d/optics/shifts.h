#ifndef V2V3D_OPTICS_SHIFTS_H
#define V2V3D_OPTICS_SHIFTS_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/psf_file.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Integer shifts of the alignment, aligned[v,c,z,y,x] = feat[v,c, y+dy[v,z], x+dx[v,z]]. */
struct v2v_shifts {
    int64_t views, slices;
    int32_t *dy, *dx; /**< [v,z], owned */
};

/** Centroid of the flipped PSF slice, rounded half to even (REFERENCE.md 3); a slice without energy
 *  has shift 0. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_shifts_from_psf(struct v2v_shifts *shifts,
                                    const struct v2v_psf_file *psf) V2V_MUST_CHECK;
void v2v_shifts_fini(struct v2v_shifts *shifts);

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_shifts_copy(struct v2v_shifts *copy,
                                const struct v2v_shifts *shifts) V2V_MUST_CHECK;

/** The largest |dy| or |dx|. @kind Local. */
int64_t v2v_shifts_reach(const struct v2v_shifts *shifts);

/** Which flips are physical: a flip of y (axis 0) or x (axis 1) is, when each view's flipped PSF is
 *  within `tolerance` (relative L2) of some view's PSF, one to one. PSFs are flipped about the
 *  centroid of the whole set, to half a pixel: where that is not the centre pixel, flipped views
 *  belong to a flipped volume that is displaced as a whole.
 *  @kind Local. @param partner [v]: the view that view v becomes
 *  @return 1 when the flip is physical */
int v2v_shifts_flip_partner(int32_t *partner, const struct v2v_psf_file *psf, int axis,
                            double tolerance);

/** The pixels by which the flipped volume that flipped views belong to is displaced along the axis:
 *  0 where the set is flipped about its centre pixel. @kind Local. */
int64_t v2v_shifts_flip_moves(const struct v2v_psf_file *psf, int axis);

#ifdef __cplusplus
}
#endif

#endif
