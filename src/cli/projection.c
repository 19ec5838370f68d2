#include "cli/projection.h"

#include "v2v3d/base/memory.h"

enum v2v_status v2v_projection_init(struct v2v_projection *projection,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    *projection = (struct v2v_projection){.pixels = height * width};
    V2V_TRY(v2v_projector_create(&projection->projector, psf, height, width, session->world));
    if (session->config.psf.reduce == V2V_REDUCE_MEAN) {
        v2v_projector_set_scale(projection->projector, 1.0f / (float)psf->slices);
    }
    projection->mine = v2v_projector_slices(projection->projector);
    rc = V2V_ALLOC(projection->slices, "cli.slices", projection->mine.count * projection->pixels);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(projection->views, "cli.views", psf->views * projection->pixels);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
done:
    return rc;
}

void v2v_projection_fini(struct v2v_projection *projection)
{
    v2v_projector_destroy(&projection->projector);
    v2v_mem_free(projection->slices);
    v2v_mem_free(projection->views);
    *projection = (struct v2v_projection){0};
}
