#ifndef V2V3D_OPTICS_PROJECTOR_H
#define V2V3D_OPTICS_PROJECTOR_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Forward projection lfi[v,y,x] = scale * sum_z (vol[z] * psf[v,z])[y,x] and its adjoint, by
 *  real-to-complex transforms; the sum over z is taken before the inverse transform.
 *
 *  Ranks share a volume and its views in one of two ways (enum v2v_split):
 *  - slices: a rank holds and transforms its depth slices. The spectra of the projections are
 *    summed over ranks, each rank summing its columns.
 *  - slabs: a rank holds rows of all slices and columns of all spectra; transforms exchange rows
 *    for columns, by themselves or by FFTW3-MPI, nothing is summed over ranks.
 *  Either way OTFs are split over ranks and views are held by rows. Slabs give the same bits at any
 *  rank count; slices too but for the rounding of one number in millions. */
struct v2v_projector;

/** What a rank holds: `rows` of `slices` of the volume, `view_rows` of every view. */
struct v2v_projector_share {
    struct v2v_part slices, rows, view_rows;
};

/** Plan for frames of [height,width] over the ranks of comm (NULL: all here, whatever the split).
 *  Stores the OTFs: views * slices * ny * (nx/2+1) * 8 bytes over all ranks.
 *  @kind Collective(comm). @param split not V2V_SPLIT_AUTO: see optics/cost.h for the choice.
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_projector_create(struct v2v_projector **projector,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     enum v2v_split split,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;
/** @kind Collective(comm). */
void v2v_projector_destroy(struct v2v_projector **projector);

/** Bytes that v2v_projector_create would hold on the fullest rank. @kind Local. */
int64_t v2v_projector_bytes(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                            enum v2v_split split, int ranks);

/** @kind Local. */
struct v2v_projector_share v2v_projector_share(const struct v2v_projector *projector);

/** @kind   Collective(comm), no allocation
 *  @param  views [count, view_rows, x] out; view list[i] is written at i (list NULL: views 0 ..
 *          count-1)
 *  @param  volume [slices, rows, x]
 *  @param  scale 1, or 1/Z for the mean over z
 *  @cost   Z forward + count inverse transforms and count*Z*ny*(nx/2+1) complex products over all
 *          ranks. Sent by one of p ranks, (p-1)/p of: slices count*ny*(nx/2+1)*16 bytes and
 *          count/p*height*(nx/2+1)*8; slabs (Z+count)/p*height*(nx/2+1)*8
 *  @source REFERENCE.md 2 and 8 */
void v2v_projector_forward(struct v2v_projector *projector, float *views, const float *volume,
                           const int32_t *list, int64_t count, float scale);

/** volume = sum over the listed views of the adjoint.
 *  @kind   Collective(comm), no allocation
 *  @param  volume [slices, rows, x] out; the same bits whatever ranks and split
 *  @param  views [count, view_rows, x]
 *  @cost   as forward; slices send half as much for the sum */
void v2v_projector_adjoint(struct v2v_projector *projector, float *volume, const float *views,
                           const int32_t *list, int64_t count, float scale);

/** whole[count,y,x] on all ranks, from every rank's rows of `count` views. @kind Collective(comm),
 *  no allocation. */
void v2v_projector_gather_views(struct v2v_projector *projector, float *whole, const float *rows,
                                int64_t count);

/** This rank's rows of `count` whole views. @kind Local. */
void v2v_projector_cut_views(const struct v2v_projector *projector, float *rows, const float *whole,
                             int64_t count);

/** Whole slices as files have them: an even share of them on each rank, whatever the split. Local.
 */
struct v2v_part v2v_projector_slices(const struct v2v_projector *projector);

/** From and to this rank's share of the volume. @kind Collective(comm), no allocation.
 *  @param slices [v2v_projector_slices,y,x]; may be `volume` itself where that is the share */
void v2v_projector_from_slices(struct v2v_projector *projector, float *volume, const float *slices);
void v2v_projector_to_slices(struct v2v_projector *projector, float *slices, const float *volume);

#ifdef __cplusplus
}
#endif

#endif
