#ifndef V2V3D_OPTICS_GROUPED_H
#define V2V3D_OPTICS_GROUPED_H

#include "v2v3d/optics/projector.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Projections between whole slices and whole views, as files have them, whatever ranks share.
 *
 *  Where all OTFs would take more than is allowed, or half of what a memory limit leaves, they are
 *  held of a group of views at a time: every call then transforms the PSFs again, which takes many
 *  times as long as the projection. */
struct v2v_grouped;

/** @kind Collective(comm). @param psf borrowed until the end @param split as v2v_projector_create
 *  @param most_bytes that all ranks' OTFs may take together; INT64_MAX: any number
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_grouped_create(struct v2v_grouped **grouped, const struct v2v_psf_file *psf,
                                   int64_t height, int64_t width, enum v2v_split split,
                                   int64_t most_bytes, const struct v2v_comm *comm) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Collective(comm). */
void v2v_grouped_destroy(struct v2v_grouped **grouped);

/** Slices of this rank, an even share. @kind Local. */
struct v2v_part v2v_grouped_slices(const struct v2v_grouped *grouped);

/** Views of which OTFs are held at a time, the same on all ranks. @kind Local. */
int64_t v2v_grouped_together(const struct v2v_grouped *grouped);

/** views [v,y,x], on all ranks, from every rank's slices; and the adjoint, to round-off whatever
 *  the groups. @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY (of groups); agreed */
enum v2v_status v2v_grouped_forward(struct v2v_grouped *grouped, float *views, const float *slices,
                                    float scale) V2V_MUST_CHECK;
enum v2v_status v2v_grouped_adjoint(struct v2v_grouped *grouped, float *slices, const float *views,
                                    float scale) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
