#include "v2v3d/method/estimator.h"

#include "method/diner.h"
#include "method/learned.h"
#include "method/richardson_lucy.h"
#include "method/tv.h"
#include "method/unrolled.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <stdio.h>
#include <string.h>

/* One row a method. */
static const struct v2v_estimator_ops *const estimators[] = {
    &v2v_estimator_rl,    &v2v_estimator_rld,     &v2v_estimator_frl,     &v2v_estimator_tv,
    &v2v_estimator_diner, &v2v_estimator_learned, &v2v_estimator_unrolled};

enum { ESTIMATORS = sizeof estimators / sizeof *estimators };

int64_t v2v_estimator_count(void)
{
    return ESTIMATORS;
}

const struct v2v_estimator_ops *v2v_estimator_at(int64_t index)
{
    V2V_ASSERT(index >= 0 && index < ESTIMATORS);
    return estimators[index];
}

enum v2v_status v2v_estimator_find(const struct v2v_estimator_ops **ops, const char *name)
{
    char known[128] = "";
    for (int i = 0; i < ESTIMATORS; i++) {
        if (strcmp(name, estimators[i]->name) == 0) {
            *ops = estimators[i];
            return V2V_OK;
        }
        size_t used = strlen(known);
        if (!estimators[i]->is_learned) { /* those come with weights, not by this setting */
            snprintf(known + used, sizeof known - used, "%s%s", used > 0 ? "|" : "",
                     estimators[i]->name);
        }
    }
    return V2V_FAIL(V2V_E_CONFIG, "deconv.method: '%s' is none of %s", name, known);
}

const struct v2v_estimator_ops *v2v_estimator_of_network(const struct v2v_network_ops *network)
{
    return network->traits & V2V_TRAIT_CORRECTS ? &v2v_estimator_unrolled : &v2v_estimator_learned;
}

int v2v_estimator_is_open(const struct v2v_estimator_ops *ops, const struct v2v_config *config)
{
    return ops->is_open != NULL && ops->is_open(config);
}

struct v2v_input_settings v2v_estimator_input(const struct v2v_estimator_ops *ops,
                                              const struct v2v_config *config)
{
    struct v2v_input_settings input = config->input;
    if (!ops->has_gain) {
        input.gain = (struct v2v_number){.mode = V2V_NUMBER_NONE};
    }
    return input;
}

enum v2v_status v2v_estimator_settle(struct v2v_config *config, const struct v2v_estimator_ops *ops,
                                     const struct v2v_problem *problem, const float *views,
                                     const struct v2v_averaging *averaging,
                                     const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(ops->settle(config, problem, views, averaging, world));
    v2v_par_broadcast(world, &config->deconv, sizeof config->deconv, 0);
    v2v_par_broadcast(world, &config->recon, sizeof config->recon, 0);
done:
    return rc;
}

enum v2v_status v2v_estimator_lay_out(struct v2v_grid *grid, const struct v2v_grid_work *work,
                                      int branches, int64_t beside, const struct v2v_config *config,
                                      struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_work own = *work;
    const struct v2v_grid_shape wanted = {branches, (int)config->parallel.shards};
    const int64_t limit = (int64_t)(config->parallel.max_mem_gb * 1e9);
    int64_t elsewhere = beside; /* ranks may hold more or less */
    if (wanted.shards > work->most_shards) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "parallel.shards: %d ranks cannot share a frame, %d at most",
                         wanted.shards, work->most_shards));
    }
    v2v_par_max_i64(world, &elsewhere, 1);
    own.most_bytes = limit > 0 ? v2v_larger(limit - elsewhere, 1) : 0;
    own.most_shards = config->parallel.reproducible
                          ? 1
                          : (int)v2v_smaller(work->most_shards, v2v_comm_size(world));
    V2V_TRY(v2v_grid_lay_out(grid, world, &wanted, &own));
done:
    return rc;
}

enum v2v_status v2v_estimator_create(struct v2v_estimator **estimator,
                                     const struct v2v_estimator_ops *ops,
                                     const struct v2v_problem *problem,
                                     const struct v2v_comm *shard)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_estimator *made = NULL;
    struct v2v_grid_work work;
    *estimator = NULL;
    rc = ops->describe_work(&work, problem);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(made, "estimator", 1);
    }
    if (rc == V2V_OK) {
        made->ops = ops; /* by which it is destroyed, if another rank fails */
    }
    V2V_TRY(v2v_par_agree(shard, rc));
    const unsigned all = (1u << work.most_branches) - 1;
    *made = (struct v2v_estimator){.ops = ops,
                                   .shard = shard,
                                   .height = v2v_round_up(problem->height, work.unit),
                                   .width = v2v_round_up(problem->width, work.unit),
                                   .held = problem->outputs != 0 ? problem->outputs & all : all,
                                   .slices = {0, problem->psf->slices},
                                   .computed_part = 1.0,
                                   .units = 1.0};
    V2V_TRY(ops->create(made, problem));
    *estimator = made;
    made = NULL;
done:
    v2v_estimator_destroy(&made);
    return rc;
}

void v2v_estimator_destroy(struct v2v_estimator **estimator)
{
    struct v2v_estimator *old = *estimator;
    *estimator = NULL;
    if (old != NULL) {
        old->ops->destroy(old);
        v2v_mem_free(old);
    }
}

enum v2v_status v2v_estimator_check_views(const struct v2v_estimator *estimator, const float *views,
                                          int64_t count)
{
    const int64_t height = estimator->height, width = estimator->width, pixels = height * width;
    const int64_t bad = v2v_first_not_finite(views, count * pixels);
    if (bad < 0) {
        return V2V_OK;
    }
    return V2V_FAIL(
        V2V_E_NUMERIC, "view %lld, row %lld, column %lld of the views that are used: NaN or Inf",
        (long long)(bad / pixels), (long long)(bad / width % height), (long long)(bad % width));
}

enum v2v_status v2v_estimator_mean(double *mean, const struct v2v_estimator *estimator,
                                   const float *views, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t samples = count * estimator->height * estimator->width;
    double sum = 0.0;
    V2V_TRY(v2v_estimator_check_views(estimator, views, count));
    for (int64_t i = 0; i < samples; i++) {
        sum += views[i] > 0.0f ? (double)views[i] : 0.0;
    }
    const int64_t seen = samples - v2v_blind_count(views, samples);
    *mean = seen > 0 ? sum / (double)seen : 0.0;
done:
    return rc;
}

enum v2v_status v2v_estimator_check_step(const struct v2v_estimator *estimator,
                                         enum v2v_status fault, const float *volume,
                                         const struct v2v_projector_share *share, const char *word,
                                         int64_t step)
{
    const int64_t rows = share->rows.count, width = estimator->width;
    const int64_t bad = v2v_first_not_finite(volume, share->slices.count * rows * width);
    const char *name = estimator->ops->name;
    if (bad >= 0) {
        return V2V_FAIL(V2V_E_NUMERIC,
                        "frame %lld, %s %s %lld: NaN or Inf at slice %lld, row %lld, column %lld",
                        (long long)estimator->frame, name, word, (long long)step,
                        (long long)(share->slices.first + bad / (rows * width)),
                        (long long)(share->rows.first + bad / width % rows),
                        (long long)(bad % width));
    }
    return fault == V2V_OK && v2v_stop_requested()
               ? V2V_FAIL(V2V_STOPPED, "stopped on request in %s %s %lld", name, word,
                          (long long)step)
               : fault;
}

void v2v_iterate_slices(const struct v2v_iterate *iterate, float *slices)
{
    struct v2v_estimator *estimator = iterate->estimator;
    const int64_t count = estimator->slices.count * estimator->height * estimator->width;
    const double scale = iterate->scale * estimator->units;
    iterate->to_slices(estimator, slices, iterate->volume);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        slices[i] = (float)(slices[i] * scale);
    }
}
