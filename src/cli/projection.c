#include "cli/projection.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/cost.h"

static enum v2v_status take_memory(struct v2v_projection *projection, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(projection->slices, "cli.slices",
                      v2v_mem_product(projection->mine.count, projection->pixels, 1)));
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
    V2V_TRY(v2v_grouped_create(&projection->grouped, psf, height, width, split, INT64_MAX,
                               session->world));
    projection->mine = v2v_grouped_slices(projection->grouped);
    V2V_TRY(v2v_par_agree(session->world, take_memory(projection, psf->views)));
    const int64_t together = v2v_grouped_together(projection->grouped);
    if (together < psf->views) {
        v2v_log(V2V_LOG_INFO, "spectra of %lld views of %lld at a time fit the memory",
                (long long)together, (long long)psf->views);
    }
done:
    return rc;
}

void v2v_projection_fini(struct v2v_projection *projection)
{
    v2v_grouped_destroy(&projection->grouped);
    v2v_mem_free(projection->slices);
    v2v_mem_free(projection->views);
    *projection = (struct v2v_projection){0};
}

enum v2v_status v2v_projection_forward(struct v2v_projection *projection)
{
    return v2v_grouped_forward(projection->grouped, projection->views, projection->slices,
                               projection->scale);
}

enum v2v_status v2v_projection_adjoint(struct v2v_projection *projection)
{
    return v2v_grouped_adjoint(projection->grouped, projection->slices, projection->views,
                               projection->scale);
}
