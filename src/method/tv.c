#include "method/tv.h"

#include "method/photons.h"
#include "method/tv_lambda.h"
#include "method/tv_level.h"
#include "method/tv_planes.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/slicing.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Total variation by maximum a posteriori (REFERENCE.md 10):
 *     min over x >= 0 of
 *         1/2 |A x - y|^2 + lambda sigma sum (|(dx, dy, depth dz) x| + curvature |L x|)
 *                         + sparsity s sum x
 * with sigma the noise of the views, s what a voxel sees of it, L a Laplacian in the plane, and
 * |.| squared below a small part of sigma, by a primal-dual method (Chambolle and Pock, J.
 * Math. Imaging Vis. 40, 120 (2011), over-relaxed as Condat, J. Optim. Theory Appl. 158, 460
 * (2013)). With K all that has a dual, of step h, a step of the volume x costs 1/2 |x - v|_P^2,
 * P >= h K^T K (Pock and Chambolle, Proc. ICCV, 1762 (2011)): what K does in the plane is a
 * number a frequency, so that P is h K^T K itself but for differences along z, and the step
 * towards the views is taken in closed form all the same (optics/data_step.h). Views and volume
 * are in units of sigma here, so that lambda is one number for all scenes. Noise of photons
 * weighs the squares by the inverse of its variance. */

/* Over-relaxation, below 2; and where samples have weights, which move the views, too. */
static const float relax = 1.7f, relax_if_weighted = 1.6f;

/* Iterations from one look at the views beyond the frame to the next. */
enum { EXTEND_EVERY = 2 };

/* At most, where deconv.iterations doesn't say; ended before by the tolerance. */
enum { MOST_ITERATIONS = 500 };

/* Bounds of a dual's step. What answers a negative sample deeper than so many times the brightness
 * is as large as that: steps grow by the root of it. */
static const double least_step = 1.0 / 2048.0, most_step = 4.0, deep = 10.0;

/* Differences below this part of sigma are weighted by their squares: fewer steps where the scene
 * is smooth. */
static const double smooth_below = 0.03;

/* Of the Laplacian in K, whose differences count as they are: that changes steps, not the minimum.
 */
static const double bend = 0.7;

/* Size of a dual's step, of sigma lambda / brightness, and how much of x itself is in K: neither
 * changes the minimum. Where a voxel sees more of the noise there is more below zero to be taken
 * out: x goes by the root of it (tests/bench/iteration.md). Where light fills more of the voxels
 * than half, which an early volume shows, little is below zero, and light has far to go along z
 * (tests/bench/quality.md). */
static const struct pace {
    double step, plain;
} usual_pace = {2.0, 0.5}, pace_if_filled = {16.0, 0.1};
static const double half_filled = 0.5;
enum { PACE_LOOK = 10 };

/* v2v_psf_voxel_noise of the 13 views of 39 slices that the constants here were chosen for. */
static const double usual_voxel_noise = 0.02976;

/* Noise over the brightness, from which down the tolerance goes with it, and the least part of it
 * that is asked for: what an iteration still gains is less than noise leaves above
 * (tests/bench/quality.md). */
static const double clear_noise = 0.0125, least_asked = 0.1;

/* Of the tolerance, at most, where the volume itself has a weight: points of light come late. */
static const double part_if_sparse = 1.0 / 3.0;

/* Where light would fit into less of the voxels than this, the tolerance goes with how much less,
 * down to the least part: the dark about points, which is nearly all there is, takes long to become
 * so, and moves the volume by little. Where it fills more than half, the tolerance goes with the
 * square of how much more: light that is everywhere finds its depth slowly
 * (tests/bench/quality.md). */
static const double filled_by_points = 0.005, least_of_points = 0.02;

/* Weights below count as this one: none, nearly. */
static const double least_lambda = 1e-6;

/* Of a view's PSFs, and one over it: steps go by its square, and are float32. */
static const double most_light = 1e15;

/* Sizes of a step, of a factor of two. */
#define SIZES 2.0

struct tv {
    const struct v2v_comm *comm;
    struct v2v_data_step *step;
    struct v2v_slicing *slicing; /* of the frame's rows that ranks hold */
    struct v2v_tv_planes planes;
    struct v2v_torus torus;
    struct v2v_part rows; /* of the frame, here */
    int64_t views, slices, height, width;
    int64_t iterations;
    double lambda, depth, curvature, sparsity, tolerance;
    enum v2v_noise_model model;
    struct v2v_camera camera;
    int may_average;           /* bool: views may be means of frames */
    double light;              /* sum of a view's PSF, mean of all views */
    double seen;               /* v2v_tv_noise_seen */
    int is_told;               /* bool: `level` is that of a larger frame, for all runs */
    struct v2v_tv_level level; /* of the last run, or of all */
    float *cut;                /* [slices,rows,width]: the frame's rows of the volume */
    float *scratch;            /* [v,height,width] or [v,rows of the torus, its width] */
    struct v2v_tv_steps steps; /* of the last run */
};

static int is_open(const struct v2v_config *config)
{
    return config->deconv.lambda.mode != V2V_NUMBER_GIVEN ||
           config->deconv.noise == V2V_NOISE_MODEL_AUTO;
}

/* The noise first: lambda is in units of it. */
static enum v2v_status settle(struct v2v_config *config, const struct v2v_problem *problem,
                              const float *views, const struct v2v_averaging *averaging,
                              const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    rc = v2v_camera_check(problem);
    if (rc == V2V_OK) {
        rc = v2v_photons_settle(config, problem, views, averaging);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_tv_settle_weights(&config->deconv, problem, views, averaging, comm));
done:
    return rc;
}

struct v2v_torus v2v_tv_torus_of(const struct v2v_problem *problem)
{
    const int64_t height = problem->height, width = problem->width;
    const struct v2v_torus own = {height, width, {0, height}};
    return problem->is_part ? own : v2v_data_step_torus_of(problem->psf, height, width);
}

static enum v2v_status describe_work(struct v2v_grid_work *work, const struct v2v_problem *problem)
{
    enum { VOLUMES = 3, VIEWS = 3, WEIGHTS = 4 }; /* those of the caller with them */
    const struct v2v_psf_file *psf = problem->psf;
    const int64_t height = problem->height, width = problem->width;
    const struct v2v_torus torus = v2v_tv_torus_of(problem);
    const int64_t volumes = v2v_mem_product(VOLUMES * psf->slices, height, width);
    const int64_t views = v2v_mem_product(VIEWS * psf->views, height, width);
    const int64_t floats = v2v_tv_planes_floats(psf->slices, torus.height, torus.width) +
                           v2v_mem_product(WEIGHTS * psf->views, torus.height, torus.width);
    const int64_t data_step =
        v2v_data_step_bytes(psf, &torus, v2v_split_of_slabs(problem->config), 1);
    *work = (struct v2v_grid_work){
        .height = height,
        .unit = 1,
        .most_shards = (int)v2v_larger(height / V2V_TV_BEYOND, 1), /* of any views' torus */
        .most_branches = 1,
        .bytes = v2v_mem_bytes(volumes, v2v_mem_bytes(views, v2v_mem_bytes(floats, data_step))),
        .fixed_bytes = v2v_mem_bytes(views, 0)};
    if (problem->config->deconv.lambda.mode == V2V_NUMBER_AUTO) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "deconv.lambda: auto is for a recording to settle; here it is a number");
    }
    if (problem->config->deconv.stop != V2V_STOP_FIXED) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "--stop heldout is for Richardson-Lucy (--method rl, rld or frl): "
                        "tv ends when its volume stands still");
    }
    return v2v_camera_check(problem);
}

/* Rows of the frame among the torus' rows of a rank. */
static struct v2v_part frame_rows(const struct tv *self, int rank)
{
    const struct v2v_part all = v2v_par_part(self->torus.height, v2v_comm_size(self->comm), rank);
    return (struct v2v_part){all.first, v2v_within(self->height - all.first, 0, all.count)};
}

static enum v2v_status take_memory(struct tv *self)
{
    enum v2v_status rc = V2V_OK;
    const int ranks = v2v_comm_size(self->comm);
    struct v2v_part *rows = NULL;
    V2V_TRY(v2v_tv_planes_init(&self->planes, self->slices, self->torus.rows.count,
                               self->torus.width, self->comm));
    V2V_TRY(V2V_ALLOC(rows, "tv.cut", ranks));
    for (int r = 0; r < ranks; r++) {
        rows[r] = frame_rows(self, r);
    }
    self->rows = rows[v2v_comm_rank(self->comm)];
    V2V_TRY(v2v_slicing_create(&self->slicing, self->comm, self->slices, self->height, self->width,
                               rows));
    V2V_TRY(V2V_ALLOC(self->cut, "tv.cut",
                      v2v_mem_product(self->slices, self->rows.count, self->width)));
    V2V_TRY(V2V_ALLOC(self->scratch, "tv.noise",
                      v2v_mem_product(self->views, v2v_larger(self->height, self->torus.rows.count),
                                      self->torus.width)));
    if (self->model != V2V_NOISE_MODEL_GAUSSIAN || self->may_average) {
        V2V_TRY(v2v_data_step_take_weights(self->step));
    }
done:
    v2v_mem_free(rows);
    return rc;
}

static enum v2v_status create(struct v2v_estimator *estimator, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct tv *self = NULL;
    const struct v2v_config *config = problem->config;
    const double light = v2v_psf_light(problem->psf);
    rc = light >= 1.0 / most_light && light <= most_light
             ? V2V_ALLOC(self, "tv", 1)
             : V2V_FAIL(V2V_E_INPUT,
                        "a view's PSFs sum to %.3g: total variation takes 1e-15 to 1e15; "
                        "--normalize view makes it 1",
                        light);
    estimator->self = self;
    V2V_TRY(v2v_par_agree(estimator->shard, rc));
    *self = (struct tv){.comm = estimator->shard,
                        .views = problem->psf->views,
                        .slices = problem->psf->slices,
                        .height = problem->height,
                        .width = problem->width,
                        .iterations = config->deconv.iterations,
                        .lambda = config->deconv.lambda.value,
                        .depth = config->deconv.depth,
                        .curvature = config->deconv.curvature,
                        .sparsity = config->deconv.sparsity.mode == V2V_NUMBER_GIVEN
                                        ? config->deconv.sparsity.value
                                        : 0.0,
                        .tolerance = config->deconv.tolerance,
                        .model = config->deconv.noise,
                        .camera = v2v_camera_of(config),
                        .may_average = config->recon.neighbours > 0 || problem->skip > 0.0,
                        .light = light,
                        .seen = v2v_tv_noise_seen(problem->psf)};
    const struct v2v_torus torus = v2v_tv_torus_of(problem);
    const int ranks = v2v_comm_size(self->comm);
    if (ranks > 1 && torus.height / ranks < V2V_TV_BEYOND) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%d ranks for %lld rows: %lld ranks at most can share them",
                         ranks, (long long)torus.height,
                         (long long)(torus.height / V2V_TV_BEYOND)));
    }
    V2V_TRY(v2v_data_step_create(&self->step, problem->psf, problem->height, problem->width, &torus,
                                 v2v_split_of_slabs(config), self->comm));
    self->torus = v2v_data_step_torus(self->step);
    V2V_TRY(v2v_par_agree(self->comm, take_memory(self)));
    estimator->slices = v2v_slicing_own(self->slicing);
done:
    return rc;
}

double v2v_tv_noise_seen(const struct v2v_psf_file *psf)
{
    return v2v_psf_voxel_noise(psf) / v2v_psf_light(psf) / usual_voxel_noise;
}

void v2v_tv_set_weights(struct v2v_estimator *estimator, double lambda, double sparsity)
{
    struct tv *self = estimator->self;
    self->lambda = lambda;
    self->sparsity = sparsity;
}

static void destroy(struct v2v_estimator *estimator)
{
    struct tv *self = estimator->self;
    if (self != NULL) {
        v2v_data_step_destroy(&self->step);
        v2v_slicing_destroy(&self->slicing);
        v2v_tv_planes_fini(&self->planes);
        v2v_mem_free(self->cut);
        v2v_mem_free(self->scratch);
        v2v_mem_free(self);
    }
}

/** Rank 0's answer is all ranks': others may round another way. Collective(comm). */
static void measure_frame(struct v2v_estimator *estimator, const float *views)
{
    struct tv *self = estimator->self;
    const struct v2v_tv_views taken = {.views = views,
                                       .count = self->views,
                                       .height = self->height,
                                       .width = self->width,
                                       .averaging = estimator->averaging,
                                       .model = self->model,
                                       .camera = &self->camera};
    self->level = v2v_tv_level_of(&taken, self->scratch);
    v2v_par_broadcast(self->comm, &self->level, sizeof self->level, 0);
}

static double weight_of(const struct tv *self)
{
    return fmax(self->lambda, least_lambda);
}

/* The duals' size over the volume's, about. In steps of its own, so that frames alike share their
 * factors. */
static double step_of(const struct tv *self, double factor)
{
    const struct v2v_tv_level *level = &self->level;
    const double weight = weight_of(self) * (1.0 + self->curvature);
    const double wanted =
        factor * level->sigma * weight / level->brightness * sqrt(fmax(level->deepest / deep, 1.0));
    const double bounded = fmin(fmax(wanted, least_step), most_step);
    return exp2(round(SIZES * log2(bounded)) / SIZES) * self->light * self->light;
}

/* The first rows and columns of a volume on the torus, none below zero. */
static void copy_volume(const struct tv *self, float *volume, const float *torus, int64_t rows,
                        int64_t width, double scale)
{
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        for (int64_t y = 0; y < rows; y++) {
            const float *from = torus + (z * self->torus.rows.count + y) * self->torus.width;
            float *to = volume + (z * rows + y) * width;
            for (int64_t x = 0; x < width; x++) {
                to[x] = from[x] < 0.0f ? 0.0f : (float)(from[x] * scale); /* NaN stays */
            }
        }
    }
}

/* The frame's rows of the volume. Collective(comm). */
static void cut(const struct tv *self, double scale)
{
    v2v_data_step_volume(self->step, self->planes.volume);
    copy_volume(self, self->cut, self->planes.volume, self->rows.count, self->width, scale);
}

struct v2v_data_step *v2v_tv_data_step(const struct v2v_estimator *estimator)
{
    const struct tv *self = estimator->self;
    return self->step;
}

void v2v_tv_torus_volume(const struct v2v_estimator *estimator, float *volume)
{
    const struct tv *self = estimator->self;
    v2v_data_step_volume(self->step, volume);
    copy_volume(self, volume, volume, self->torus.rows.count, self->torus.width, self->level.sigma);
}

struct v2v_tv_noise v2v_tv_noise(const struct v2v_estimator *estimator)
{
    const struct v2v_tv_level *level = &((const struct tv *)estimator->self)->level;
    const double part = level->sigma > 0.0 ? level->sigma / level->brightness : 0.0;
    return (struct v2v_tv_noise){level->gain * level->sigma, level->dark, part,
                                 level->frames > 0.0 ? estimator->averaging : NULL, level->frames};
}

static void to_slices(struct v2v_estimator *estimator, float *slices, const float *volume)
{
    struct tv *self = estimator->self;
    (void)volume;
    cut(self, 1.0);
    v2v_tv_planes_gradient(&self->planes, &self->steps);
    v2v_slicing_to_slices(self->slicing, slices, self->cut);
}

/** Local: a fault point, a request to stop or numbers that left their range end all ranks. */
static enum v2v_status look(const struct v2v_estimator *estimator, int64_t iteration, double change)
{
    enum v2v_status rc = V2V_FAULT_POINT("tv.iteration");
    if (rc == V2V_OK && !isfinite(change)) {
        rc = V2V_FAIL(V2V_E_NUMERIC, "frame %lld, tv iteration %lld: NaN or Inf",
                      (long long)estimator->frame, (long long)iteration);
    } else if (rc == V2V_OK && v2v_stop_requested()) {
        rc = V2V_FAIL(V2V_STOPPED, "stopped on request in tv iteration %lld", (long long)iteration);
    }
    return rc;
}

/* Of the volume's length, what an iteration moves it by at most when it ends. What views are missed
 * by beyond their noise hides as much as noise does. */
static double tolerance_of(const struct tv *self, double missed)
{
    const double noise = self->level.sigma / self->level.brightness * fmax(missed, 1.0);
    const double most = self->sparsity > 0.0 ? part_if_sparse : 1.0;
    const double filled = v2v_data_step_filled(self->step);
    const double points = fmax(filled / filled_by_points, least_of_points);
    const double full = filled > half_filled ? half_filled / filled : 1.0;
    const double clear = fmin(fmax(noise / clear_noise, least_asked), 1.0);
    const double part = points < 1.0 ? clear * fmin(most, points) : fmin(clear, most);
    return self->tolerance * part * full * full;
}

/* What a dual's step is multiplied by, so that what it is of counts by its square where it is
 * small. */
static double shrink_of(double step, double weight)
{
    return weight > 0.0 ? 1.0 / (1.0 + step * smooth_below / weight) : 1.0;
}

/* lambda and steps are meant for PSFs that sum to 1 a view. */
static struct v2v_tv_steps steps_of(const struct tv *self, const struct pace *pace)
{
    const struct v2v_tv_level *level = &self->level;
    const double step = step_of(self, pace->step);
    const double light = self->light, lambda = weight_of(self) * light;
    const double bent = self->curvature > 0.0 ? bend : 0.0;
    const double kept = pace->plain * sqrt(fmax(self->seen, 1.0));
    return (struct v2v_tv_steps){
        .lambda = (float)lambda,
        .depth = (float)self->depth,
        .plain = (float)kept,
        .sparse = (float)(self->sparsity * self->seen * usual_voxel_noise * light / kept),
        .bend = (float)bent,
        .bound = (float)(lambda * self->curvature / bend),
        .sigma = (float)step,
        .shrink = (float)shrink_of(step, lambda * light),
        .shrink_bent = (float)shrink_of(step * bent * bent, lambda * light * self->curvature),
        .relax = level->gain > 0.0 || level->frames > 0.0 ? relax_if_weighted : relax};
}

static void set_pace(struct tv *self, const struct pace *pace)
{
    v2v_watchdog_beat("inverses of the data step");
    self->steps = steps_of(self, pace);
    const struct v2v_penalty penalty = v2v_tv_planes_penalty(&self->steps);
    v2v_data_step_factor(self->step, &penalty);
}

/* Has light far to go along z? What has a weight of its own is pulled below zero everywhere. */
static int is_filled(const struct tv *self)
{
    return self->sparsity == 0.0 && v2v_data_step_filled(self->step) > half_filled;
}

/* From the next iteration on. */
static void change_pace(struct tv *self, const struct pace *from, const struct pace *to)
{
    v2v_tv_planes_rescale(&self->planes, (float)(from->plain / to->plain));
    set_pace(self, to);
}

static enum v2v_status iterate(struct v2v_estimator *estimator, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct tv *self = estimator->self;
    const struct v2v_tv_level *level = &self->level;
    const struct v2v_iterate now = {estimator, to_slices, NULL, level->sigma};
    const int64_t own = self->iterations > 0 ? self->iterations : MOST_ITERATIONS;
    const int64_t most = estimator->most_iterations > 0 ? estimator->most_iterations : own;
    const double variance = (double)v2v_data_step_known(self->step) * level->mean_variance;
    double change = INFINITY, tolerance = self->tolerance;
    int64_t done = 0;
    set_pace(self, &usual_pace);
    for (int64_t i = 1, enough = 0; i <= most && !enough && change > tolerance; i++) {
        v2v_watchdog_beat("an iteration of total variation");
        v2v_data_step_advance(self->step, self->planes.volume, self->steps.relax);
        if (i % EXTEND_EVERY == 0) {
            const double squares = v2v_data_step_extend(self->step);
            estimator->misfit.missed = variance > 0.0 ? sqrt(squares / variance) : 0.0;
            tolerance = tolerance_of(self, estimator->misfit.missed);
        }
        v2v_tv_planes_step(&self->planes, &self->steps);
        change = v2v_data_step_change(self->step);
        V2V_TRY(v2v_par_agree(self->comm, look(estimator, i, change)));
        if (i == PACE_LOOK && is_filled(self)) {
            change_pace(self, &usual_pace, &pace_if_filled);
            change = INFINITY; /* not known of these steps */
        }
        enough = monitor != NULL && monitor->enough(monitor->context, i, &now);
        done = i;
    }
    if (done >= EXTEND_EVERY) {
        estimator->misfit.coarse = v2v_data_step_coarse(self->step) / sqrt(level->mean_variance);
    }
    v2v_log(V2V_LOG_DEBUG, "frame %lld: noise%s %.3g of the brightness",
            (long long)estimator->frame, level->gain > 0.0 ? " of photons," : "",
            level->sigma / level->brightness);
    v2v_log(V2V_LOG_DEBUG,
            "frame %lld: %lld iterations of tv, views missed by %.3g of their noise, "
            "%.3g where it is coarse",
            (long long)estimator->frame, (long long)done, estimator->misfit.missed,
            estimator->misfit.coarse);
    estimator->iterations = done;
    if (self->iterations == 0 && done == MOST_ITERATIONS && v2v_comm_rank(self->comm) == 0) {
        v2v_log(V2V_LOG_WARNING, "frame %lld: after %lld iterations tv still moves by %.2g",
                (long long)estimator->frame, (long long)done, change);
    }
done:
    return rc;
}

/** Local: this rank's rows of [count,height,width] of a part, times `scale`. */
static void take_rows(const struct tv *self, float *rows, const float *planes, int64_t count,
                      double scale)
{
    const int64_t first = self->torus.rows.first * self->width;
    const int64_t own = self->torus.rows.count * self->width, all = self->height * self->width;
#pragma omp parallel for schedule(static)
    for (int64_t k = 0; k < count; k++) {
        for (int64_t i = 0; i < own; i++) {
            rows[k * own + i] = (float)(scale * planes[k * all + first + i]);
        }
    }
}

/** The views of a frame or a part. Collective(comm). */
static void begin(struct v2v_estimator *estimator, const float *views)
{
    struct tv *self = estimator->self;
    const struct v2v_surroundings *around = estimator->around;
    const struct v2v_tv_level *level = &self->level;
    const double scale = 1.0 / level->sigma;
    v2v_data_step_begin(self->step, views, scale);
    if (around != NULL) {
        take_rows(self, self->planes.volume, around->light, self->slices, scale);
        take_rows(self, self->scratch, around->seen, self->views, scale);
        v2v_data_step_surround(self->step, self->planes.volume, self->scratch, views,
                               around->highest);
        v2v_data_step_know(self->step, &around->rows, &around->columns);
    }
    if (level->gain > 0.0 || estimator->averaging != NULL) {
        v2v_data_step_weigh(self->step, level->gain, level->floor);
    }
    if (estimator->averaging != NULL) {
        v2v_data_step_average(self->step, estimator->averaging->frames, level->frames);
    }
}

static enum v2v_status run(struct v2v_estimator *estimator, float *const *volume,
                           const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = V2V_OK;
    struct tv *self = estimator->self;
    V2V_TRY(v2v_par_agree(self->comm, v2v_estimator_check_views(estimator, views, self->views)));
    if (!self->is_told) {
        measure_frame(estimator, views);
    }
    const struct v2v_tv_level *level = &self->level;
    const int is_lit = level->sigma > 0.0; /* else a dark frame, which is a dark volume */
    estimator->iterations = 0;
    estimator->misfit =
        (struct v2v_misfit){.noise_of_coarse = v2v_tv_noise(estimator).part *
                                               sqrt(level->mean_variance) / V2V_DATA_STEP_SQUARE};
    if (is_lit) {
        begin(estimator, views);
    }
    v2v_tv_planes_clear(&self->planes);
    v2v_data_step_clear(self->step);
    if (is_lit) {
        V2V_TRY(iterate(estimator, monitor));
    }
    cut(self, level->sigma);
    v2v_slicing_to_slices(self->slicing, volume[0], self->cut);
done:
    return rc;
}

static void whole_light(struct v2v_estimator *whole, float *volume, float *views)
{
    struct tv *self = whole->self;
    v2v_tv_torus_volume(whole, self->planes.volume);
    v2v_data_step_project(self->step, self->scratch, self->planes.volume);
    v2v_data_step_gather(self->step, volume, self->planes.volume, self->slices);
    v2v_data_step_gather(self->step, views, self->scratch, self->views);
}

/** This rank's rows of the frame. Collective(comm). */
static void project(struct v2v_estimator *estimator, float *views, const float *volume)
{
    struct tv *self = estimator->self;
    const struct v2v_torus *torus = &self->torus;
    const int64_t rows = self->rows.count, width = self->width;
    v2v_slicing_to_rows(self->slicing, self->cut, volume);
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        float *plane = self->planes.volume + z * torus->rows.count * torus->width;
        memset(plane, 0, (size_t)(torus->rows.count * torus->width) * sizeof *plane);
        for (int64_t y = 0; y < rows; y++) {
            memcpy(plane + y * torus->width, self->cut + (z * rows + y) * width,
                   (size_t)width * sizeof *plane);
        }
    }
    v2v_data_step_project(self->step, self->scratch, self->planes.volume);
    memset(views, 0, (size_t)(self->views * self->height * width) * sizeof *views);
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t y = 0; y < rows; y++) {
            memcpy(views + (v * self->height + self->rows.first + y) * width,
                   self->scratch + (v * torus->rows.count + y) * torus->width,
                   (size_t)width * sizeof *views);
        }
    }
}

static void inherit(struct v2v_estimator *window, const struct v2v_estimator *whole)
{
    const struct tv *of_frame = whole->self;
    struct tv *self = window->self;
    self->level = of_frame->level;
    self->is_told = 1;
}

static const char *const keys[] = {"deconv.stop", V2V_TV_KEYS, NULL};

const struct v2v_estimator_ops v2v_estimator_tv = {
    .name = "tv",
    .keys = keys,
    .leaves_blind = 1,
    .is_open = is_open,
    .settle = settle,
    .describe_work = describe_work,
    .create = create,
    .destroy = destroy,
    .run = run,
    .measure = measure_frame,
    .inherit = inherit,
    .whole_light = whole_light,
    .project = project,
};
