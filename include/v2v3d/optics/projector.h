#ifndef V2V3D_OPTICS_PROJECTOR_H
#define V2V3D_OPTICS_PROJECTOR_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Forward projection lfi[v,y,x] = scale * sum_z (vol[z] * psf[v,z])[y,x] and its adjoint, by
 *  real-to-complex transforms; the sum over z is taken before the inverse transform. */
struct v2v_projector;

/** Plan for frames of [height,width]; the depth slices are split over the ranks of comm (NULL: all
 *  here). Stores the OTFs of this rank's slices: views * slices/ranks * ny * (nx/2+1) * 8 bytes.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_projector_create(struct v2v_projector **projector,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_projector_destroy(struct v2v_projector **projector);

/** Bytes that v2v_projector_create would hold on the fullest rank. @kind Local. */
int64_t v2v_projector_bytes(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                            int ranks);

/** Slices of this rank. @kind Local. */
struct v2v_part v2v_projector_slices(const struct v2v_projector *projector);

/** Factor on every projection (1 at creation; 1/Z for the mean over z). @kind Local. */
void v2v_projector_set_scale(struct v2v_projector *projector, float scale);

/** Project this rank's slices and sum the views over ranks: all ranks hold all views.
 *  @kind   Collective(comm), no allocation
 *  @param  views [count,y,x] out; view list[i] is written at i (list NULL: views 0 .. count-1)
 *  @param  volume [slices of this rank,y,x]
 *  @cost   slices forward + count inverse transforms, count*slices*ny*(nx/2+1) complex products
 *  @source REFERENCE.md 2 and 8 */
void v2v_projector_forward(struct v2v_projector *projector, float *views, const float *volume,
                           const int32_t *list, int64_t count);

/** volume = sum over the listed views of the adjoint; every rank computes its own slices.
 *  @kind Local (no communication), no allocation. @param volume [slices of this rank,y,x] out */
void v2v_projector_adjoint(struct v2v_projector *projector, float *volume, const float *views,
                           const int32_t *list, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
