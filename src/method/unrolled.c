#include "method/unrolled.h"

#include "method/correction.h"
#include "method/features.h"
#include "method/learned.h"
#include "method/strength.h"
#include "method/tv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/tensor/bulk.h"

struct unrolled {
    struct v2v_features *features;
    struct v2v_network *network;
    struct v2v_correction *correction;
    double strength; /* of the correction: 0 .. 1 */
    int64_t voxels;
    float *found; /* [feature,z,y,x] */
};

static int is_open(const struct v2v_config *config)
{
    return config->recon.strength.mode == V2V_NUMBER_AUTO || v2v_estimator_tv.is_open(config);
}

static enum v2v_status settle(struct v2v_config *config, const struct v2v_problem *problem,
                              const float *views, const struct v2v_averaging *averaging,
                              const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    double strength = 1.0;
    V2V_TRY(v2v_estimator_tv.settle(config, problem, views, averaging, comm));
    if (config->recon.strength.mode == V2V_NUMBER_AUTO) {
        V2V_TRY(v2v_strength_choose(&strength, problem, views, averaging, comm));
        config->recon.strength = (struct v2v_number){V2V_NUMBER_GIVEN, strength};
    }
done:
    return rc;
}

/* As total variation, on one rank, and the features; the network holds a tile. */
static enum v2v_status describe_work(struct v2v_grid_work *work, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = problem->psf;
    const struct v2v_torus torus = v2v_tv_torus_of(problem);
    const int64_t torus_pixels = v2v_mem_product(torus.height, torus.width, 1);
    const int64_t floats =
        v2v_mem_product(psf->slices + psf->views, torus_pixels, 1) +
        v2v_mem_product(V2V_FEATURES * psf->slices, problem->height, problem->width);
    const int64_t of_network = v2v_correction_bytes(psf->slices) / (int64_t)sizeof(float);
    V2V_TRY(v2v_estimator_tv.describe_work(work, problem));
    work->bytes = v2v_mem_bytes(floats, v2v_mem_bytes(of_network, work->bytes));
    work->most_shards = 1;
done:
    return rc;
}

static enum v2v_status plan(struct unrolled *self, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_network_spec spec = v2v_learned_spec(problem);
    const int64_t height = problem->height, width = problem->width, slices = spec.slices;
    spec.skip = 0.0; /* over time, not in a volume */
    V2V_TRY(v2v_network_create(&self->network, problem->config->model.method, &spec));
    if (problem->weights != NULL) {
        V2V_TRY(v2v_weights_file_read(self->network->weights, problem->weights, "weights",
                                      &self->network->schema.fields));
    }
    V2V_TRY(v2v_features_create(&self->features, problem));
    V2V_TRY(v2v_correction_create(&self->correction, self->network, height, width));
    const struct v2v_number *strength = &problem->config->recon.strength;
    self->strength = strength->mode == V2V_NUMBER_GIVEN ? strength->value : 1.0;
    self->voxels = v2v_mem_product(slices, height, width);
    V2V_TRY(V2V_ALLOC(self->found, "unrolled.features",
                      v2v_mem_product(V2V_FEATURES * slices, height, width)));
done:
    return rc;
}

static enum v2v_status create(struct v2v_estimator *estimator, const struct v2v_problem *problem)
{
    struct unrolled *self = NULL;
    enum v2v_status rc = V2V_ALLOC(self, "unrolled", 1);
    if (rc == V2V_OK) {
        estimator->self = self;
        rc = plan(self, problem);
    }
    return v2v_par_agree(estimator->shard, rc);
}

static void destroy(struct v2v_estimator *estimator)
{
    struct unrolled *self = estimator->self;
    if (self != NULL) {
        v2v_correction_destroy(&self->correction);
        v2v_network_destroy(&self->network);
        v2v_features_destroy(&self->features);
        v2v_mem_free(self->found);
        v2v_mem_free(self);
    }
}

const float *v2v_unrolled_start(const struct v2v_estimator *estimator)
{
    const struct unrolled *self = estimator->self;
    return self->found;
}

static void weaken(const struct unrolled *self, float *volume)
{
    const float strength = (float)self->strength;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < self->voxels; i++) {
        volume[i] = self->found[i] + strength * (volume[i] - self->found[i]);
    }
}

static enum v2v_status run(struct v2v_estimator *estimator, float *const *volume,
                           const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct unrolled *self = estimator->self;
    struct v2v_estimator *tv = v2v_features_tv(self->features);
    struct v2v_tv_noise noise;
    (void)monitor; /* the iterations under it are another method's */
    tv->frame = estimator->frame;
    tv->most_iterations = estimator->most_iterations;
    tv->around = estimator->around;
    tv->averaging = estimator->averaging;
    rc = v2v_features_of_views(self->features, self->found, NULL, &noise, views);
    tv->around = NULL;
    tv->averaging = NULL;
    V2V_TRY(v2v_par_agree(estimator->shard, rc));
    estimator->iterations = tv->iterations;
    estimator->misfit = tv->misfit;
    v2v_correction_run(self->correction, volume[0], self->found);
    if (self->strength < 1.0) {
        weaken(self, volume[0]);
    }
done:
    return rc;
}

/* The network has no biases, and tiles of a frame are as good as the frame: what total variation
 * measures, and the weights, are all that a part has to be told. */
static void measure(struct v2v_estimator *whole, const float *views)
{
    struct v2v_estimator *tv = v2v_features_tv(((struct unrolled *)whole->self)->features);
    tv->averaging = whole->averaging;
    tv->ops->measure(tv, views);
    tv->averaging = NULL;
}

static void inherit(struct v2v_estimator *window, const struct v2v_estimator *whole)
{
    const struct unrolled *of_frame = whole->self, *self = window->self;
    struct v2v_estimator *tv = v2v_features_tv(self->features);
    tv->ops->inherit(tv, v2v_features_tv(of_frame->features));
    v2v_bulk_copy(self->network->weights, of_frame->network->weights,
                  self->network->schema.fields.total);
    v2v_correction_weights_changed(self->correction);
}

static void whole_light(struct v2v_estimator *whole, float *volume, float *views)
{
    struct v2v_estimator *tv = v2v_features_tv(((struct unrolled *)whole->self)->features);
    tv->ops->whole_light(tv, volume, views);
}

static void project(struct v2v_estimator *estimator, float *views, const float *volume)
{
    struct v2v_estimator *tv = v2v_features_tv(((struct unrolled *)estimator->self)->features);
    tv->ops->project(tv, views, volume);
}

static const char *const keys[] = {"recon.strength", "recon.precision", V2V_TV_KEYS, NULL};

const struct v2v_estimator_ops v2v_estimator_unrolled = {
    .name = "unrolled",
    .is_learned = 1,
    .leaves_blind = 1,
    .keys = keys,
    .is_open = is_open,
    .settle = settle,
    .describe_work = describe_work,
    .create = create,
    .destroy = destroy,
    .run = run,
    .measure = measure,
    .inherit = inherit,
    .whole_light = whole_light,
    .project = project,
};
