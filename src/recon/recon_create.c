#include "recon/recon_state.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"

/* Frames on either side that a key frame is fused with, at least: its noise is in all frames that
 * take from it. */
enum { NEIGHBOURS_OF_KEY = 3 };

/** Local: rows that a rank of the shard computes, all of them and without the padding. */
static struct v2v_part rows_of(const struct v2v_recon *recon, int rank)
{
    const struct v2v_estimator *estimator = recon->estimator;
    return estimator->ops->rows_of != NULL ? estimator->ops->rows_of(estimator, rank)
                                           : (struct v2v_part){0, estimator->height};
}

static struct v2v_part own_rows(const struct v2v_recon *recon, int rank)
{
    struct v2v_part rows = rows_of(recon, rank);
    return (struct v2v_part){rows.first, v2v_within(recon->height - rows.first, 0, rows.count)};
}

/** Local: where ranks hold rows of a frame. */
static enum v2v_status plan_slicing(struct v2v_recon *recon)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_comm *shard = recon->grid.shard;
    struct v2v_part *rows = NULL;
    V2V_TRY(V2V_ALLOC(rows, "recon.slices", v2v_comm_size(shard)));
    for (int r = 0; r < v2v_comm_size(shard); r++) {
        rows[r] = own_rows(recon, r);
    }
    V2V_TRY(v2v_slicing_create(&recon->slicing, shard, recon->slices, recon->height, recon->width,
                               rows));
    recon->own = v2v_slicing_own(recon->slicing);
done:
    v2v_mem_free(rows);
    return rc;
}

/** Local: the outputs held; the first one's memory is that of whole slices too. */
static enum v2v_status take_volumes(struct v2v_recon *recon)
{
    enum v2v_status rc = V2V_OK;
    int64_t slices = recon->estimator->slices.count;
    int64_t volume = v2v_mem_product(slices, recon->own_rows, recon->width);
    int64_t output = v2v_mem_product(slices, recon->rows, recon->estimator->width);
    int64_t whole =
        recon->slicing == NULL ? 0 : v2v_mem_product(recon->own.count, recon->height, recon->width);
    for (int o = 0; o < recon->outputs; o++) {
        if (v2v_estimator_holds(recon->estimator, o)) {
            int is_first = recon->whole == NULL;
            V2V_TRY(V2V_ALLOC(recon->output[o], "recon.volumes",
                              is_first && whole > output ? whole : output));
            V2V_TRY(V2V_ALLOC(recon->cut[o], "recon.volumes", volume));
            recon->whole = is_first ? recon->output[o] : recon->whole;
        }
    }
    if (recon->outputs > 1) {
        V2V_TRY(V2V_ALLOC(recon->mean, "recon.volumes", volume));
    }
done:
    return rc;
}

/** Local: the outputs of this rank, which is not idle, and room for the views, for take_volumes: of
 *  every row the mean and two of each output held, and whole slices; and for the combination. */
static void give_share(struct v2v_problem *problem, const struct v2v_recon *recon, int64_t unit)
{
    const int is_alone = recon->grid.branch_size == 1, is_one = recon->outputs == 1;
    const int is_learned = !is_one && problem->config->recon.combine == V2V_COMBINE_LEARNED;
    int64_t pixels = recon->height * recon->width;
    int64_t padded_width = v2v_round_up(recon->width, unit);
    int64_t padded = v2v_round_up(recon->height, unit) * padded_width;
    int64_t images = 2 * (is_alone ? recon->outputs : 1) + !is_one + is_learned;
    int64_t ranks = recon->grid.shard_size;
    int64_t slices = ranks > 1 ? v2v_parts(recon->slices, ranks) : 0;
    problem->outputs = is_alone ? 0 /* all */ : 1u << recon->grid.branch_rank;
    problem->floats = recon->views * (pixels + padded) + slices * pixels + recon->fused +
                      (is_learned ? v2v_combination_floats(problem, (int)ranks) : 0);
    problem->floats_a_row = images * recon->slices * padded_width;
}

/** Local: floats that averages with neighbouring frames take, of whole frames on every rank, and
 *  the choice of key frames. */
static int64_t fusion_floats(const struct v2v_problem *problem, int is_still)
{
    const int64_t neighbours = problem->config->recon.neighbours, views = problem->psf->views;
    const int64_t height = problem->height, width = problem->width;
    const int64_t of_key = is_still && neighbours < NEIGHBOURS_OF_KEY
                               ? v2v_fusion_floats(NEIGHBOURS_OF_KEY, views, height, width)
                               : 0;
    const int64_t keys = is_still ? v2v_key_frames_floats(views, height, width) : 0;
    return v2v_fusion_floats(neighbours, views, height, width) + of_key + keys;
}

/** Local: what frames need beside the method. */
static enum v2v_status take_memory(struct v2v_recon *recon, int64_t neighbours)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator *estimator = recon->estimator;
    const int rank = v2v_comm_rank(recon->grid.shard);
    recon->own = estimator->slices;
    recon->first_row = rows_of(recon, rank).first;
    recon->rows = rows_of(recon, rank).count;
    recon->own_rows = own_rows(recon, rank).count;
    V2V_TRY(v2v_fusion_create(&recon->fusion, neighbours, recon->views, recon->height, recon->width,
                              estimator->ops->leaves_blind));
    V2V_TRY(V2V_ALLOC(recon->recorded, "recon.views",
                      v2v_mem_product(recon->views, recon->height, recon->width)));
    V2V_TRY(V2V_ALLOC(recon->padded, "recon.views",
                      v2v_mem_product(recon->views, estimator->height, estimator->width)));
    if (recon->grid.shard_size > 1 && estimator->ops->rows_of != NULL) {
        V2V_TRY(plan_slicing(recon));
    }
    V2V_TRY(take_volumes(recon));
done:
    return rc;
}

/** Collective(world): everything is planned, and nothing of it was touched yet. */
static void announce_memory(const struct v2v_recon *recon)
{
    const int64_t later = recon->still != NULL ? v2v_still_planned(recon->still) : 0;
    double planned = (double)v2v_mem_held() + (double)later;
    v2v_par_max_f64(recon->grid.world, &planned, 1);
    v2v_log(V2V_LOG_INFO, "memory: %.2f GB planned on the largest rank", 1e-9 * planned);
}

/** Collective(shard): the method and what frames need beside it, on ranks that are not idle. The
 *  status is this rank's. @param own of this rank from here on */
static enum v2v_status equip(struct v2v_recon *recon, const struct v2v_estimator_ops *ops,
                             struct v2v_problem *own, int64_t unit, int is_still)
{
    enum v2v_status rc = V2V_OK;
    const int64_t neighbours = own->config->recon.neighbours;
    give_share(own, recon, unit);
    rc = v2v_estimator_create(&recon->estimator, ops, own, recon->grid.shard);
    if (rc == V2V_OK) {
        rc = take_memory(recon, neighbours);
    }
    if (rc == V2V_OK && is_still && neighbours < NEIGHBOURS_OF_KEY) {
        rc = v2v_fusion_create(&recon->of_key, NEIGHBOURS_OF_KEY, recon->views, recon->height,
                               recon->width, ops->leaves_blind);
    }
    if (rc == V2V_OK && is_still) {
        rc = v2v_key_frames_create(&recon->keys, recon->views, recon->height, recon->width);
    }
    V2V_TRY(v2v_par_agree(recon->grid.shard, rc));
    if (recon->outputs > 1) {
        V2V_TRY(v2v_combination_create(&recon->combination, own, &recon->grid, recon->slicing,
                                       recon->own_rows));
    }
    if (is_still) {
        V2V_TRY(v2v_still_create(&recon->still, recon->estimator, own));
    }
done:
    return rc;
}

enum v2v_status v2v_recon_create(struct v2v_recon **recon, const struct v2v_estimator_ops *ops,
                                 const struct v2v_problem *problem, int64_t frames,
                                 struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recon *made = NULL;
    struct v2v_grid_work work;
    struct v2v_problem own = *problem;
    const int64_t held = (int64_t)v2v_mem_held();
    *recon = NULL;
    const int is_still = problem->skip > 0.0 && !ops->skips_light;
    rc = ops->describe_work(&work, problem);
    if (rc == V2V_OK && work.most_branches > 1) {
        work.bytes = v2v_mem_bytes(v2v_combination_floats(problem, 1), work.bytes);
    }
    if (rc == V2V_OK && is_still) {
        rc = v2v_still_allow(&work, ops, problem);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(made, "recon", 1);
    }
    V2V_TRY(v2v_par_agree(world, rc));
    *made =
        (struct v2v_recon){.title = ops->is_learned ? "reconstruct" : "deconvolve",
                           .outputs = work.most_branches,
                           .views = problem->psf->views,
                           .slices = problem->psf->slices,
                           .height = problem->height,
                           .width = problem->width,
                           .fused = fusion_floats(problem, is_still),
                           .is_homogeneous = ops->has_gain && problem->config->model.homogeneous,
                           .refresh = is_still ? problem->config->recon.refresh : 1,
                           .level = 1.0};
    work.items = frames;
    V2V_TRY(v2v_estimator_lay_out(
        &made->grid, &work,
        (int)v2v_smaller(problem->config->parallel.branches, work.most_branches),
        v2v_mem_bytes(made->fused, held), problem->config, world));
    rc = v2v_agreement_create(&made->agreement, world);
    V2V_TRY(v2v_par_agree(world, rc));
    if (!made->grid.idle) {
        rc = equip(made, ops, &own, work.unit, is_still);
    }
    V2V_TRY(v2v_par_agree(world, rc));
    announce_memory(made);
    *recon = made;
    made = NULL;
done:
    v2v_recon_destroy(&made);
    return rc;
}

void v2v_recon_destroy(struct v2v_recon **recon)
{
    struct v2v_recon *old = *recon;
    *recon = NULL;
    if (old == NULL) {
        return;
    }
    for (int o = 0; o < V2V_ESTIMATOR_MOST_OUTPUTS; o++) {
        v2v_mem_free(old->cut[o]);
        v2v_mem_free(old->output[o]);
    }
    v2v_combination_destroy(&old->combination);
    v2v_slicing_destroy(&old->slicing);
    v2v_agreement_destroy(&old->agreement);
    v2v_mem_free(old->mean);
    v2v_mem_free(old->padded);
    v2v_mem_free(old->recorded);
    v2v_fusion_destroy(&old->fusion);
    v2v_fusion_destroy(&old->of_key);
    v2v_mem_free(old->todo);
    v2v_mem_free(old->misfit);
    v2v_still_destroy(&old->still);
    v2v_key_frames_destroy(&old->keys);
    v2v_estimator_destroy(&old->estimator);
    v2v_grid_destroy(&old->grid);
    v2v_mem_free(old);
}
