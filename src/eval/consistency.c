#include "v2v3d/eval/consistency.h"

#include "eval/fourier.h"
#include "eval/uncertainty.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/as_recorded.h"
#include "v2v3d/eval/quality.h"
#include "v2v3d/eval/settle.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/method/left_out.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"

#include <math.h>
#include <string.h>

/* Volumes of a frame: of the halves, and for the uncertainty of all views. */
enum { HALVES = 2, ALL = HALVES, VOLUMES };

/* Everything of a run. */
struct judge {
    struct v2v_consistency *out;
    const struct v2v_consistency_job *job;
    const struct v2v_estimator_ops *ops;
    struct v2v_config config;
    struct v2v_problem problem;
    struct v2v_grid grid;
    struct v2v_agreement *agreement;
    int64_t folds;
    struct v2v_left_out *part[VOLUMES]; /* a fold first, then both halves and all */
    struct v2v_fourier *fourier;
    struct v2v_match *match; /* [frames] of this rank's shard, folds so far */
    struct v2v_fusion *fusion;
    float *views;           /* [v,y,x] of the frame at hand, as the method takes them .. */
    float *recorded;        /* .. and as recorded; NULL: the same */
    float *predicted;       /* [most of a fold,y,x] */
    float *scratch;         /* [y,x] */
    float *volume[VOLUMES]; /* [slices of this rank,y,x] */
    struct v2v_ring *rings;
};

int64_t v2v_consistency_frame(int64_t i, int64_t n, int64_t frames)
{
    return (2 * i + 1) * frames / (2 * n);
}

static enum v2v_status allocate(struct v2v_consistency *out, int64_t frames, int64_t views,
                                int64_t slices)
{
    enum v2v_status rc = V2V_OK;
    const int64_t each = v2v_mem_product(frames, views, 1),
                  depth = v2v_mem_product(frames, slices, 1);
    double **const of_frame[] = {&out->heldout, &out->heldout_sigmas, &out->disagreement,
                                 &out->resolution};
    double **const of_view[] = {&out->heldout_views, &out->heldout_views_sigmas};
    enum {
        OF_FRAME = sizeof of_frame / sizeof *of_frame,
        OF_VIEW = sizeof of_view / sizeof *of_view
    };
    out->frames = frames;
    out->views = views;
    out->slices = slices;
    V2V_TRY(V2V_ALLOC(out->frame, "eval.figures", frames));
    out->doubles = OF_FRAME * frames + (OF_VIEW + 2) * each + depth;
    V2V_TRY(V2V_ALLOC(out->memory, "eval.figures", out->doubles));
    double *next = out->memory;
    for (int i = 0; i < OF_FRAME; i++, next += frames) {
        *of_frame[i] = next;
    }
    for (int i = 0; i < OF_VIEW; i++, next += each) {
        *of_view[i] = next;
    }
    out->shift = next;
    out->disagreement_slices = next + 2 * each;
done:
    return rc;
}

void v2v_consistency_fini(struct v2v_consistency *out)
{
    v2v_mem_free(out->frame);
    v2v_mem_free(out->memory);
    *out = (struct v2v_consistency){0};
}

/** Local: the views of frame i of those judged. */
static enum v2v_status load(struct judge *self, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    const int64_t t = self->out->frame[i];
    V2V_TRY(
        v2v_fusion_read(self->fusion, self->views, self->job->recording, self->job->scaling, t));
    if (self->recorded != NULL) {
        V2V_TRY(v2v_as_recorded_read(self->recorded, NULL, NULL, self->job->recording,
                                     self->job->scaling, t));
    }
done:
    return rc;
}

/** Collective(shard). */
static enum v2v_status run(struct judge *self, int k)
{
    return v2v_left_out_run(self->part[k], self->volume[k], self->views,
                            v2v_fusion_averaging(self->fusion));
}

/** Local: how far a view lies from its prediction, which stands for its blind samples. */
static void find_shift(struct judge *self, double shift[2], const float *recorded,
                       const float *predicted)
{
    const int64_t pixels = self->problem.height * self->problem.width;
    for (int64_t i = 0; i < pixels; i++) {
        self->scratch[i] = recorded[i] != V2V_BLIND ? recorded[i] : predicted[i];
    }
    v2v_fourier_shift(self->fourier, shift, self->scratch, predicted);
}

/** Local: how the views left out of frame i were predicted. */
static void judge_views(struct judge *self, int64_t i)
{
    struct v2v_consistency *out = self->out;
    const struct v2v_left_out *fold = self->part[0];
    const int64_t height = self->problem.height, width = self->problem.width;
    for (int64_t k = fold->used; k < fold->views; k++) {
        const int64_t v = fold->view[k], at = i * out->views + v;
        const float *views = self->recorded != NULL ? self->recorded : self->views;
        const float *recorded = views + v * height * width;
        float *predicted = self->predicted + (k - fold->used) * height * width;
        v2v_as_recorded_predict(predicted, self->scratch, self->job->recording, v, 1);
        v2v_saturated_cap(predicted, recorded, 1, height * width);
        const struct v2v_match match =
            v2v_match_of(self->scratch, recorded, predicted, height, width);
        out->heldout_views[at] = v2v_match_residual(&match, 1.0);
        out->heldout_views_sigmas[at] = v2v_match_sigmas(&match, 1.0);
        find_shift(self, out->shift + 2 * at, recorded, predicted);
        v2v_match_add(&self->match[i], &match);
    }
}

/** Collective(shard): frame i by the fold under way. */
static enum v2v_status try_fold(struct judge *self, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(run(self, 0));
    v2v_left_out_predict(self->part[0], self->predicted, self->volume[0]);
    judge_views(self, i);
    self->out->heldout[i] = v2v_match_residual(&self->match[i], 1.0);
    self->out->heldout_sigmas[i] = v2v_match_sigmas(&self->match[i], 1.0);
done:
    return rc;
}

/** Collective(shard): how far the halves of frame i agree. */
static void compare(struct judge *self, int64_t i)
{
    struct v2v_consistency *out = self->out;
    const struct v2v_comm *shard = self->grid.shard;
    const struct v2v_part own = self->part[0]->estimator->slices;
    const int64_t pixels = self->problem.height * self->problem.width;
    const int64_t rings = v2v_fourier_rings(self->fourier);
    double *of_slice = out->disagreement_slices + i * out->slices, all[2] = {0.0, 0.0};
    memset(self->rings, 0, (size_t)rings * sizeof *self->rings);
    for (int64_t z = 0; z < own.count; z++) {
        const float *a = self->volume[0] + z * pixels, *b = self->volume[1] + z * pixels;
        double differences = 0.0, sums = 0.0;
        for (int64_t p = 0; p < pixels; p++) {
            const double difference = (double)a[p] - (double)b[p],
                         sum = (double)a[p] + (double)b[p];
            differences += difference * difference;
            sums += sum * sum;
        }
        of_slice[own.first + z] = sqrt(differences / sums);
        all[0] += differences;
        all[1] += sums;
        v2v_fourier_correlate(self->fourier, self->rings, a, b);
    }
    v2v_par_sum_f64(shard, all, 2);
    v2v_par_sum_f64(shard, of_slice, out->slices);
    v2v_par_sum_f64(shard, &self->rings->product,
                    rings * (int64_t)(sizeof *self->rings / sizeof(double)));
    out->disagreement[i] = sqrt(all[0] / all[1]);
    out->resolution[i] = v2v_fourier_resolution(self->rings, rings);
}

/** Collective(shard): the volume of all views and its uncertainty, for the file. The status is this
 *  rank's. */
static enum v2v_status put(struct judge *self, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume_writer *writer = self->job->writer;
    const struct v2v_part own = self->part[ALL]->estimator->slices;
    const int64_t t = self->out->frame[i];
    float *map = self->volume[0];
    V2V_TRY(run(self, ALL));
    v2v_uncertainty_of(map, self->volume[1], self->volume[ALL], self->scratch, own.count,
                       self->problem.height, self->problem.width);
    rc = v2v_volume_put(writer, V2V_VOLUME_MEAN, self->volume[ALL], t, own.first, own.count);
    if (rc == V2V_OK) {
        rc = v2v_volume_put(writer, V2V_VOLUME_UNCERTAINTY, map, t, own.first, own.count);
    }
    V2V_TRY(v2v_par_agree(self->grid.shard, rc));
    V2V_TRY(v2v_volume_mark_done(writer, t, self->grid.shard));
done:
    return rc;
}

/** Collective(shard): frame i by both halves. */
static enum v2v_status try_halves(struct judge *self, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    for (int h = 0; h < HALVES; h++) {
        V2V_TRY(run(self, h));
    }
    compare(self, i);
    if (self->job->writer != NULL) {
        V2V_TRY(put(self, i));
    }
done:
    return rc;
}

/** Volumes that a step computes. */
static int volumes_of(const struct judge *self, int64_t step)
{
    return step < self->folds ? 1 : self->job->writer != NULL ? VOLUMES : HALVES;
}

/** What volume k of a step does not see. */
static struct v2v_left_out_views without(const struct judge *self, int64_t step, int k)
{
    const int64_t views = self->out->views;
    return step < self->folds ? v2v_left_out_fold(views, step)
           : k < HALVES       ? (struct v2v_left_out_views){HALVES - 1 - k, HALVES, views}
                              : (struct v2v_left_out_views){0};
}

/** Collective(shard): estimators of a fold, or after the folds of both halves. */
static enum v2v_status begin(struct judge *self, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    for (int k = 0; k < volumes_of(self, step); k++) {
        v2v_watchdog_beat("estimators of some views");
        V2V_TRY(v2v_left_out_create(&self->part[k], self->ops, &self->problem,
                                    without(self, step, k), step < self->folds, self->grid.shard));
    }
done:
    return rc;
}

static void end(struct judge *self)
{
    for (int k = 0; k < VOLUMES; k++) {
        v2v_left_out_destroy(&self->part[k]);
    }
}

/** Collective(shard): frame i, by what begin made. */
static enum v2v_status judge_frame(struct judge *self, int64_t step, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_par_agree(self->grid.shard, load(self, i)));
    V2V_TRY(step < self->folds ? try_fold(self, i) : try_halves(self, i));
done:
    return rc;
}

/** Collective(world): every frame by every fold and by the halves, each rank as fast as it can. */
static enum v2v_status judge_all(struct judge *self)
{
    enum v2v_status rc = V2V_OK, mine = V2V_OK;
    const struct v2v_grid *grid = &self->grid;
    const int64_t frames = self->out->frames;
    struct v2v_progress progress;
    v2v_progress_begin(&progress, "views left out", 0, self->folds + 1);
    V2V_TRY(v2v_agreement_meet(self->agreement));
    for (int64_t step = 0; step <= self->folds; step++) {
        if (mine == V2V_OK && !grid->idle) {
            mine = begin(self, step);
        }
        for (int64_t i = grid->data_rank; mine == V2V_OK && !grid->idle && i < frames;
             i += grid->data_size) {
            mine = judge_frame(self, step, i);
        }
        end(self);
        V2V_TRY(v2v_agreement_tell(self->agreement, mine));
        v2v_progress_step(&progress, step + 1, NULL);
    }
    V2V_TRY(v2v_agreement_end(self->agreement));
done:
    v2v_progress_end(&progress);
    end(self);
    return rc;
}

/* Does the method take other views than were recorded: means of frames, dark blind samples, or
 * without shading and distortion? */
static int is_another(const struct judge *self)
{
    const struct v2v_calibration *calibration = v2v_recording_calibration(self->job->recording);
    return self->config.recon.neighbours > 0 || !self->ops->leaves_blind ||
           (calibration != NULL && v2v_calibration_has_fields(calibration));
}

/** What is held already, and what averaging takes beside the estimators: on every rank the fusion,
 *  the views as recorded, and the frames that those used are means of. */
static int64_t bytes_beside(const struct judge *self)
{
    enum { MAPS = 1 + VOLUMES };
    const struct v2v_problem *problem = &self->problem;
    const int64_t views = problem->psf->views, neighbours = self->config.recon.neighbours;
    const int64_t floats =
        v2v_fusion_floats(neighbours, views, problem->height, problem->width) +
        (is_another(self) ? v2v_mem_product(MAPS * views, problem->height, problem->width) : 0);
    return v2v_mem_bytes(floats, (int64_t)v2v_mem_held());
}

/** Collective(world). */
static enum v2v_status lay_out(struct judge *self, struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_work work;
    V2V_TRY(v2v_par_agree(world, self->ops->describe_work(&work, &self->problem)));
    work.items = self->out->frames;
    if (self->job->writer != NULL) { /* the halves' and that of all views */
        work.bytes = 2 * v2v_smaller(work.bytes, INT64_MAX / 4);
    }
    V2V_TRY(v2v_estimator_lay_out(&self->grid, &work, 1, bytes_beside(self), &self->config, world));
    V2V_TRY(v2v_par_agree(world, v2v_agreement_create(&self->agreement, world)));
done:
    return rc;
}

/** Local: what frames need beside the estimators. */
static enum v2v_status take_memory(struct judge *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_problem *problem = &self->problem;
    const int64_t height = problem->height, width = problem->width;
    const struct v2v_part own =
        v2v_par_part(problem->psf->slices, self->grid.shard_size, self->grid.shard_rank);
    V2V_TRY(V2V_ALLOC(self->match, "eval.figures", self->out->frames));
    V2V_TRY(V2V_ALLOC(self->predicted, "eval.views",
                      v2v_mem_product(v2v_parts(problem->psf->views, self->folds), height, width)));
    V2V_TRY(V2V_ALLOC(self->scratch, "eval.views", v2v_mem_product(height, width, 1)));
    for (int k = 0; k < volumes_of(self, self->folds); k++) {
        V2V_TRY(
            V2V_ALLOC(self->volume[k], "eval.volumes", v2v_mem_product(own.count, height, width)));
    }
    V2V_TRY(v2v_fourier_create(&self->fourier, height, width));
    V2V_TRY(V2V_ALLOC(self->rings, "eval.figures", v2v_fourier_rings(self->fourier)));
done:
    return rc;
}

/** Local: the frames to judge. */
static enum v2v_status list_frames(struct judge *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_consistency *out = self->out;
    const struct v2v_recording_info *info = v2v_recording_info(self->job->recording);
    const int64_t views = self->problem.psf->views;
    const int64_t frames = v2v_smaller(self->job->frames, info->frames);
    V2V_TRY(allocate(out, frames, views, self->problem.psf->slices));
    for (int64_t i = 0; i < frames; i++) {
        out->frame[i] = v2v_consistency_frame(i, frames, info->frames);
    }
    const int64_t samples = v2v_mem_product(views, info->height, info->width);
    const int64_t neighbours = self->config.recon.neighbours;
    V2V_TRY(V2V_ALLOC(self->views, "eval.views", samples));
    if (is_another(self)) {
        V2V_TRY(V2V_ALLOC(self->recorded, "eval.views", samples));
    }
    V2V_TRY(v2v_fusion_create(&self->fusion, neighbours, views, info->height, info->width,
                              self->ops->leaves_blind));
done:
    return rc;
}

/** Collective(world): what each rank found, known to all. One rank of a shard speaks for it. */
static void share(struct judge *self, const struct v2v_comm *world)
{
    struct v2v_consistency *out = self->out;
    if (self->grid.idle || self->grid.shard_rank > 0) {
        memset(out->memory, 0, (size_t)out->doubles * sizeof *out->memory);
    }
    v2v_par_sum_f64(world, out->memory, out->doubles);
}

static void fini(struct judge *self)
{
    v2v_fourier_destroy(&self->fourier);
    v2v_agreement_destroy(&self->agreement);
    for (int k = 0; k < VOLUMES; k++) {
        v2v_mem_free(self->volume[k]);
    }
    v2v_mem_free(self->rings);
    v2v_mem_free(self->match);
    v2v_mem_free(self->scratch);
    v2v_mem_free(self->predicted);
    v2v_mem_free(self->views);
    v2v_mem_free(self->recorded);
    v2v_fusion_destroy(&self->fusion);
    v2v_grid_destroy(&self->grid);
}

/** Local. */
static enum v2v_status find_estimator(struct judge *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *network = NULL;
    if (self->job->weights == NULL) {
        return v2v_estimator_find(&self->ops, "tv");
    }
    V2V_TRY(v2v_network_find(&network, self->config.model.method));
    self->ops = v2v_estimator_of_network(network);
done:
    return rc;
}

enum v2v_status v2v_consistency_of(struct v2v_consistency *out,
                                   const struct v2v_consistency_job *job, struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(job->recording);
    struct judge self = {.out = out, .job = job, .config = *job->config};
    *out = (struct v2v_consistency){0};
    if (job->psf->views < 2 || job->frames < 1) {
        return V2V_OK;
    }
    self.config.deconv.iterations = 0;
    self.config.deconv.stop = V2V_STOP_FIXED;
    self.problem = (struct v2v_problem){.config = &self.config,
                                        .psf = job->psf,
                                        .weights = job->weights,
                                        .height = info->height,
                                        .width = info->width,
                                        .precision = V2V_PRECISION_F32};
    self.folds = v2v_left_out_folds(job->psf->views);
    V2V_TRY(v2v_par_agree(world, find_estimator(&self)));
    V2V_TRY(v2v_settle_by_frame(&self.config, self.ops, &self.problem, job->recording, job->scaling,
                                world));
    V2V_TRY(v2v_par_agree(world, list_frames(&self)));
    V2V_TRY(lay_out(&self, world));
    V2V_TRY(v2v_par_agree(world, self.grid.idle ? V2V_OK : take_memory(&self)));
    V2V_TRY(judge_all(&self));
    share(&self, world);
done:
    fini(&self);
    return rc;
}
