#include "train/trainer.h"

#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/tensor/bulk.h"
#include "v2v3d/tensor/statistics.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { BRANCHES = 2 };

/* The tail: how many ranks say so, then the loss terms [sample, branch, term], each of which one
 * rank knows: a sum over ranks leaves its bits alone. */
enum { FLAG_FAILED, FLAG_STOP, FLAG_CHECKPOINT, FLAGS };

/* The branches that this rank computes; an idle rank holds the second without using it. */
static unsigned held_branches(const struct v2v_grid *grid)
{
    if (grid->branch_size == 1) {
        return V2V_BRANCH_BOTH;
    }
    return grid->branch_rank == 0 ? V2V_BRANCH_1 : V2V_BRANCH_2;
}

/* The arenas hold the encoder's fields, then those of the U-Nets held. */
static void measure_fields(struct v2v_trainer *trainer, const struct v2v_fields *fields)
{
    static const char *const prefix[BRANCHES] = {"unet1.", "unet2."};
    trainer->encoder_floats = fields->total;
    for (int b = BRANCHES - 1; b >= 0; b--) {
        int64_t end = trainer->encoder_floats;
        for (int64_t i = fields->count - 1; i >= 0; i--) {
            if (strncmp(fields->item[i].name, prefix[b], strlen(prefix[b])) == 0) {
                trainer->encoder_floats = fields->item[i].offset;
            }
        }
        trainer->unet_floats[b] = end - trainer->encoder_floats;
    }
}

static enum v2v_status create_model(struct v2v_trainer *trainer, const struct v2v_train_job *job,
                                    int precision)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_shifts shifts = {0};
    struct v2v_model_spec spec = {.views = job->psf->views,
                                  .slices = job->psf->slices,
                                  .width = job->config->model.width,
                                  .features = job->config->model.features,
                                  .branches = held_branches(&trainer->grid),
                                  .backend = job->config->model.backend,
                                  .winograd = job->config->model.winograd,
                                  .precision = precision,
                                  .every_slice = !job->config->model.merge,
                                  .volume_scale = job->config->model.volume_scale,
                                  .slabs = trainer->slabs,
                                  .shard = trainer->grid.shard};
    V2V_TRY(v2v_shifts_from_psf(&shifts, job->psf));
    V2V_TRY(v2v_model_create(&trainer->model, &spec, &shifts));
    const struct v2v_fields *fields = v2v_model_fields(trainer->model);
    measure_fields(trainer, fields);
    if (trainer->rounds > 1) {
        V2V_TRY(V2V_ALLOC(trainer->sum, "train.gradients", fields->total));
    }
    V2V_TRY(V2V_ALLOC(trainer->m, "adam.m", fields->total));
    V2V_TRY(V2V_ALLOC(trainer->v, "adam.v", fields->total));
done:
    v2v_shifts_fini(&shifts);
    return rc;
}

/* A backward pass goes on while what it has finished travels. */
static void gradients_ready(void *context, int64_t first, int64_t count)
{
    struct v2v_trainer *trainer = context;
    v2v_bucket_sum_ready(trainer->buckets, first, count);
}

/* The encoder's gradients come last, summed over slabs already, then over both branches; a U-Net's
 * over slabs and its own column. */
static enum v2v_status create_buckets(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    const unsigned samples = 1u << V2V_LEVEL_DATA, branches = 1u << V2V_LEVEL_BRANCH;
    const unsigned slabs = 1u << V2V_LEVEL_SHARD;
    struct v2v_bucket_run run[BRANCHES + 1] = {{0}};
    int64_t first = trainer->encoder_floats;
    for (int b = 0; b < BRANCHES; b++) {
        run[b] = (struct v2v_bucket_run){first, trainer->unet_floats[b], slabs | samples};
        first += trainer->unet_floats[b];
    }
    run[BRANCHES] = (struct v2v_bucket_run){0, trainer->encoder_floats, branches | samples};
    struct v2v_bucket_setup setup = {.world = grid->world,
                                     .level = {[V2V_LEVEL_SHARD] = grid->shard,
                                               [V2V_LEVEL_BRANCH] = grid->pair,
                                               [V2V_LEVEL_DATA] = grid->column},
                                     .run = run,
                                     .runs = BRANCHES + 1,
                                     .bucket = V2V_BUCKET_FLOATS};
    return v2v_bucket_sum_create(&trainer->buckets, &setup);
}

static enum v2v_status create_workspace(struct v2v_trainer *trainer,
                                        const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    int64_t height = v2v_sampler_height(trainer->sampler);
    int64_t width = v2v_sampler_width(trainer->sampler);
    struct v2v_loss_setup setup = {.settings = &job->config->loss,
                                   .psf = job->psf,
                                   .reduce = job->config->psf.reduce,
                                   .height = height,
                                   .width = width,
                                   .window = v2v_sampler_window(trainer->sampler)};
    trainer->height = height;
    trainer->voxels = job->psf->slices * height * width;
    trainer->view_floats = job->psf->views * height * width;
    V2V_TRY(V2V_ALLOC(trainer->views, "train.views", trainer->view_floats));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(trainer->volume[b], "train.volumes", trainer->voxels));
        V2V_TRY(V2V_ALLOC(trainer->dvolume[b], "train.volumes", trainer->voxels));
    }
    trainer->tail_count = FLAGS + job->config->train.batch * BRANCHES * V2V_LOSS_TOTAL;
    V2V_TRY(V2V_ALLOC(trainer->tail, "train.tail", trainer->tail_count));
    V2V_TRY(V2V_ALLOC(trainer->checksums, "train.tail",
                      V2V_TRAINER_PARTS * v2v_comm_size(trainer->grid.world)));
    V2V_TRY(v2v_loss_create(&trainer->loss, &setup));
    int64_t shared = trainer->grid.shard_size > 1 ? BRANCHES * job->psf->slices * width : 0;
    v2v_model_leave_room(trainer->model, v2v_sampler_room(trainer->sampler), shared);
    V2V_TRY(v2v_model_plan(trainer->model, height, width, 1));
    if (trainer->grid.shard_size > 1) {
        int64_t rows = v2v_model_rows(trainer->model).count;
        V2V_TRY(
            V2V_ALLOC(trainer->rows, "train.volumes", BRANCHES * job->psf->slices * rows * width));
    }
    v2v_model_watch_gradients(trainer->model, gradients_ready, trainer);
done:
    return rc;
}

/* Slabs of rows decide on the weights' bits: there are as many as the configuration says, on one
 * rank or on as many. They are shared out when samples and branches leave ranks over. */
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
    int64_t others = config->train.batch * BRANCHES * trainer->slabs;
    wanted->branches = (int)config->parallel.branches;
    wanted->shards = shards > 0 ? (int)shards : ranks >= others ? (int)trainer->slabs : 1;
    return V2V_OK;
}

/* Collective(comm). */
static enum v2v_status lay_out(struct v2v_trainer *trainer, struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_shape wanted;
    struct v2v_grid_work work = {.items = trainer->config->train.batch, .height = 1, .unit = 1};
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
    *trainer = (struct v2v_trainer){.config = job->config};
    V2V_TRY(lay_out(trainer, comm));
    trainer->rounds =
        (job->config->train.batch + trainer->grid.data_size - 1) / trainer->grid.data_size;
    V2V_TRY(v2v_sampler_create(&trainer->sampler, job, comm));
    V2V_TRY(v2v_precision_agree(&precision, job->config->train.precision, comm));
    V2V_TRY(v2v_par_agree(comm, create_model(trainer, job, precision)));
    V2V_TRY(create_buckets(trainer));
    V2V_TRY(v2v_par_agree(comm, create_workspace(trainer, job)));
done:
    return rc;
}

void v2v_trainer_destroy(struct v2v_trainer *trainer)
{
    v2v_loss_destroy(&trainer->loss);
    v2v_model_destroy(&trainer->model);
    v2v_sampler_destroy(&trainer->sampler);
    float *memory[] = {trainer->m,          trainer->v,          trainer->sum,
                       trainer->views,      trainer->volume[0],  trainer->volume[1],
                       trainer->dvolume[0], trainer->dvolume[1], trainer->rows};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_mem_free(trainer->tail);
    v2v_mem_free(trainer->checksums);
    v2v_bucket_sum_destroy(&trainer->buckets);
    v2v_grid_destroy(&trainer->grid);
    *trainer = (struct v2v_trainer){0};
}

/* Both volumes of the sample, whole, on every rank that shares it. Collective(shard, pair). */
static void make_volumes(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    float *part[BRANCHES] = {trainer->volume[0], trainer->volume[1]};
    int64_t held = v2v_model_rows(trainer->model).count * trainer->voxels / trainer->height;
    for (int b = 0; b < BRANCHES && grid->shard_size > 1; b++) {
        part[b] = trainer->rows + b * held;
    }
    v2v_model_forward(trainer->model, part[0], part[1], trainer->views);
    for (int b = 0; b < BRANCHES; b++) {
        if (held_branches(grid) & 1u << b) {
            v2v_model_gather(trainer->model, trainer->volume[b], part[b]);
        }
    }
    if (grid->branch_size == BRANCHES) {
        int own = grid->branch_rank;
        v2v_par_exchange_f32(grid->pair, trainer->volume[1 - own], trainer->volume[own],
                             trainer->voxels, 1 - own);
    }
}

/* A volume's rows of this rank's slab, in the same memory. */
static void keep_rows(const struct v2v_trainer *trainer, float *volume)
{
    struct v2v_part rows = v2v_model_rows(trainer->model);
    int64_t slices = v2v_model_spec(trainer->model)->slices;
    int64_t slice = trainer->voxels / slices, width = slice / trainer->height;
    for (int64_t z = 0; z < slices && trainer->grid.shard_size > 1; z++) {
        memmove(volume + z * rows.count * width, volume + z * slice + rows.first * width,
                (size_t)(rows.count * width) * sizeof *volume);
    }
}

/* Forward, losses and backward of one sample: sets the gradients. The ranks of a shard compute
 * the same losses of whole volumes; one of them reports. Collective(shard, pair). */
static void run_sample(struct v2v_trainer *trainer, int64_t sample)
{
    const struct v2v_grid *grid = &trainer->grid;
    double value[V2V_LOSS_TERMS];
    make_volumes(trainer);
    const float *const volume[BRANCHES] = {trainer->volume[0], trainer->volume[1]};
    v2v_loss_evaluate(trainer->loss, value, held_branches(grid), trainer->dvolume, volume,
                      trainer->views);
    keep_rows(trainer, trainer->dvolume[0]);
    keep_rows(trainer, trainer->dvolume[1]);
    v2v_model_backward(trainer->model, trainer->dvolume[0], trainer->dvolume[1]);
    if (grid->shard_rank == 0) {
        memcpy(trainer->tail + FLAGS + (sample * BRANCHES + grid->branch_rank) * V2V_LOSS_TOTAL,
               value, V2V_LOSS_TOTAL * sizeof *value);
    }
}

/* Where the batch's gradient ends up. */
static float *batch_gradients(struct v2v_trainer *trainer)
{
    return trainer->sum != NULL ? trainer->sum : v2v_model_gradients(trainer->model);
}

/* One sample a rank, or none where they have run out; the sum over samples keeps their order, so
 * rounds cannot be added up by themselves first. A sample that cannot be read counts as dark until
 * the step ends: its rank may not leave the others alone. Collective(world). */
static enum v2v_status run_round(struct v2v_trainer *trainer, int64_t step, int64_t round)
{
    enum v2v_status drawn = V2V_OK;
    const struct v2v_grid *grid = &trainer->grid;
    int64_t total = v2v_model_fields(trainer->model)->total, batch = trainer->config->train.batch;
    int64_t sample = round * grid->data_size + grid->data_rank;
    struct v2v_bucket_round setup = {.x = v2v_model_gradients(trainer->model),
                                     .total = batch_gradients(trainer),
                                     .first = round == 0,
                                     .last = round == trainer->rounds - 1,
                                     .factor = 1.0f / (float)batch};
    v2v_bucket_sum_begin(trainer->buckets, &setup);
    if (grid->idle || sample >= batch) {
        v2v_bulk_clear(setup.x, total);
        v2v_bucket_sum_ready(trainer->buckets, 0, total);
        goto finish;
    }
    drawn = v2v_sampler_draw(trainer->sampler, trainer->views, step, sample);
    if (drawn != V2V_OK) {
        memset(trainer->views, 0, (size_t)trainer->view_floats * sizeof *trainer->views);
        trainer->tail[FLAG_FAILED] = 1.0;
    }
    run_sample(trainer, sample);
finish:
    v2v_bucket_sum_finish(trainer->buckets, trainer->tail, setup.last ? trainer->tail_count : 0);
    return drawn;
}

/* The length of the batch's gradient, the same on all ranks to the last bit. Collective(world). */
static double squared_norm(struct v2v_trainer *trainer)
{
    const struct v2v_grid *grid = &trainer->grid;
    const float *gradients = batch_gradients(trainer);
    double part[1 + BRANCHES] = {0.0}, squares = 0.0;
    if (grid->branch_rank <= 0) { /* the encoder's are the same on both ranks of a pair */
        part[0] = v2v_sum_of_squares(gradients, trainer->encoder_floats);
    }
    gradients += trainer->encoder_floats;
    for (int b = 0; b < BRANCHES; b++) {
        part[1 + b] = v2v_sum_of_squares(gradients, trainer->unet_floats[b]);
        gradients += trainer->unet_floats[b];
    }
    v2v_par_sum_f64(grid->pair, part, 1 + BRANCHES);
    for (int i = 0; i < 1 + BRANCHES; i++) {
        squares += part[i];
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
    for (int64_t s = 0; s < batch; s++, term += BRANCHES * V2V_LOSS_TOTAL) {
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
    int64_t total = v2v_model_fields(trainer->model)->total;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < total; i++) {
        gradients[i] *= factor;
    }
}

static double learning_rate(const struct v2v_train_settings *settings, int64_t step)
{
    int decayed = settings->decay_at > 0 && step >= settings->decay_at;
    return settings->learning_rate * (decayed ? settings->decay : 1.0);
}

static void step_weights(struct v2v_trainer *trainer, double grad_norm, int64_t step)
{
    const struct v2v_train_settings *settings = &trainer->config->train;
    struct v2v_adam adam = {.learning_rate = learning_rate(settings, step),
                            .beta1 = settings->beta1,
                            .beta2 = settings->beta2,
                            .epsilon = settings->epsilon};
    clip_gradients(trainer, grad_norm);
    v2v_adam_step(&adam, v2v_model_weights(trainer->model), trainer->m, trainer->v,
                  batch_gradients(trainer), v2v_model_fields(trainer->model)->total, step + 1);
    if (V2V_FAULT_POINT("train.weights") != V2V_OK) {
        v2v_model_weights(trainer->model)[0] *= 1.0f + FLT_EPSILON; /* what bad memory does */
    }
    v2v_model_weights_changed(trainer->model);
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
    if (result->finite) {
        step_weights(trainer, result->grad_norm, step);
    }
done:
    return rc;
}
