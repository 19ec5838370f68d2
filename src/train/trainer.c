#include "train/trainer.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { BRANCHES = 2 };

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
                                  .volume_scale = job->config->model.volume_scale};
    V2V_TRY(v2v_shifts_from_psf(&shifts, job->psf));
    V2V_TRY(v2v_model_create(&trainer->model, &spec, &shifts));
    const struct v2v_fields *fields = v2v_model_fields(trainer->model);
    measure_fields(trainer, fields);
    if (job->config->train.batch > 1 || trainer->grid.data_size > 1) {
        V2V_TRY(V2V_ALLOC(trainer->sum, "train.gradients", fields->total));
        V2V_TRY(V2V_ALLOC(trainer->scratch, "train.gradients", V2V_PAR_SCRATCH));
    }
    V2V_TRY(V2V_ALLOC(trainer->m, "adam.m", fields->total));
    V2V_TRY(V2V_ALLOC(trainer->v, "adam.v", fields->total));
done:
    v2v_shifts_fini(&shifts);
    return rc;
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
    trainer->voxels = job->psf->slices * height * width;
    V2V_TRY(V2V_ALLOC(trainer->views, "train.views", job->psf->views * height * width));
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(trainer->volume[b], "train.volumes", trainer->voxels));
        V2V_TRY(V2V_ALLOC(trainer->dvolume[b], "train.volumes", trainer->voxels));
    }
    V2V_TRY(v2v_model_plan(trainer->model, height, width, 1));
    V2V_TRY(v2v_loss_create(&trainer->loss, &setup));
done:
    return rc;
}

enum v2v_status v2v_trainer_create(struct v2v_trainer *trainer, const struct v2v_train_job *job,
                                   struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    int precision = V2V_PRECISION_F32;
    *trainer = (struct v2v_trainer){.config = job->config};
    V2V_TRY(v2v_grid_create(&trainer->grid, comm, (int)job->config->parallel.branches));
    v2v_log(V2V_LOG_INFO, "grid: %d data x %d branch ranks", trainer->grid.data_size,
            trainer->grid.branch_size);
    V2V_TRY(v2v_sampler_create(&trainer->sampler, job, comm));
    V2V_TRY(v2v_precision_agree(&precision, job->config->train.precision, comm));
    V2V_TRY(v2v_par_agree(comm, create_model(trainer, job, precision)));
    V2V_TRY(v2v_par_agree(comm, create_workspace(trainer, job)));
done:
    return rc;
}

void v2v_trainer_destroy(struct v2v_trainer *trainer)
{
    v2v_loss_destroy(&trainer->loss);
    v2v_model_destroy(&trainer->model);
    v2v_sampler_destroy(&trainer->sampler);
    float *memory[] = {trainer->m,         trainer->v,          trainer->sum,
                       trainer->scratch,   trainer->views,      trainer->volume[0],
                       trainer->volume[1], trainer->dvolume[0], trainer->dvolume[1]};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_grid_destroy(&trainer->grid);
    *trainer = (struct v2v_trainer){0};
}

/* Forward, losses and backward of one sample: adds to gradients and terms. Collective(pair). */
static void run_sample(struct v2v_trainer *trainer, double *terms)
{
    const struct v2v_grid *grid = &trainer->grid;
    double value[V2V_LOSS_TERMS];
    unsigned branches = held_branches(grid);
    v2v_model_forward(trainer->model, trainer->volume[0], trainer->volume[1], trainer->views);
    if (grid->branch_size == BRANCHES) {
        int own = grid->branch_rank;
        v2v_par_exchange_f32(grid->pair, trainer->volume[1 - own], trainer->volume[own],
                             trainer->voxels, 1 - own);
    }
    const float *const volume[BRANCHES] = {trainer->volume[0], trainer->volume[1]};
    v2v_loss_evaluate(trainer->loss, value, branches, trainer->dvolume, volume, trainer->views);
    v2v_model_backward(trainer->model, trainer->dvolume[0], trainer->dvolume[1]);
    for (int i = 0; i < V2V_LOSS_TERMS; i++) {
        terms[i] += value[i];
    }
}

static void scale_gradients(struct v2v_trainer *trainer, double factor)
{
    float *gradients = v2v_model_gradients(trainer->model);
    int64_t total = v2v_model_fields(trainer->model)->total;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < total; i++) {
        gradients[i] *= (float)factor;
    }
}

/* Add the gradients of this round's samples, the encoder's being the sum over both branches; the
 * order of the sum is that of the samples on any grid. Collective(world). */
static void collect_gradients(struct v2v_trainer *trainer)
{
    float *gradients = v2v_model_gradients(trainer->model);
    v2v_par_sum_f32(trainer->grid.pair, gradients, trainer->encoder_floats);
    if (trainer->sum != NULL) {
        v2v_par_add_ordered_f32(trainer->grid.column, trainer->sum, gradients,
                                v2v_model_fields(trainer->model)->total, trainer->scratch);
    }
}

/* The mean over the batch, known to all. Collective(world). */
static void finish_gradients(struct v2v_trainer *trainer)
{
    int64_t total = v2v_model_fields(trainer->model)->total;
    if (trainer->sum == NULL) {
        return;
    }
    v2v_par_share_f32(trainer->grid.column, trainer->sum, total);
    memcpy(v2v_model_gradients(trainer->model), trainer->sum, (size_t)total * sizeof(float));
    scale_gradients(trainer, 1.0 / (double)trainer->config->train.batch);
}

/* Sums over all ranks of what all must know: loss terms, squared gradient norms, votes. Each part
 * of the gradient is counted by one rank, the first that holds it. Collective(world). */
static void share_result(struct v2v_trainer *trainer, struct v2v_step_result *result, int vote)
{
    const struct v2v_grid *grid = &trainer->grid;
    const float *gradients = v2v_model_gradients(trainer->model);
    enum { NORMS = V2V_LOSS_TERMS, VOTES = NORMS + 1 + BRANCHES, POOLED };
    double pool[POOLED] = {0.0};
    for (int i = 0; i < V2V_LOSS_TERMS; i++) {
        pool[i] = result->terms[i] / (double)trainer->config->train.batch;
    }
    if (!grid->idle && grid->data_rank == 0) {
        if (v2v_comm_rank(grid->world) == 0) {
            pool[NORMS] = v2v_sum_of_squares(gradients, trainer->encoder_floats);
        }
        gradients += trainer->encoder_floats;
        for (int b = 0; b < BRANCHES; b++) {
            pool[NORMS + 1 + b] = v2v_sum_of_squares(gradients, trainer->unet_floats[b]);
            gradients += trainer->unet_floats[b];
        }
    }
    pool[VOTES] = vote ? 1.0 : 0.0;
    v2v_par_sum_f64(grid->world, pool, POOLED);
    memcpy(result->terms, pool, sizeof result->terms);
    double squares = pool[NORMS] + pool[NORMS + 1] + pool[NORMS + 2];
    result->grad_norm = sqrt(squares);
    result->votes = (int)pool[VOTES];
    /* Adam squares every element in float32: where the whole sum fits, each square does */
    result->finite = isfinite((float)squares) && isfinite(result->terms[V2V_LOSS_TOTAL]);
}

/* Scale a gradient that is longer than train.clip_norm down to it. */
static void clip_gradients(struct v2v_trainer *trainer, double norm)
{
    double most = trainer->config->train.clip_norm;
    if (most <= 0.0 || norm <= most) {
        return;
    }
    scale_gradients(trainer, most / norm);
}

static double learning_rate(const struct v2v_train_settings *settings, int64_t step)
{
    int decayed = settings->decay_at > 0 && step >= settings->decay_at;
    return settings->learning_rate * (decayed ? settings->decay : 1.0);
}

enum v2v_status v2v_trainer_step(struct v2v_trainer *trainer, struct v2v_step_result *result,
                                 int64_t step, int vote)
{
    enum v2v_status rc = V2V_OK, drawn = V2V_OK;
    const struct v2v_grid *grid = &trainer->grid;
    const struct v2v_train_settings *settings = &trainer->config->train;
    const struct v2v_fields *fields = v2v_model_fields(trainer->model);
    *result = (struct v2v_step_result){0};
    if (trainer->sum != NULL) {
        memset(trainer->sum, 0, (size_t)fields->total * sizeof(float));
    }
    int64_t rounds = (settings->batch + grid->data_size - 1) / grid->data_size;
    for (int64_t round = 0; round < rounds; round++) {
        int64_t sample = round * grid->data_size + grid->data_rank;
        int mine = sample < settings->batch && !grid->idle;
        if (mine) {
            drawn = v2v_sampler_draw(trainer->sampler, trainer->views, step, sample);
        }
        V2V_TRY(v2v_par_agree(grid->world, drawn));
        memset(v2v_model_gradients(trainer->model), 0, (size_t)fields->total * sizeof(float));
        if (mine) {
            run_sample(trainer, result->terms);
        }
        collect_gradients(trainer);
    }
    finish_gradients(trainer);
    share_result(trainer, result, vote);
    if (result->finite) {
        struct v2v_adam adam = {.learning_rate = learning_rate(settings, step),
                                .beta1 = settings->beta1,
                                .beta2 = settings->beta2,
                                .epsilon = settings->epsilon};
        clip_gradients(trainer, result->grad_norm);
        v2v_adam_step(&adam, v2v_model_weights(trainer->model), trainer->m, trainer->v,
                      v2v_model_gradients(trainer->model), fields->total, step + 1);
        v2v_model_weights_changed(trainer->model);
    }
done:
    return rc;
}
