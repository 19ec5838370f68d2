#ifndef V2V_CLI_PROJECTION_H
#define V2V_CLI_PROJECTION_H

#include "cli/command.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/optics/projector.h"

/** A projector with the arrays that it works on. */
struct v2v_projection {
    struct v2v_projector *projector;
    struct v2v_part mine; /**< slices of this rank */
    int64_t pixels;       /**< of a frame */
    float *slices;        /**< [mine.count,y,x] */
    float *views;         /**< [v,y,x] */
};

/** Plan for frames of [height,width], scaled as psf.reduce says.
 *  @kind Collective(world), agreed; v2v_projection_fini after both */
enum v2v_status v2v_projection_init(struct v2v_projection *projection,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, int64_t height,
                                    int64_t width) V2V_MUST_CHECK;
void v2v_projection_fini(struct v2v_projection *projection);

#endif
