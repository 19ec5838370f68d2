#include "train/trainer.h"

#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/tensor/bulk.h"
#include "v2v3d/tensor/statistics.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { OUTPUTS = V2V_NETWORK_MOST_OUTPUTS };

/* The tail: how many ranks say so, then the loss terms [sample, output, term], each of which one
 * rank knows: a sum over ranks leaves its bits alone. */
enum { FLAG_FAILED, FLAG_STOP, FLAG_CHECKPOINT, PART_SPENT, FLAGS };

/* The linear schedule: steps of its rise, and the part of the learning rate that it falls to; and
 * what the memory of averaged weights grows by (REFERENCE.md 14). */
enum { RISE = 20, GROWTH = 11 };
#define FALLS_TO 0.05

static const struct v2v_fields *fields_of(const struct v2v_trainer *trainer)
{
    return &trainer->network->schema.fields;
}

/* This rank's rows of the volumes. */
static struct v2v_part rows_of(const struct v2v_trainer *trainer)
{
    return trainer->network->ops->rows_of(trainer->network, v2v_comm_rank(trainer->grid.shard));
}

static struct v2v_network_spec describe(const struct v2v_trainer *trainer,
                                        const struct v2v_train_job *job)
{
    return (struct v2v_network_spec){.config = job->config,
                                     .psf = job->psf,
                                     .views = job->psf->views,
                                     .slices = job->psf->slices,
                                     .outputs = V2V_NETWORK_ALL,
                                     .slabs = trainer->slabs};
}

static enum v2v_status create_network(struct v2v_trainer *trainer, const struct v2v_train_job *job,
                                      int precision)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_network_spec spec = describe(trainer, job);
    spec.outputs = v2v_network_outputs_of(trainer->ops, &trainer->grid);
    spec.precision = precision;
    spec.shard = trainer->grid.shard;
    V2V_TRY(v2v_network_create(&trainer->network, trainer->ops->name, &spec));
    if (trainer->rounds > 1) {
        V2V_TRY(V2V_ALLOC(trainer->sum, "train.gradients", fields_of(trainer)->total));
    }
    V2V_TRY(V2V_ALLOC(trainer->m, "adam.m", fields_of(trainer)->total));
    V2V_TRY(V2V_ALLOC(trainer->v, "adam.v", fields_of(trainer)->total));
    if (job->config->train.average > 0.0) {
        V2V_TRY(V2V_ALLOC(trainer->average, "train.average", fields_of(trainer)->total));
    }
done:
    return rc;
}

/* A backward pass goes on while what it has finished travels. */
static void gradients_ready(void *context, int64_t first, int64_t count)
{
    struct v2v_trainer *trainer = context;
    v2v_bucket_sum_ready(trainer->buckets, first, count);
}

static enum v2v_status create_buckets(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    const struct v2v_schema *schema = &trainer->network->schema;
    struct v2v_bucket_run run[V2V_NETWORK_MOST_GROUPS];
    for (int64_t g = 0; g < schema->groups; g++) {
        const struct v2v_group *group = &schema->group[g];
        run[g] = (struct v2v_bucket_run){group->first, group->count, group->levels};
    }
    struct v2v_bucket_setup setup = {.world = grid->world,
                                     .level = {[V2V_GRID_LEVEL_SHARD] = grid->shard,
                                               [V2V_GRID_LEVEL_BRANCH] = grid->pair,
                                               [V2V_GRID_LEVEL_DATA] = grid->column},
                                     .run = run,
                                     .runs = schema->groups,
                                     .bucket = V2V_BUCKET_FLOATS};
    return v2v_bucket_sum_create(&trainer->buckets, &setup);
}

/* Local. */
static enum v2v_status take_memory(struct v2v_trainer *trainer, const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels =
        v2v_sampler_height(trainer->sampler) * v2v_sampler_width(trainer->sampler);
    trainer->image_floats = v2v_sampler_images(trainer->sampler) * pixels;
    if (!trainer->grid.idle) {
        V2V_TRY(V2V_ALLOC(trainer->images, "train.images", trainer->image_floats));
    }
    trainer->tail_count = FLAGS + job->config->train.batch * OUTPUTS * V2V_LOSS_TOTAL;
    V2V_TRY(V2V_ALLOC(trainer->tail, "train.tail", trainer->tail_count));
    V2V_TRY(V2V_ALLOC(trainer->checksums, "train.tail",
                      trainer->network->schema.groups * v2v_comm_size(trainer->grid.world)));
done:
    return rc;
}

/* The projector that network and loss share, over the ranks that share a sample. Slabs: the same
 * bits at any rank count. Collective(shard), agreed there. */
static enum v2v_status create_loss(struct v2v_trainer *trainer, const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    if (trainer->ops->examples != NULL) {
        trainer->volume_loss =
            (struct v2v_volume_loss){.settings = &job->config->loss,
                                     .slices = trainer->network->slices,
                                     .height = v2v_sampler_height(trainer->sampler),
                                     .width = v2v_sampler_width(trainer->sampler),
                                     .window = v2v_sampler_window(trainer->sampler)};
        return V2V_OK;
    }
    struct v2v_loss_setup setup = {.settings = &job->config->loss,
                                   .psf = job->psf,
                                   .reduce = job->config->psf.reduce,
                                   .height = v2v_sampler_height(trainer->sampler),
                                   .width = v2v_sampler_width(trainer->sampler),
                                   .window = v2v_sampler_window(trainer->sampler),
                                   .outputs = trainer->ops->outputs,
                                   .comm = trainer->grid.shard};
    const enum v2v_split split = v2v_split_of_slabs(job->config);
    for (int o = 0; o < setup.outputs; o++) {
        const struct v2v_output *output = &trainer->network->output[o];
        setup.held_out[o] = (struct v2v_held_out){output->held_out, output->count};
    }
    V2V_TRY(v2v_projector_create(&trainer->projector, job->psf, setup.height, setup.width, split,
                                 setup.comm));
    setup.projector = trainer->projector;
    V2V_TRY(v2v_loss_create(&trainer->loss, &setup));
done:
    return rc;
}

/* The volumes' rows here, and what the loss makes of them. Collective(shard). */
static enum v2v_status plan_network(struct v2v_trainer *trainer)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = trainer->ops;
    const int64_t width = v2v_sampler_width(trainer->sampler);
    const int64_t a_row = trainer->network->slices * width;
    const struct v2v_network_plan plan = {.height = v2v_sampler_height(trainer->sampler),
                                          .width = width,
                                          .training = 1,
                                          .projector = trainer->projector};
    if (ops->leave_room != NULL) {
        /* where ranks hold other rows than the projector, volumes on their way there, too */
        int64_t volumes = 2 * ops->outputs + (trainer->grid.shard_size > 1 ? 2 : 0);
        ops->leave_room(trainer->network, v2v_sampler_room(trainer->sampler), volumes * a_row);
    }
    V2V_TRY(ops->plan(trainer->network, &plan));
    trainer->voxels = rows_of(trainer).count * a_row;
    for (int o = 0; o < ops->outputs; o++) {
        V2V_TRY(V2V_ALLOC(trainer->volume[o], "train.volumes", trainer->voxels));
        V2V_TRY(V2V_ALLOC(trainer->dvolume[o], "train.volumes", trainer->voxels));
    }
    ops->watch(trainer->network, gradients_ready, trainer);
done:
    return rc;
}

/* An idle rank, alone with all slabs of a sample, plans none: it takes part in the steps' numbers
 * and keeps what checkpoints are read into. Collective(shard), agreed there. */
static enum v2v_status create_workspace(struct v2v_trainer *trainer,
                                        const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_par_agree(trainer->grid.shard, take_memory(trainer, job)));
    if (trainer->grid.idle) {
        goto done;
    }
    V2V_TRY(create_loss(trainer, job));
    V2V_TRY(v2v_par_agree(trainer->grid.shard, plan_network(trainer)));
    if (trainer->loss != NULL) {
        V2V_TRY(v2v_loss_hold(trainer->loss, rows_of(trainer)));
    }
done:
    return rc;
}

/* Slabs of rows decide on the weights' bits: there are as many as the configuration says, on one
 * rank or on as many. They are shared out when samples and outputs leave ranks over. */
static enum v2v_status count_slabs(struct v2v_trainer *trainer, struct v2v_grid_shape *wanted,
                                   int ranks)
{
    const struct v2v_config *config = trainer->config;
    int64_t slabs = config->parallel.slabs, shards = config->parallel.shards;
    if (config->parallel.reproducible && slabs == 0 && shards > 1) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "parallel.reproducible with parallel.shards: %lld needs "
                        "parallel.slabs, on which the bits depend",
                        (long long)shards);
    }
    trainer->slabs = slabs > 0 ? slabs : shards > 1 ? shards : 1;
    if (shards > 1 && shards != trainer->slabs) {
        return V2V_FAIL(
            V2V_E_CONFIG,
            "parallel.shards: %lld ranks cannot share %lld slabs (parallel.slabs): it is "
            "one each, or one rank with all",
            (long long)shards, (long long)slabs);
    }
    int64_t others = config->train.batch * trainer->ops->outputs * trainer->slabs;
    wanted->branches = (int)config->parallel.branches;
    wanted->shards = shards > 0 ? (int)shards : ranks >= others ? (int)trainer->slabs : 1;
    return V2V_OK;
}

/* Collective(comm). */
static enum v2v_status lay_out(struct v2v_trainer *trainer, struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_shape wanted;
    struct v2v_grid_work work = {.items = trainer->config->train.batch,
                                 .height = 1,
                                 .unit = 1,
                                 .most_branches = trainer->ops->outputs};
    V2V_TRY(count_slabs(trainer, &wanted, v2v_comm_size(comm)));
    V2V_TRY(v2v_grid_lay_out(&trainer->grid, comm, &wanted, &work));
done:
    return rc;
}

enum v2v_status v2v_trainer_create(struct v2v_trainer *trainer, const struct v2v_train_job *job,
                                   struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    int precision = V2V_PRECISION_F32;
    struct v2v_grid_work work;
    *trainer = (struct v2v_trainer){.config = job->config};
    V2V_TRY(v2v_network_find(&trainer->ops, job->config->model.method));
    trainer->psf_sum = v2v_psf_file_sum(job->psf);
    V2V_TRY(lay_out(trainer, comm));
    trainer->rounds = v2v_parts(job->config->train.batch, trainer->grid.data_size);
    struct v2v_network_spec spec = describe(trainer, job);
    trainer->ops->describe_work(&work, &spec, 1, 1);
    const struct v2v_sample_sides sides = {.unit = work.unit, .crop = trainer->ops->crop};
    V2V_TRY(v2v_sampler_create(&trainer->sampler, job, sides, trainer->ops->examples, comm));
    V2V_TRY(v2v_precision_agree(&precision, job->config->train.precision, comm));
    V2V_TRY(v2v_par_agree(comm, create_network(trainer, job, precision)));
    V2V_TRY(create_buckets(trainer));
    V2V_TRY(v2v_par_agree(comm, create_workspace(trainer, job)));
done:
    return rc;
}

void v2v_trainer_destroy(struct v2v_trainer *trainer)
{
    v2v_loss_destroy(&trainer->loss);
    v2v_network_destroy(&trainer->network);
    v2v_projector_destroy(&trainer->projector);
    v2v_sampler_destroy(&trainer->sampler);
    float *memory[] = {trainer->m, trainer->v, trainer->average, trainer->sum, trainer->images};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    for (int o = 0; o < OUTPUTS; o++) {
        v2v_mem_free(trainer->volume[o]);
        v2v_mem_free(trainer->dvolume[o]);
    }
    v2v_mem_free(trainer->tail);
    v2v_mem_free(trainer->checksums);
    v2v_bucket_sum_destroy(&trainer->buckets);
    v2v_grid_destroy(&trainer->grid);
    *trainer = (struct v2v_trainer){0};
}

/* This rank's rows of all volumes of the sample. Collective(shard, pair). */
static void make_volumes(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    trainer->ops->forward(trainer->network, trainer->volume, trainer->images);
    if (grid->branch_size > 1) {
        int own = grid->branch_rank;
        v2v_par_exchange_f32(grid->pair, trainer->volume[1 - own], trainer->volume[own],
                             trainer->voxels, 1 - own);
    }
}

/* The losses, and what they make of the volumes. Collective(shard). */
static void judge(struct v2v_trainer *trainer, double *value)
{
    const float *volume[OUTPUTS] = {NULL};
    if (trainer->loss == NULL) { /* what is known follows what goes in */
        const float *known = trainer->images + trainer->network->inputs *
                                                   trainer->volume_loss.height *
                                                   trainer->volume_loss.width;
        v2v_volume_loss_evaluate(&trainer->volume_loss, value, trainer->dvolume[0],
                                 trainer->volume[0], known);
        return;
    }
    for (int o = 0; o < trainer->ops->outputs; o++) {
        volume[o] = trainer->volume[o];
    }
    v2v_loss_evaluate(trainer->loss, value, trainer->network->held, trainer->dvolume, volume,
                      trainer->images);
}

/* Forward, losses and backward of one sample: sets the gradients. The ranks of a shard share the
 * losses and know them all; one of them reports. Collective(shard, pair). */
static void run_sample(struct v2v_trainer *trainer, int64_t sample)
{
    const struct v2v_grid *grid = &trainer->grid;
    const float *dvolume[OUTPUTS] = {NULL};
    double value[V2V_LOSS_TERMS];
    make_volumes(trainer);
    for (int o = 0; o < trainer->ops->outputs; o++) {
        dvolume[o] = trainer->dvolume[o];
    }
    judge(trainer, value);
    trainer->ops->backward(trainer->network, dvolume);
    if (grid->shard_rank == 0) {
        memcpy(trainer->tail + FLAGS + (sample * OUTPUTS + grid->branch_rank) * V2V_LOSS_TOTAL,
               value, V2V_LOSS_TOTAL * sizeof *value);
    }
}

/* Where the batch's gradient ends up. */
static float *batch_gradients(struct v2v_trainer *trainer)
{
    return trainer->sum != NULL ? trainer->sum : trainer->network->gradients;
}

/* One sample a rank, or none where they have run out; the sum over samples keeps their order, so
 * rounds cannot be added up by themselves first. A sample that cannot be read counts as dark until
 * the step ends: its rank may not leave the others alone. Collective(world). */
static enum v2v_status run_round(struct v2v_trainer *trainer, int64_t step, int64_t round)
{
    enum v2v_status drawn = V2V_OK;
    const struct v2v_grid *grid = &trainer->grid;
    int64_t total = fields_of(trainer)->total, batch = trainer->config->train.batch;
    int64_t sample = round * grid->data_size + grid->data_rank;
    struct v2v_bucket_round setup = {.x = trainer->network->gradients,
                                     .total = batch_gradients(trainer),
                                     .first = round == 0,
                                     .last = round == trainer->rounds - 1,
                                     .factor = 1.0f / (float)batch};
    if (grid->idle) {
        goto finish;
    }
    v2v_bucket_sum_begin(trainer->buckets, &setup);
    if (sample >= batch) {
        v2v_bulk_clear(setup.x, total);
        v2v_bucket_sum_ready(trainer->buckets, 0, total);
        goto finish;
    }
    drawn = v2v_sampler_draw(trainer->sampler, trainer->images, step, sample);
    if (drawn != V2V_OK) {
        memset(trainer->images, 0, (size_t)trainer->image_floats * sizeof *trainer->images);
        trainer->tail[FLAG_FAILED] = 1.0;
    }
    run_sample(trainer, sample);
finish:
    v2v_bucket_sum_finish(trainer->buckets, trainer->tail, setup.last ? trainer->tail_count : 0);
    return drawn;
}

enum v2v_status v2v_trainer_try(struct v2v_trainer *trainer, int64_t step)
{
    enum v2v_status drawn = V2V_OK;
    const struct v2v_grid *grid = &trainer->grid;
    if (!grid->idle && grid->data_rank < trainer->config->train.batch) {
        drawn = v2v_sampler_draw(trainer->sampler, trainer->images, step, grid->data_rank);
    }
    return v2v_par_agree(grid->world, drawn);
}

/* The length of the batch's gradient, the same on all ranks to the last bit. Collective(world). */
static double squared_norm(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    const struct v2v_schema *schema = &trainer->network->schema;
    double part[V2V_NETWORK_MOST_GROUPS] = {0.0}, squares = 0.0;
    for (int64_t g = 0; g < schema->groups && !grid->idle; g++) {
        const struct v2v_group *group = &schema->group[g];
        int is_shared = (group->levels >> V2V_GRID_LEVEL_BRANCH & 1) != 0;
        if (!is_shared || grid->branch_rank <= 0) { /* shared: the same on both ranks of a pair */
            part[g] = v2v_sum_of_squares(batch_gradients(trainer) + group->first, group->count);
        }
    }
    v2v_par_sum_f64(grid->pair, part, schema->groups);
    for (int64_t g = 0; g < schema->groups; g++) {
        squares += part[g];
    }
    if (grid->data_size * grid->branch_size * grid->shard_size < v2v_comm_size(grid->world)) {
        v2v_par_broadcast(grid->world, &squares, sizeof squares, 0); /* idle ranks have none */
    }
    return squares;
}

/* From the tail: terms of all samples in their order, and votes. Local. */
static void read_tail(const struct v2v_trainer *trainer, struct v2v_step_result *result)
{
    double weight[V2V_LOSS_TERMS];
    int64_t batch = trainer->config->train.batch;
    const double *term = trainer->tail + FLAGS;
    v2v_loss_weights(weight, &trainer->config->loss);
    for (int64_t s = 0; s < batch; s++, term += OUTPUTS * V2V_LOSS_TOTAL) {
        for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
            result->terms[i] += term[i] + term[V2V_LOSS_TOTAL + i];
        }
    }
    for (int i = 0; i < V2V_LOSS_TOTAL; i++) {
        result->terms[i] /= (double)batch;
        result->terms[V2V_LOSS_TOTAL] += weight[i] * result->terms[i];
    }
    result->stop = trainer->tail[FLAG_STOP] > 0.0;
    result->checkpoint = trainer->tail[FLAG_CHECKPOINT] > 0.0;
    result->spent = trainer->tail[PART_SPENT];
}

/* Scale a gradient that is longer than train.clip_norm down to it. */
static void clip_gradients(struct v2v_trainer *trainer, double norm)
{
    double most = trainer->config->train.clip_norm;
    if (most <= 0.0 || norm <= most) {
        return;
    }
    float *gradients = batch_gradients(trainer);
    const float factor = (float)(most / norm);
    int64_t total = fields_of(trainer)->total;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < total; i++) {
        gradients[i] *= factor;
    }
}

/* @param spent part of the time */
static double learning_rate(const struct v2v_train_settings *settings, int64_t step, double spent)
{
    if (settings->schedule == V2V_SCHEDULE_LINEAR) {
        const double part = fmax(spent, (double)step / (double)settings->steps);
        const double risen = fmin((double)(step + 1) / RISE, 1.0);
        return settings->learning_rate * risen * (1.0 - (1.0 - FALLS_TO) * fmin(part, 1.0));
    }
    int decayed = settings->decay_at > 0 && step >= settings->decay_at;
    return settings->learning_rate * (decayed ? settings->decay : 1.0);
}

/* The first steps' weights are far from the last ones', so that the memory has to grow first. */
static void average_weights(struct v2v_trainer *trainer, int64_t step)
{
    const double grown = (double)(step + 1) / (double)(step + GROWTH);
    const float memory = (float)fmin(trainer->config->train.average, grown);
    const float *weights = trainer->network->weights;
    float *average = trainer->average;
    int64_t total = fields_of(trainer)->total;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < total; i++) {
        average[i] = memory * average[i] + (1.0f - memory) * weights[i];
    }
}

static void step_weights(struct v2v_trainer *trainer, const struct v2v_step_result *result,
                         int64_t step)
{
    const struct v2v_train_settings *settings = &trainer->config->train;
    struct v2v_adam adam = {.learning_rate = learning_rate(settings, step, result->spent),
                            .beta1 = settings->beta1,
                            .beta2 = settings->beta2,
                            .epsilon = settings->epsilon};
    clip_gradients(trainer, result->grad_norm);
    v2v_adam_step(&adam, trainer->network->weights, trainer->m, trainer->v,
                  batch_gradients(trainer), fields_of(trainer)->total, step + 1);
    if (V2V_FAULT_POINT("train.weights") != V2V_OK) {
        trainer->network->weights[0] *= 1.0f + FLT_EPSILON; /* what bad memory does */
    }
    trainer->ops->weights_changed(trainer->network);
    if (trainer->average != NULL) {
        average_weights(trainer, step);
    }
}

enum v2v_status v2v_trainer_step(struct v2v_trainer *trainer, struct v2v_step_result *result,
                                 int64_t step, const struct v2v_step_votes *votes)
{
    enum v2v_status rc = V2V_OK, mine = votes->earlier;
    const struct v2v_grid *grid = &trainer->grid;
    *result = (struct v2v_step_result){0};
    memset(trainer->tail, 0, (size_t)trainer->tail_count * sizeof *trainer->tail);
    trainer->tail[FLAG_FAILED] = mine != V2V_OK;
    trainer->tail[FLAG_STOP] = votes->stop != 0;
    trainer->tail[FLAG_CHECKPOINT] = votes->checkpoint != 0;
    trainer->tail[PART_SPENT] = votes->spent;
    for (int64_t round = 0; round < trainer->rounds; round++) {
        enum v2v_status drawn = run_round(trainer, step, round);
        mine = mine == V2V_OK ? drawn : mine;
    }
    if (trainer->tail[FLAG_FAILED] > 0.0) {
        V2V_TRY(v2v_par_agree(grid->world, mine));
    }
    read_tail(trainer, result);
    double squares = squared_norm(trainer);
    result->grad_norm = sqrt(squares);
    /* Adam squares every element in float32: where the whole sum fits, each square does */
    result->finite = isfinite((float)squares) && isfinite(result->terms[V2V_LOSS_TOTAL]);
    if (result->finite && !grid->idle) {
        step_weights(trainer, result, step);
    }
done:
    return rc;
}
