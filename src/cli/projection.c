#include "cli/projection.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/cost.h"

static enum v2v_status take_memory(struct v2v_projection *projection, int64_t views, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share share = v2v_projector_share(projection->projector);
    V2V_TRY(V2V_ALLOC(projection->slices, "cli.slices",
                      v2v_mem_product(projection->mine.count, projection->pixels, 1)));
    V2V_TRY(V2V_ALLOC(projection->volume, "cli.volume",
                      v2v_mem_product(share.slices.count, share.rows.count, width)));
    V2V_TRY(V2V_ALLOC(projection->rows, "cli.views",
                      v2v_mem_product(views, share.view_rows.count, width)));
    V2V_TRY(
        V2V_ALLOC(projection->views, "cli.views", v2v_mem_product(views, projection->pixels, 1)));
done:
    return rc;
}

enum v2v_status v2v_projection_init(struct v2v_projection *projection,
                                    const struct v2v_session *session,
                                    const struct v2v_psf_file *psf, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    enum v2v_split split;
    *projection = (struct v2v_projection){
        .scale = session->config.psf.reduce == V2V_REDUCE_MEAN ? 1.0f / (float)psf->slices : 1.0f,
        .pixels = height * width};
    V2V_TRY(v2v_projector_choose_split(&split, &session->config, psf, height, width, psf->views,
                                       session->world));
    V2V_TRY(
        v2v_projector_create(&projection->projector, psf, height, width, split, session->world));
    projection->mine = v2v_projector_slices(projection->projector);
    V2V_TRY(v2v_par_agree(session->world, take_memory(projection, psf->views, width)));
done:
    return rc;
}

void v2v_projection_fini(struct v2v_projection *projection)
{
    v2v_projector_destroy(&projection->projector);
    v2v_mem_free(projection->slices);
    v2v_mem_free(projection->volume);
    v2v_mem_free(projection->rows);
    v2v_mem_free(projection->views);
    *projection = (struct v2v_projection){0};
}

void v2v_projection_forward(struct v2v_projection *projection, int64_t views)
{
    struct v2v_projector *projector = projection->projector;
    v2v_projector_from_slices(projector, projection->volume, projection->slices);
    v2v_projector_forward(projector, projection->rows, projection->volume, NULL, views,
                          projection->scale);
    v2v_projector_gather_views(projector, projection->views, projection->rows, views);
}

void v2v_projection_adjoint(struct v2v_projection *projection, int64_t views)
{
    struct v2v_projector *projector = projection->projector;
    v2v_projector_cut_views(projector, projection->rows, projection->views, views);
    v2v_projector_adjoint(projector, projection->volume, projection->rows, NULL, views,
                          projection->scale);
    v2v_projector_to_slices(projector, projection->slices, projection->volume);
}
