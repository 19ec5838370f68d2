#include "cli/projection.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"

enum v2v_split v2v_projection_faster(double seconds[2], const struct v2v_projector_cost *cost,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     int64_t count, int ranks)
{
    static const enum v2v_split splits[] = {V2V_SPLIT_SLICES, V2V_SPLIT_SLABS};
    for (int i = 0; i < 2; i++) {
        const struct v2v_projector_times times =
            v2v_projector_predict(cost, psf, height, width, count, splits[i], ranks);
        seconds[i] = times.forward_s + times.adjoint_s;
    }
    return seconds[1] < seconds[0] ? V2V_SPLIT_SLABS : V2V_SPLIT_SLICES;
}

enum v2v_status v2v_projection_split(enum v2v_split *split, const struct v2v_session *session,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     int64_t count)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_projector_cost cost;
    double seconds[2];
    const int ranks = v2v_comm_size(session->world);
    *split = (enum v2v_split)session->config.parallel.split;
    if (*split == V2V_SPLIT_AUTO && ranks == 1) {
        *split = V2V_SPLIT_SLICES;
    } else if (*split == V2V_SPLIT_AUTO) {
        rc = v2v_projector_cost_measure(&cost, session->world);
        if (rc == V2V_E_MEMORY) { /* the projection itself may well fit */
            v2v_log(V2V_LOG_INFO, "no memory to measure projections: shared by slices");
            *split = V2V_SPLIT_SLICES;
            return V2V_OK;
        }
        V2V_TRY(rc);
        *split = v2v_projection_faster(seconds, &cost, psf, height, width, count, ranks);
        v2v_log(V2V_LOG_INFO,
                "projection over %d ranks by %s: %.3g ms there and back predicted by slices, %.3g "
                "ms by slabs",
                ranks, *split == V2V_SPLIT_SLABS ? "slabs" : "slices", 1e3 * seconds[0],
                1e3 * seconds[1]);
    }
done:
    return rc;
}

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
    V2V_TRY(v2v_projection_split(&split, session, psf, height, width, psf->views));
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
