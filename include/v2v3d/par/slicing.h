#ifndef V2V3D_PAR_SLICING_H
#define V2V3D_PAR_SLICING_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A volume [slices,height,width] that ranks hold in two ways: some rows of every slice, or whole
 *  slices, which is how files are written and read. */
struct v2v_slicing;

/** @param rows [ranks] that each rank holds: one after the other, together all of them
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_slicing_create(struct v2v_slicing **slicing, const struct v2v_comm *comm,
                                   int64_t slices, int64_t height, int64_t width,
                                   const struct v2v_part *rows) V2V_MUST_CHECK;

/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_slicing_destroy(struct v2v_slicing **slicing);

/** The slices that this rank holds as a whole. @kind Local. */
struct v2v_part v2v_slicing_own(const struct v2v_slicing *slicing);

/** From one to the other; `slices` [own,height,width], `rows` [slices,own rows,width].
 *  @kind Collective(comm) */
void v2v_slicing_to_slices(struct v2v_slicing *slicing, float *slices, const float *rows);
void v2v_slicing_to_rows(struct v2v_slicing *slicing, float *rows, const float *slices);

#ifdef __cplusplus
}
#endif

#endif
