#ifndef V2V_CLI_PROJECTION_H
#define V2V_CLI_PROJECTION_H

#include "cli/command.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/optics/grouped.h"

/** A projector with the arrays that it works on. */
struct v2v_projection {
    struct v2v_grouped *grouped;
    float scale;          /**< as psf.reduce says */
    struct v2v_part mine; /**< slices of this rank, as files have them */
    int64_t pixels;       /**< of a frame */
    float *slices;        /**< [mine.count,y,x] */
    float *views;         /**< [v,y,x] */
};

/** Plan for frames of [height,width], scaled as psf.reduce says. The PSFs are borrowed until the
 *  end.
 *  @kind Collective(world), agreed; v2v_projection_fini after both */
enum v2v_status v2v_projection_init(struct v2v_projection *projection,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, int64_t height,
                                    int64_t width) V2V_MUST_CHECK;
void v2v_projection_fini(struct v2v_projection *projection);

/** `views`, on all ranks, from all ranks' `slices`; and the adjoint.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_projection_forward(struct v2v_projection *projection) V2V_MUST_CHECK;
enum v2v_status v2v_projection_adjoint(struct v2v_projection *projection) V2V_MUST_CHECK;

#endif
