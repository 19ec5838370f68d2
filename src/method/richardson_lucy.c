#include "method/richardson_lucy.h"

#include "v2v3d/base/clones.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <limits.h>
#include <math.h>
#include <string.h>

/* A voxel that contributes less than this fraction of a view's total PSF to that view is invisible
 * in it and keeps its value; one that no view sees is 0. Near the border voxels of slices out of
 * focus contribute little, which counts all the same (2psam: 6e-6 at least; of 39 slices, an even
 * share is 2.6e-2). Transforms round by some 1e-9 of the largest ratio: a spot 3000 times as bright
 * as the mean leaves the outermost voxels 2e-4 of round-off. Where the denominator is a
 * transform's, too, the quotient is one of round-off there: of PSFs that end steeply such voxels
 * took 1e32 within ten iterations, and the volume with them. */
static double voxel_floor_of(const struct v2v_richardson_lucy_variant *variant)
{
    return variant->has_denominator ? 1e-4 : 1e-6;
}

/* A pixel is unlit that would see less than this fraction of a volume of ones: near the border of a
 * tilted view all of its voxels may lie beyond the frame. Its ratio is recorded light over round-
 * off, up to 1 / V2V_PROJECTION_FLOOR; the adjoint takes it nowhere, but the transforms' round-off
 * of a number so large spreads over the whole volume (1e-3 of it, measured). */
static const double pixel_floor = 1e-4;

/* What only the creation needs. */
struct scratch {
    double *light;  /* [view_rows,x] */
    double *table;  /* [ky 0..K, kx 0..K] */
    double *of_row; /* [v,y]: a row's light */
};

/** Project a volume of ones: its mean, and the pixels that stay dark. Collective(comm). The mean's
 *  terms are added in one order for any number of ranks. */
static void project_ones(struct v2v_richardson_lucy *self, const struct v2v_psf_file *psf,
                         struct scratch *scratch)
{
    double sum = 0;
    int64_t pixels = v2v_richardson_lucy_pixels(self), all_rows = self->views * self->height;
    for (int64_t v = 0; v < self->views; v++) {
        double *of_row = scratch->of_row + v * self->height + self->share.view_rows.first;
        double floor = pixel_floor * self->sensitivity.total[v];
        v2v_sensitivity_light(&self->sensitivity, scratch->light, psf, v, self->share.view_rows,
                              scratch->table);
        for (int64_t i = 0; i < pixels; i++) {
            of_row[i / self->width] += scratch->light[i];
            self->unlit[v * pixels + i] = !(scratch->light[i] > floor);
        }
    }
    v2v_par_sum_f64(self->comm, scratch->of_row, all_rows);
    for (int64_t i = 0; i < all_rows; i++) {
        sum += scratch->of_row[i];
    }
    self->constant_view = sum / (double)(all_rows * self->width);
}

/** Local: what the run needs beside the projector, and what only its creation needs. */
static enum v2v_status take_memory(struct v2v_richardson_lucy *self, struct scratch *scratch,
                                   const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share *share = &self->share;
    int64_t voxels = v2v_mem_product(share->slices.count, share->rows.count, self->width);
    int64_t pixels = v2v_mem_product(share->view_rows.count, self->width, 1);
    V2V_TRY(
        v2v_sensitivity_init(&self->sensitivity, psf, share->slices, self->height, self->width));
    const int64_t at_once = self->variant->at_once ? self->views : 1;
    V2V_TRY(V2V_ALLOC(self->ratio, "rld.ratio", v2v_mem_product(at_once, pixels, 1)));
    if (self->variant->background > 0) {
        V2V_TRY(V2V_ALLOC(self->noise, "rld.noise",
                          v2v_mem_product(self->views, self->height, self->width)));
    }
    V2V_TRY(V2V_ALLOC(self->numerator, "rld.correction", voxels));
    if (self->variant->has_denominator) {
        V2V_TRY(V2V_ALLOC(self->denominator, "rld.correction", voxels));
    }
    V2V_TRY(V2V_ALLOC(self->seen, "rld.seen", share->slices.count * self->width));
    V2V_TRY(V2V_ALLOC(self->unlit, "rld.unlit", v2v_mem_product(self->views, pixels, 1)));
    if (share->rows.count < self->height ||
        share->slices.count != v2v_projector_slices(self->projector).count) {
        V2V_TRY(V2V_ALLOC(self->volume, "rld.volume", voxels));
    }
    V2V_TRY(V2V_ALLOC(scratch->light, "rld.light", pixels));
    V2V_TRY(V2V_ALLOC(scratch->table, "rld.light",
                      v2v_mem_product(psf->height + 1, psf->width + 1, 1)));
    V2V_TRY(V2V_ALLOC(scratch->of_row, "rld.light", v2v_mem_product(self->views, self->height, 1)));
done:
    return rc;
}

enum v2v_status v2v_richardson_lucy_describe_work(struct v2v_grid_work *work,
                                                  const struct v2v_problem *problem)
{
    enum { VOLUMES = 5, VIEWS = 4 }; /* those of the caller with them */
    const struct v2v_psf_file *psf = problem->psf;
    const int64_t height = problem->height, width = problem->width;
    const int64_t images =
        v2v_mem_product(VOLUMES * psf->slices + VIEWS * psf->views, height, width);
    const int64_t tables = /* of the sensitivity, in double precision */
        v2v_mem_product(2 * psf->views * psf->slices, psf->height + 1, psf->width + 1);
    *work = (struct v2v_grid_work){
        .height = height,
        .unit = 1,
        .most_shards = INT_MAX,
        .most_branches = 1,
        .bytes = v2v_mem_bytes(
            tables,
            v2v_mem_bytes(images, v2v_projector_bytes(psf, height, width, V2V_SPLIT_SLICES, 1)))};
    return v2v_stop_rule_check(problem);
}

static int has_negative_light(const struct v2v_psf_file *psf)
{
    const int64_t samples = psf->views * psf->slices * psf->height * psf->width;
    int64_t i = 0;
    while (i < samples && psf->data[i] >= 0.0f) {
        i++;
    }
    return i < samples;
}

/** One view at a time an iteration's factors are ratios of that view's light: PSFs below zero, as a
 *  calibration makes them, would have them pass through infinity. Collective(shard), agreed. */
static enum v2v_status prepare(struct v2v_richardson_lucy *self, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct scratch scratch = {0};
    struct v2v_psf_file positive = {0};
    const struct v2v_psf_file *psf = problem->psf;
    enum v2v_split split;
    if (!self->variant->at_once && has_negative_light(psf)) {
        rc = v2v_psf_positive(&positive, psf);
        psf = &positive;
    }
    V2V_TRY(v2v_par_agree(self->comm, rc)); /* other processors may round to another sign */
    V2V_TRY(v2v_projector_choose_split(&split, problem->config, psf, self->height, self->width, 1,
                                       self->comm));
    V2V_TRY(
        v2v_projector_create(&self->projector, psf, self->height, self->width, split, self->comm));
    self->share = v2v_projector_share(self->projector);
    rc = take_memory(self, &scratch, psf);
    if (rc == V2V_OK) {
        rc = v2v_stop_rule_init(&self->stop, problem);
    }
    V2V_TRY(v2v_par_agree(self->comm, rc));
    project_ones(self, psf, &scratch);
done:
    v2v_psf_file_fini(&positive);
    v2v_mem_free(scratch.of_row);
    v2v_mem_free(scratch.table);
    v2v_mem_free(scratch.light);
    return rc;
}

enum v2v_status v2v_richardson_lucy_create(struct v2v_estimator *estimator,
                                           const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_richardson_lucy *self = NULL;
    const struct v2v_richardson_lucy_variant *variant = estimator->ops->variant;
    const int64_t iterations = problem->config->deconv.iterations;
    rc = V2V_ALLOC(self, "rld", 1);
    estimator->self = self;
    V2V_TRY(v2v_par_agree(estimator->shard, rc));
    *self = (struct v2v_richardson_lucy){.variant = variant,
                                         .estimator = estimator,
                                         .comm = estimator->shard,
                                         .views = problem->psf->views,
                                         .height = problem->height,
                                         .width = problem->width,
                                         .iterations =
                                             iterations > 0 ? iterations : variant->iterations,
                                         .weight = problem->config->deconv.weight};
    V2V_TRY(prepare(self, problem));
    estimator->slices = v2v_projector_slices(self->projector);
done:
    return rc;
}

void v2v_richardson_lucy_destroy(struct v2v_estimator *estimator)
{
    struct v2v_richardson_lucy *self = estimator->self;
    if (self != NULL) {
        v2v_projector_destroy(&self->projector);
        v2v_sensitivity_fini(&self->sensitivity);
        v2v_stop_rule_fini(&self->stop);
        v2v_mem_free(self->volume);
        v2v_mem_free(self->ratio);
        v2v_mem_free(self->noise);
        v2v_mem_free(self->numerator);
        v2v_mem_free(self->denominator);
        v2v_mem_free(self->seen);
        v2v_mem_free(self->unlit);
        v2v_mem_free(self);
    }
}

/** Local: the mean of the views where they are positive, 0 elsewhere; and in units of it what is
 *  added to them. */
static enum v2v_status measure(double *mean, struct v2v_richardson_lucy *self, const float *views)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_estimator_mean(mean, self->estimator, views, self->views));
    self->background = 0;
    if (self->noise != NULL && *mean > V2V_ESTIMATOR_DARK) {
        const double sigma =
            v2v_noise_of_images(self->noise, views, self->views, self->height, self->width);
        self->background = (float)(self->variant->background * sigma / *mean);
    }
done:
    return rc;
}

/** Of a method of all views at once: its denominator, the sum of A_v^T 1 over the views; 0 where
 *  they see too little. Local. */
static void add_sensitivities(struct v2v_richardson_lucy *self, const struct v2v_view_list *list)
{
    double total = 0;
    for (int64_t i = 0; i < list->count; i++) {
        total += self->sensitivity.total[list->view[i]];
    }
    const double floor = voxel_floor_of(self->variant) * total / (double)list->count;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->share.slices.count; z++) {
        double *seen = self->seen + z * self->width;
        for (int64_t y = 0; y < self->share.rows.count; y++) {
            float *below = self->denominator + (z * self->share.rows.count + y) * self->width;
            memset(below, 0, (size_t)self->width * sizeof *below);
            for (int64_t i = 0; i < list->count; i++) {
                v2v_sensitivity_row(&self->sensitivity, seen, list->view[i], z,
                                    self->share.rows.first + y);
                for (int64_t x = 0; x < self->width; x++) {
                    below[x] += (float)seen[x];
                }
            }
            for (int64_t x = 0; x < self->width; x++) {
                below[x] = below[x] > floor ? below[x] : 0;
            }
        }
    }
}

/** Constant start whose projections have the method's mean; 0 where no view sees the voxel. */
static void start(const struct v2v_richardson_lucy *self, float *volume)
{
    const double level = self->variant->start;
    float value = self->constant_view > 0 ? (float)(level / self->constant_view) : 0;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->share.slices.count; z++) {
        double *seen = self->seen + z * self->width;
        for (int64_t y = 0; y < self->share.rows.count; y++) {
            float *row = volume + (z * self->share.rows.count + y) * self->width;
            for (int64_t x = 0; x < self->width; x++) {
                row[x] = 0;
            }
            for (int64_t v = 0; v < self->views; v++) {
                const double floor = voxel_floor_of(self->variant) * self->sensitivity.total[v];
                v2v_sensitivity_row(&self->sensitivity, seen, v, z, self->share.rows.first + y);
                for (int64_t x = 0; x < self->width; x++) {
                    row[x] = seen[x] > floor ? value : row[x];
                }
            }
        }
    }
}

/** x <- x * numerator / denominator, 0 where that is 0. */
static void multiply_at_once(const struct v2v_richardson_lucy *self, float *volume)
{
    const int64_t voxels = self->share.slices.count * self->share.rows.count * self->width;
    const float *above = self->numerator, *below = self->denominator;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        const float factor = below[i] > 0 ? above[i] / below[i] : 0;
        volume[i] = factor < 0 ? 0 : volume[i] * factor; /* NaN stays */
    }
}

/** x <- max(x * ((1-w) + w * numerator / denominator), 0) where the view sees the voxel.
 *  @param own the denominator; NULL: what the view sees */
V2V_SIMD_CLONES
static void multiply_row(float *restrict volume, const float *numerator, const float *own,
                         const double *seen, double floor, double w, int64_t width)
{
    const double least = own != NULL ? (double)V2V_PROJECTION_FLOOR : 1.0;
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        const double lowest = least * seen[x];
        const double below = own != NULL && own[x] > lowest ? own[x] : lowest;
        const double factor = seen[x] > floor ? (1.0 - w) + w * (double)numerator[x] / below : 1.0;
        volume[x] = factor < 0.0 ? 0.0f : (float)(volume[x] * factor); /* NaN stays */
    }
}

static void multiply(const struct v2v_richardson_lucy *self, float *volume, int64_t v)
{
    const double floor = voxel_floor_of(self->variant) * self->sensitivity.total[v];
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->share.slices.count; z++) {
        double *seen = self->seen + z * self->width;
        for (int64_t y = 0; y < self->share.rows.count; y++) {
            const int64_t row = (z * self->share.rows.count + y) * self->width;
            const float *own = self->denominator != NULL ? self->denominator + row : NULL;
            v2v_sensitivity_row(&self->sensitivity, seen, v, z, self->share.rows.first + y);
            multiply_row(volume + row, self->numerator + row, own, seen, floor, self->weight,
                         self->width);
        }
    }
}

static enum v2v_status look(const struct v2v_richardson_lucy *self, const float *volume,
                            int64_t iteration)
{
    return v2v_estimator_check_step(self->estimator, V2V_FAULT_POINT("rld.iteration"), volume,
                                    &self->share, "iteration", iteration);
}

static enum v2v_status iterate(struct v2v_richardson_lucy *self, float *volume, const float *views,
                               const struct v2v_view_list *list, double mean, int64_t iteration)
{
    const int at_once = self->variant->at_once;
    const float *rows = views + self->share.view_rows.first * self->width;
    const int64_t step = at_once ? list->count : 1;
    for (int64_t i = 0; i < list->count; i += step) {
        const struct v2v_view_list part = {list->view + i, step};
        v2v_watchdog_beat("views of the deconvolution");
        v2v_projector_forward(self->projector, self->ratio, volume, part.view, step, 1.0f);
        self->variant->correct(self, rows, &part, (float)(1 / mean));
        if (at_once) {
            multiply_at_once(self, volume);
        } else {
            multiply(self, volume, part.view[0]);
        }
    }
    return v2v_par_agree(self->comm, look(self, volume, iteration));
}

static void to_slices(struct v2v_estimator *estimator, float *slices, const float *volume)
{
    struct v2v_richardson_lucy *self = estimator->self;
    v2v_projector_to_slices(self->projector, slices, volume);
}

/** Collective(shard): from the start until the monitor (NULL: none) has seen enough. */
static enum v2v_status iterate_on(struct v2v_estimator *estimator, float *volume,
                                  const float *views, const struct v2v_view_list *list, double mean,
                                  int64_t iterations, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_richardson_lucy *self = estimator->self;
    const struct v2v_iterate now = {estimator, to_slices, volume, mean};
    int enough = 0;
    start(self, volume);
    if (self->variant->at_once) {
        add_sensitivities(self, list);
    }
    for (int64_t i = 1; i <= iterations && !enough; i++) {
        V2V_TRY(iterate(self, volume, views, list, mean, i));
        enough = monitor != NULL && monitor->enough(monitor->context, i, &now);
    }
done:
    return rc;
}

enum v2v_status v2v_richardson_lucy_run(struct v2v_estimator *estimator, float *const *volume,
                                        const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_richardson_lucy *self = estimator->self;
    const struct v2v_stop_rule *stop = &self->stop;
    float *own = self->volume != NULL ? self->volume : volume[0];
    double mean = 0;
    V2V_TRY(v2v_par_agree(self->comm, measure(&mean, self, views)));
    v2v_par_max_f64(self->comm, &mean, 1); /* the ranks take the same branch whatever they hold */
    int64_t needed = mean > V2V_ESTIMATOR_DARK ? self->iterations : 0;
    if (stop->rule == V2V_STOP_HELDOUT && needed > 0) {
        struct v2v_judge judge = {.method = self, .views = views, .mean = mean};
        const struct v2v_monitor rule = {v2v_judge_enough, &judge};
        V2V_TRY(iterate_on(estimator, own, views, &stop->used, mean, needed, &rule));
        needed = judge.has_ended ? judge.best : needed;
    }
    V2V_TRY(iterate_on(estimator, own, views, &stop->all, mean, needed, monitor));
    const int64_t count = self->share.slices.count * self->share.rows.count * self->width;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        own[i] = (float)(own[i] * mean);
    }
    V2V_TRY(v2v_par_agree(self->comm, look(self, own, needed)));
    v2v_projector_to_slices(self->projector, volume[0], own);
done:
    return rc;
}

/* Rows of all views come side by side, and go to their places from the last view on. */
void v2v_richardson_lucy_project(struct v2v_estimator *estimator, float *views, const float *volume)
{
    struct v2v_richardson_lucy *self = estimator->self;
    const struct v2v_part rows = self->share.view_rows;
    const int64_t pixels = self->height * self->width, own = rows.count * self->width;
    v2v_projector_from_slices(self->projector, self->numerator, volume);
    v2v_projector_forward(self->projector, views, self->numerator, NULL, self->views, 1.0f);
    for (int64_t v = self->views - 1; v >= 0 && own < pixels; v--) {
        float *view = views + v * pixels, *to = view + rows.first * self->width;
        memmove(to, views + v * own, (size_t)own * sizeof *views);
        memset(view, 0, (size_t)(to - view) * sizeof *views);
        memset(to + own, 0, (size_t)(view + pixels - (to + own)) * sizeof *views);
    }
}
