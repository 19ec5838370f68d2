#include "method/learned.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/optics/cost.h"

#include <limits.h>

struct learned {
    struct v2v_network *network;
    struct v2v_projector *projector; /* where the network asks for one, else NULL */
};

struct v2v_network_spec v2v_learned_spec(const struct v2v_problem *problem)
{
    return (struct v2v_network_spec){.config = problem->config,
                                     .psf = problem->psf,
                                     .views = problem->psf->views,
                                     .slices = problem->psf->slices,
                                     .outputs = V2V_NETWORK_ALL,
                                     .precision = problem->precision,
                                     .skip = problem->skip};
}

static enum v2v_status describe_work(struct v2v_grid_work *work, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    const struct v2v_network_spec spec = v2v_learned_spec(problem);
    V2V_TRY(v2v_network_find(&ops, problem->config->model.method));
    if (ops->traits & V2V_TRAIT_VIEWS) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "the network '%s' makes views, no volume", ops->name));
    }
    if (problem->config->parallel.reproducible && problem->config->parallel.shards > 1) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG,
                         "parallel.reproducible with parallel.shards: %lld: a network's volumes "
                         "depend on the slabs that a frame is cut into",
                         (long long)problem->config->parallel.shards));
    }
    ops->describe_work(work, &spec, problem->height, problem->width);
    work->most_shards = ops->traits & V2V_TRAIT_SLABS ? INT_MAX : 1;
    work->most_branches = ops->outputs;
done:
    return rc;
}

/** Local: the network with its weights. */
static enum v2v_status load(struct learned *self, const struct v2v_estimator *estimator,
                            const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_network_spec spec = v2v_learned_spec(problem);
    spec.outputs = estimator->held;
    spec.slabs = v2v_comm_size(estimator->shard);
    spec.shard = estimator->shard;
    V2V_TRY(v2v_network_create(&self->network, problem->config->model.method, &spec));
    V2V_TRY(v2v_weights_file_read(self->network->weights, problem->weights, "weights",
                                  &self->network->schema.fields));
    if (self->network->ops->leave_room != NULL) {
        self->network->ops->leave_room(self->network, problem->floats, problem->floats_a_row);
    }
done:
    return rc;
}

static enum v2v_status create(struct v2v_estimator *estimator, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_comm *shard = estimator->shard;
    struct learned *self = NULL;
    rc = V2V_ALLOC(self, "learned", 1);
    if (rc == V2V_OK) {
        estimator->self = self;
        rc = load(self, estimator, problem);
    }
    V2V_TRY(v2v_par_agree(shard, rc));
    estimator->output = self->network->output;
    if (self->network->ops->traits & V2V_TRAIT_PROJECTS) {
        enum v2v_split split;
        V2V_TRY(v2v_projector_choose_split(&split, problem->config, problem->psf, estimator->height,
                                           estimator->width, problem->psf->views, shard));
        V2V_TRY(v2v_projector_create(&self->projector, problem->psf, estimator->height,
                                     estimator->width, split, shard));
    }
    const struct v2v_network_plan plan = {
        .height = estimator->height, .width = estimator->width, .projector = self->projector};
    rc = self->network->ops->plan(self->network, &plan);
    V2V_TRY(v2v_par_agree(shard, rc));
done:
    return rc;
}

static void destroy(struct v2v_estimator *estimator)
{
    struct learned *self = estimator->self;
    if (self != NULL) {
        v2v_network_destroy(&self->network);
        v2v_projector_destroy(&self->projector);
        v2v_mem_free(self);
    }
}

static struct v2v_part rows_of(const struct v2v_estimator *estimator, int rank)
{
    const struct learned *self = estimator->self;
    return self->network->ops->rows_of(self->network, rank);
}

static enum v2v_status run(struct v2v_estimator *estimator, float *const *volume,
                           const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_network *network = ((struct learned *)estimator->self)->network;
    (void)monitor; /* there is nothing to look on at: a network does not iterate */
    rc = v2v_estimator_check_views(estimator, views, network->views);
    V2V_TRY(v2v_par_agree(estimator->shard, rc));
    network->ops->forward(network, volume, views);
    estimator->computed_part =
        network->ops->computed_part != NULL ? network->ops->computed_part(network) : 1.0;
done:
    return rc;
}

static const char *const keys[] = {"recon.combine", "recon.precision", NULL};

const struct v2v_estimator_ops v2v_estimator_learned = {
    .name = "learned",
    .is_learned = 1,
    .keys = keys,
    .has_gain = 1,
    .skips_light = 1,
    .describe_work = describe_work,
    .create = create,
    .destroy = destroy,
    .rows_of = rows_of,
    .run = run,
};
