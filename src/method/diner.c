#include "method/diner.h"

#include "method/implicit_field.h"
#include "method/sensitivity.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/nn/adam.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>
#include <string.h>

/* DINER (S. Xie, H. Zhu, Z. Liu, Q. Zhang, Y. Zhou, X. Cao and Z. Ma, CVPR 2023): a volume of which
 * every voxel is a small network's answer to two learned numbers (method/implicit_field.h),
 *     min over table and network of 1/2 |A x - y|^2,  x = level |1 + network(table)|,
 * by Adam, with all views in every step. Views are in units of their mean, and the level is such
 * that the start, a constant volume, has projections of this mean. Nothing but the few parameters
 * of the network ties voxels to one another: noise is fitted like light. */

/* Steps, where deconv.iterations doesn't say. */
enum { STEPS = 1500 };

/* Adam's moments, the second shorter than usual, for gradients are no samples and fall by orders;
 * and of the learning rates the last one. */
static const double beta1 = 0.9, beta2 = 0.99, epsilon = 1e-8, last_rate = 0.01;

/* Of table and weights; the same for every frame. */
enum { SEED = 1 };

/* A voxel that gives every view less than this of its PSF's sum is seen by none, and 0. */
static const double least_seen = 1e-4;

/* What Adam keeps. */
struct moments {
    float *m, *v;
    int64_t count;
};

struct diner {
    const struct v2v_comm *comm;
    struct v2v_projector *projector;
    struct v2v_projector_share share;
    struct v2v_implicit_field field;
    struct moments table, network;
    struct v2v_diner_settings rates;
    int64_t views, height, width, steps;
    float *level;    /* [slices,rows,x]: what the field is multiplied by; 0 where no view sees it */
    float *volume;   /* likewise, where that is not what the caller holds, else NULL */
    float *gradient; /* likewise, of the volume */
    float *residual; /* [v,view_rows,x] */
    double *of_row;  /* [v,y]: a sum over a row of a view, of all ranks */
};

static int64_t voxels_of(const struct diner *self)
{
    return self->share.slices.count * self->share.rows.count * self->width;
}

static enum v2v_status describe_work(struct v2v_grid_work *work, const struct v2v_problem *problem)
{
    enum { VOLUMES = 4, VIEWS = 3, MOMENTS = 2 }; /* those of the caller with them */
    const struct v2v_psf_file *psf = problem->psf;
    const struct v2v_config *config = problem->config;
    const int64_t height = problem->height, width = problem->width;
    const int64_t numbers = VOLUMES + MOMENTS * V2V_IMPLICIT_COORDINATES;
    const int64_t floats = v2v_mem_product(numbers * psf->slices, height, width);
    const int64_t views = v2v_mem_product(VIEWS * psf->views, height, width);
    const int64_t field = v2v_implicit_field_bytes(config->diner.width, psf->slices, height, width);
    const int64_t projector =
        v2v_projector_bytes(psf, height, width, v2v_split_of_slabs(config), 1);
    *work = (struct v2v_grid_work){.height = height,
                                   .unit = 1,
                                   .most_shards = (int)height,
                                   .most_branches = 1,
                                   .bytes = v2v_mem_bytes(floats, v2v_mem_bytes(views, field)),
                                   .fixed_bytes = v2v_mem_bytes(views, 0)};
    work->bytes = work->bytes > INT64_MAX - projector ? INT64_MAX : work->bytes + projector;
    if (config->deconv.stop != V2V_STOP_FIXED) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "--stop heldout is for Richardson-Lucy (--method rl, rld or frl): diner "
                        "takes deconv.iterations steps");
    }
    return V2V_OK;
}

static enum v2v_status take_moments(struct moments *moments, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    moments->count = count;
    V2V_TRY(V2V_ALLOC(moments->m, "diner.adam", count));
    V2V_TRY(V2V_ALLOC(moments->v, "diner.adam", count));
done:
    return rc;
}

static enum v2v_status take_memory(struct diner *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_share *share = &self->share;
    const struct v2v_implicit_field *field = &self->field;
    const int64_t voxels = v2v_mem_product(share->slices.count, share->rows.count, self->width);
    V2V_TRY(v2v_implicit_field_init(&self->field, self->rates.width, share->slices.count,
                                    self->height, self->width, self->comm));
    V2V_ASSERT(field->rows.first == share->rows.first && field->rows.count == share->rows.count);
    V2V_TRY(take_moments(&self->table, field->rows.count * V2V_IMPLICIT_COORDINATES * field->run));
    V2V_TRY(take_moments(&self->network, field->at.count));
    V2V_TRY(V2V_ALLOC(self->level, "diner.volume", voxels));
    V2V_TRY(V2V_ALLOC(self->gradient, "diner.volume", voxels));
    if (v2v_comm_size(self->comm) > 1) {
        V2V_TRY(V2V_ALLOC(self->volume, "diner.volume", voxels));
    }
    V2V_TRY(V2V_ALLOC(self->residual, "diner.views",
                      v2v_mem_product(self->views, share->view_rows.count, self->width)));
    V2V_TRY(V2V_ALLOC(self->of_row, "diner.views", self->views * self->height));
done:
    return rc;
}

/** The residual's sums over pixels, of numbers or of their squares, in one order for any number of
 *  ranks. Collective(comm). */
static double sum_views(struct diner *self, int is_squared)
{
    const int64_t rows = self->share.view_rows.count, all_rows = self->views * self->height;
    double sum = 0.0;
    memset(self->of_row, 0, (size_t)all_rows * sizeof *self->of_row);
#pragma omp parallel for schedule(static)
    for (int64_t r = 0; r < self->views * rows; r++) {
        const float *row = self->residual + r * self->width;
        double of_row = 0.0;
        for (int64_t x = 0; x < self->width; x++) {
            of_row += is_squared ? (double)row[x] * (double)row[x] : (double)row[x];
        }
        self->of_row[r / rows * self->height + self->share.view_rows.first + r % rows] = of_row;
    }
    v2v_par_sum_f64(self->comm, self->of_row, all_rows);
    for (int64_t r = 0; r < all_rows; r++) {
        sum += self->of_row[r];
    }
    return sum;
}

/** The level: 1 where a view sees the voxel. Local. */
static enum v2v_status mark_seen(struct diner *self, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_sensitivity sensitivity = {0};
    double *seen = NULL;
    const int64_t rows = self->share.rows.count, width = self->width;
    V2V_TRY(v2v_sensitivity_init(&sensitivity, psf, self->share.slices, self->height, width));
    V2V_TRY(V2V_ALLOC(seen, "diner.seen", width));
    for (int64_t r = 0; r < self->share.slices.count * rows; r++) {
        float *level = self->level + r * width;
        for (int64_t v = 0; v < self->views; v++) {
            v2v_sensitivity_row(&sensitivity, seen, v, r / rows, self->share.rows.first + r % rows);
            for (int64_t x = 0; x < width; x++) {
                level[x] = seen[x] > least_seen * sensitivity.total[v] ? 1.0f : level[x];
            }
        }
    }
done:
    v2v_mem_free(seen);
    v2v_sensitivity_fini(&sensitivity);
    return rc;
}

/** The level over the mean of its projections. Collective(comm). */
static void set_level(struct diner *self)
{
    const int64_t voxels = voxels_of(self);
    const double pixels = (double)(self->views * self->height * self->width);
    v2v_projector_forward(self->projector, self->residual, self->level, NULL, self->views, 1.0f);
    const double mean = sum_views(self, 0) / pixels;
    const float level = mean > 0.0 ? (float)(1.0 / mean) : 0.0f;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        self->level[i] *= level;
    }
}

static enum v2v_status create(struct v2v_estimator *estimator, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct diner *self = NULL;
    const struct v2v_config *config = problem->config;
    rc = V2V_ALLOC(self, "diner", 1);
    estimator->self = self;
    V2V_TRY(v2v_par_agree(estimator->shard, rc));
    *self =
        (struct diner){.comm = estimator->shard,
                       .rates = config->diner,
                       .views = problem->psf->views,
                       .height = problem->height,
                       .width = problem->width,
                       .steps = config->deconv.iterations > 0 ? config->deconv.iterations : STEPS};
    V2V_TRY(v2v_projector_create(&self->projector, problem->psf, self->height, self->width,
                                 v2v_split_of_slabs(config), self->comm));
    self->share = v2v_projector_share(self->projector);
    rc = take_memory(self);
    if (rc == V2V_OK) {
        rc = mark_seen(self, problem->psf);
    }
    V2V_TRY(v2v_par_agree(self->comm, rc));
    set_level(self);
    estimator->slices = v2v_projector_slices(self->projector);
done:
    return rc;
}

static void destroy(struct v2v_estimator *estimator)
{
    struct diner *self = estimator->self;
    if (self != NULL) {
        v2v_projector_destroy(&self->projector);
        v2v_implicit_field_fini(&self->field);
        v2v_mem_free(self->table.m);
        v2v_mem_free(self->table.v);
        v2v_mem_free(self->network.m);
        v2v_mem_free(self->network.v);
        v2v_mem_free(self->level);
        v2v_mem_free(self->volume);
        v2v_mem_free(self->gradient);
        v2v_mem_free(self->residual);
        v2v_mem_free(self->of_row);
        v2v_mem_free(self);
    }
}

static enum v2v_status look(const struct v2v_estimator *estimator, const float *volume,
                            int64_t step)
{
    const struct diner *self = estimator->self;
    return v2v_estimator_check_step(estimator, V2V_FAULT_POINT("diner.step"), volume, &self->share,
                                    "step", step);
}

/** The volume: what the field gives, times the level. Local. */
static void draw_volume(struct diner *self, float *volume)
{
    const int64_t voxels = voxels_of(self);
    v2v_implicit_field_forward(&self->field, volume);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        volume[i] *= self->level[i];
    }
}

/** The gradient of the squares by the field. Collective(comm). */
static void differentiate(struct diner *self, const float *volume, const float *views, float scale)
{
    const struct v2v_part rows = self->share.view_rows;
    const int64_t pixels = rows.count * self->width, voxels = voxels_of(self);
    v2v_projector_forward(self->projector, self->residual, volume, NULL, self->views, 1.0f);
    for (int64_t v = 0; v < self->views; v++) {
        const float *recorded = views + (v * self->height + rows.first) * self->width;
        float *residual = self->residual + v * pixels;
#pragma omp parallel for simd schedule(static)
        for (int64_t p = 0; p < pixels; p++) {
            residual[p] -= recorded[p] * scale;
        }
    }
    v2v_projector_adjoint(self->projector, self->gradient, self->residual, NULL, self->views, 1.0f);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        self->gradient[i] *= self->level[i];
    }
    v2v_implicit_field_backward(&self->field, self->gradient);
}

/** Of the learning rates, in step `i` of `steps`: half a cosine from 1 on. */
static double decay(int64_t i, int64_t steps)
{
    const double turn = cos(V2V_PI * (double)(i - 1) / (double)steps);
    return last_rate + (1.0 - last_rate) * 0.5 * (1.0 + turn);
}

static void descend(const struct moments *moments, float *x, const float *gradient, double rate,
                    int64_t i)
{
    const struct v2v_adam adam = {rate, beta1, beta2, epsilon};
    v2v_adam_step(&adam, x, moments->m, moments->v, gradient, moments->count, i);
}

static void forget(const struct moments *moments)
{
    memset(moments->m, 0, (size_t)moments->count * sizeof *moments->m);
    memset(moments->v, 0, (size_t)moments->count * sizeof *moments->v);
}

static void to_slices(struct v2v_estimator *estimator, float *slices, const float *volume)
{
    struct diner *self = estimator->self;
    v2v_projector_to_slices(self->projector, slices, volume);
}

/** From the start to the last step, or until the monitor (NULL: none) has seen enough.
 *  Collective(shard). @param mean of the views */
static enum v2v_status fit(struct v2v_estimator *estimator, float *volume, const float *views,
                           double mean, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct diner *self = estimator->self;
    struct v2v_implicit_field *field = &self->field;
    const struct v2v_iterate now = {estimator, to_slices, volume, mean};
    int enough = 0;
    v2v_implicit_field_draw(field, SEED);
    forget(&self->table);
    forget(&self->network);
    draw_volume(self, volume);
    for (int64_t i = 1; i <= self->steps && !enough; i++) {
        const double part = decay(i, self->steps);
        v2v_watchdog_beat("a step of diner");
        differentiate(self, volume, views, (float)(1.0 / mean));
        descend(&self->table, field->table, field->dtable, part * self->rates.table_rate, i);
        descend(&self->network, field->weights, field->dweights, part * self->rates.network_rate,
                i);
        draw_volume(self, volume);
        V2V_TRY(v2v_par_agree(self->comm, look(estimator, volume, i)));
        enough = monitor != NULL && monitor->enough(monitor->context, i, &now);
        estimator->iterations = i;
    }
    v2v_log(V2V_LOG_DEBUG, "frame %lld: %lld steps of diner", (long long)estimator->frame,
            (long long)estimator->iterations);
done:
    return rc;
}

static enum v2v_status run(struct v2v_estimator *estimator, float *const *volume,
                           const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct diner *self = estimator->self;
    float *own = self->volume != NULL ? self->volume : volume[0];
    const int64_t voxels = voxels_of(self);
    double mean = 0.0;
    V2V_TRY(v2v_par_agree(self->comm, v2v_estimator_mean(&mean, estimator, views, self->views)));
    v2v_par_max_f64(self->comm, &mean, 1); /* one number: ranks may round another way */
    estimator->iterations = 0;
    if (mean > V2V_ESTIMATOR_DARK) {
        V2V_TRY(fit(estimator, own, views, mean, monitor));
    } else {
        memset(own, 0, (size_t)voxels * sizeof *own);
    }
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        own[i] = (float)(own[i] * mean);
    }
    V2V_TRY(v2v_par_agree(self->comm, look(estimator, own, estimator->iterations)));
    v2v_projector_to_slices(self->projector, volume[0], own);
done:
    return rc;
}

static const char *const keys[] = {"deconv.iterations", "deconv.stop", NULL};

const struct v2v_estimator_ops v2v_estimator_diner = {
    .name = "diner",
    .keys = keys,
    .describe_work = describe_work,
    .create = create,
    .destroy = destroy,
    .run = run,
};
