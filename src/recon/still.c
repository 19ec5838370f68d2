#include "recon/still.h"

#include "recon/windows.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/carve.h"
#include "v2v3d/optics/data_step.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

enum { TILE = V2V_CARVE_TILE };

/* Pixels about a tile that changed: they changed less than a tile shows. */
enum { HALO = TILE };

/* Of noise alone: of 4096 tiles the brightest shows 2.8 to 3.4 standard deviations (v2v/scene.c),
 * more where less of a key frame was averaged; every tile that is taken for changed costs a
 * window. */
static const double noise_deviations = 4.5;

/* Brightest: a hundredth of the tiles is brighter still, so that a hot pixel is not the measure. */
static const double brightest_share = 0.99;

/* Pixels of a window around what it gives, for light and differences across its edges are the key
 * frame's, and a network that pools pixels by two looks so far. 4 and 16 change a volume by 0.01 dB
 * (tests/bench/speed.md). */
enum { MARGIN = 8 };

/* A frame of which more is to be computed is computed whole. */
static const double most_part = 0.8;

/* What more than this part of a frame misses of its views tells of the frame. */
static const double telling_part = 0.25;

struct v2v_still {
    struct v2v_estimator *whole;  /* borrowed */
    struct v2v_estimator *window; /* of the last window's size; NULL: none yet */
    struct v2v_problem problem;
    struct v2v_carve *carve;
    struct v2v_windows_plan plan;
    int64_t tiles, samples;
    int64_t planned;    /* bytes of the largest window's estimator */
    double brightest;   /* light of the key frame */
    int64_t iterations; /* that the key frame took */
    double left;        /* the largest change left out, of the brightest light */
    float *key_views;   /* [v,y,x] */
    float *key;         /* [slices,y,x] */
    float *light;       /* [all slices,torus]: of the key frame .. */
    float *seen;        /* [v,torus]: .. and what views it gives */
    float *views;       /* [v,y,x]: the change, then those of a window */
    float *frames;      /* likewise, of a window's averaging; NULL: there is none */
    float *volume;      /* [slices,y,x] of a window */
    float *light_here;  /* [all slices,y,x] of a window: as light .. */
    float *seen_here;   /* [v,y,x] of a window: .. and seen */
    float *highest;     /* [v]: v2v_saturated_value of the frame at hand */
    float *change;      /* [2,tile rows,tile columns]: light gained and lost */
    uint8_t *changed;   /* [tile rows,tile columns] */
};

enum v2v_status v2v_still_allow(struct v2v_grid_work *work, const struct v2v_estimator_ops *ops,
                                const struct v2v_problem *problem)
{
    if (ops->inherit == NULL) {
        return V2V_FAIL(V2V_E_CONFIG, "method '%s' skips nothing (--skip off)", ops->name);
    }
    enum { VOLUMES = 2, VIEWS = 4 }; /* of the torus, on every rank */
    const struct v2v_psf_file *psf = problem->psf;
    const struct v2v_torus torus = v2v_data_step_torus_of(psf, problem->height, problem->width);
    const int64_t floats =
        v2v_mem_product(VOLUMES * psf->slices + VIEWS * psf->views, torus.height, torus.width);
    work->bytes = 2 * v2v_smaller(work->bytes, INT64_MAX / 4); /* as much for windows, at most */
    work->fixed_bytes = 2 * v2v_smaller(work->fixed_bytes, INT64_MAX / 4);
    work->bytes = v2v_mem_bytes(floats, work->bytes);
    work->fixed_bytes = v2v_mem_bytes(floats, work->fixed_bytes);
    const int64_t least = v2v_smaller(torus.height, v2v_larger(psf->height, psf->width));
    const int64_t of_window = v2v_larger(least / 2, 1); /* ranks with two of its rows */
    work->most_shards = (int)v2v_smaller(work->most_shards, of_window);
    return V2V_OK;
}

static void make_plan(struct v2v_still *still, const struct v2v_problem *problem)
{
    const struct v2v_psf_file *psf = problem->psf;
    const struct v2v_torus torus = v2v_data_step_torus_of(psf, problem->height, problem->width);
    still->plan = (struct v2v_windows_plan){.height = problem->height,
                                            .width = problem->width,
                                            .torus_height = torus.height,
                                            .torus_width = torus.width,
                                            .tile = TILE,
                                            .halo = HALO,
                                            .margin = MARGIN,
                                            .least = v2v_larger(psf->height, psf->width)};
    still->tiles = v2v_parts(problem->height, TILE) * v2v_parts(problem->width, TILE);
    still->samples = v2v_mem_product(psf->views, problem->height, problem->width);
}

static int64_t voxels_of(const struct v2v_still *still)
{
    return v2v_mem_product(still->whole->slices.count, still->plan.height, still->plan.width);
}

static enum v2v_status take_memory(struct v2v_still *still)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_problem *problem = &still->problem;
    const int64_t pixels = v2v_mem_product(still->plan.torus_height, still->plan.torus_width, 1);
    const int64_t slices = problem->psf->slices, own = still->whole->slices.count;
    const int64_t samples = v2v_mem_product(problem->psf->views, pixels, 1);
    struct v2v_shifts shifts = {0};
    V2V_TRY(v2v_shifts_from_psf(&shifts, problem->psf));
    V2V_TRY(v2v_carve_create(&still->carve, &shifts, problem->height, problem->width));
    V2V_TRY(V2V_ALLOC(still->key_views, "still.views", still->samples));
    V2V_TRY(V2V_ALLOC(still->views, "still.views", samples));
    if (problem->config->recon.neighbours > 0) {
        V2V_TRY(V2V_ALLOC(still->frames, "still.views", samples));
    }
    V2V_TRY(V2V_ALLOC(still->seen, "still.views", samples));
    V2V_TRY(V2V_ALLOC(still->seen_here, "still.views", samples));
    V2V_TRY(V2V_ALLOC(still->key, "still.volume", voxels_of(still)));
    V2V_TRY(V2V_ALLOC(still->volume, "still.volume", v2v_mem_product(own, pixels, 1)));
    V2V_TRY(V2V_ALLOC(still->light, "still.light", v2v_mem_product(slices, pixels, 1)));
    V2V_TRY(V2V_ALLOC(still->light_here, "still.light", v2v_mem_product(slices, pixels, 1)));
    V2V_TRY(V2V_ALLOC(still->highest, "still.views", still->problem.psf->views));
    V2V_TRY(V2V_ALLOC(still->change, "still.tiles", 2 * still->tiles));
    V2V_TRY(V2V_ALLOC(still->changed, "still.tiles", still->tiles));
done:
    v2v_shifts_fini(&shifts);
    return rc;
}

/** Local: what windows take beside the volumes and views of the caller, which are here: at most as
 *  one of the torus' height and of the largest part of it. */
static enum v2v_status plan_windows(struct v2v_still *still)
{
    enum v2v_status rc = V2V_OK;
    enum { OF_CALLER = 2 }; /* volumes and sets of views, in what methods say of their work */
    struct v2v_problem problem = still->problem;
    struct v2v_grid_work work;
    const int64_t ranks = v2v_comm_size(still->whole->shard);
    if (problem.config->recon.refresh == 1) {
        return V2V_OK; /* all are key frames */
    }
    problem.height = still->plan.torus_height;
    problem.width = (int64_t)(most_part * (double)still->plan.torus_width) / 2 * 2;
    problem.is_part = 1;
    V2V_TRY(still->whole->ops->describe_work(&work, &problem));
    const int64_t image = v2v_mem_bytes(OF_CALLER * problem.height * problem.width, 0);
    const int64_t fixed = work.fixed_bytes - image * problem.psf->views;
    const int64_t shared = work.bytes - work.fixed_bytes - image * problem.psf->slices;
    still->planned = v2v_larger(fixed, 0) + v2v_parts(v2v_larger(shared, 0), ranks);
    if ((size_t)still->planned > v2v_mem_room()) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY,
                         "windows of frames take up to %lld bytes, and the limit leaves %zu: raise "
                         "--max-mem, or --skip off",
                         (long long)still->planned, v2v_mem_room()));
    }
done:
    return rc;
}

enum v2v_status v2v_still_create(struct v2v_still **still, struct v2v_estimator *whole,
                                 const struct v2v_problem *problem)
{
    struct v2v_still *made = NULL;
    enum v2v_status rc = V2V_ALLOC(made, "still", 1);
    *still = NULL;
    if (rc == V2V_OK) {
        made->whole = whole;
        made->problem = *problem;
        make_plan(made, problem);
        rc = take_memory(made);
    }
    if (rc == V2V_OK) {
        rc = plan_windows(made);
    }
    V2V_TRY(v2v_par_agree(whole->shard, rc));
    *still = made;
    made = NULL;
done:
    v2v_still_destroy(&made);
    return rc;
}

void v2v_still_destroy(struct v2v_still **still)
{
    struct v2v_still *old = *still;
    *still = NULL;
    if (old != NULL) {
        v2v_estimator_destroy(&old->window);
        v2v_carve_destroy(&old->carve);
        v2v_mem_free(old->key_views);
        v2v_mem_free(old->views);
        v2v_mem_free(old->frames);
        v2v_mem_free(old->key);
        v2v_mem_free(old->volume);
        v2v_mem_free(old->light);
        v2v_mem_free(old->seen);
        v2v_mem_free(old->light_here);
        v2v_mem_free(old->seen_here);
        v2v_mem_free(old->highest);
        v2v_mem_free(old->change);
        v2v_mem_free(old->changed);
        v2v_mem_free(old);
    }
}

int64_t v2v_still_planned(const struct v2v_still *still)
{
    return still->planned;
}

void v2v_still_keep(struct v2v_still *still, const float *views, const float *volume)
{
    const int64_t bright = (int64_t)(brightest_share * (double)(still->tiles - 1));
    memcpy(still->key_views, views, (size_t)still->samples * sizeof *views);
    memcpy(still->key, volume, (size_t)voxels_of(still) * sizeof *volume);
    still->whole->ops->whole_light(still->whole, still->light, still->seen);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < still->samples; i++) {
        still->views[i] = views[i] == V2V_BLIND ? 0.0f : views[i];
    }
    (void)v2v_carve_light(still->carve, still->change, still->views);
    still->iterations = still->whole->iterations;
    still->brightest = fmax(0.0, (double)v2v_select(still->change, still->tiles, bright));
}

void v2v_still_recall(const struct v2v_still *still, float *volume)
{
    memcpy(volume, still->key, (size_t)voxels_of(still) * sizeof *volume);
}

/* ---- what changed ---- */

static void subtract(struct v2v_still *still, const float *from, const float *what)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < still->samples; i++) {
        const int is_blind = from[i] == V2V_BLIND || what[i] == V2V_BLIND;
        still->views[i] = is_blind ? 0.0f : from[i] - what[i];
    }
}

/** Local: mark the tiles whose light changed, by any slice's.
 *  @return the largest change of the others, of the brightest light */
static double find_changed(struct v2v_still *still, const float *views)
{
    double left = 0.0;
    const int64_t tiles = still->tiles;
    float *gained = still->change, *lost = still->change + tiles;
    subtract(still, views, still->key_views);
    const double noise = v2v_carve_gain(still->carve, gained, still->views);
    subtract(still, still->key_views, views);
    (void)v2v_carve_gain(still->carve, lost, still->views);
    const double least = fmax(noise_deviations * noise, still->problem.skip * still->brightest);
    for (int64_t i = 0; i < tiles; i++) {
        const double change = fmax((double)gained[i], (double)lost[i]);
        still->changed[i] = change > least;
        if (!still->changed[i] && still->brightest > 0.0) {
            left = fmax(left, change / still->brightest);
        }
    }
    return left;
}

/* ---- windows ---- */

/** Collective(shard): an estimator of frames of this size. */
static enum v2v_status make_window(struct v2v_still *still, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_problem problem = still->problem;
    if (still->window != NULL && still->window->height == height && still->window->width == width) {
        return V2V_OK;
    }
    v2v_watchdog_beat("preparing a window of the frame");
    v2v_estimator_destroy(&still->window);
    problem.height = height;
    problem.width = width;
    problem.is_part = 1;
    problem.weights = NULL; /* it will be told */
    V2V_TRY(v2v_estimator_create(&still->window, still->whole->ops, &problem, still->whole->shard));
done:
    return rc;
}

/** Local: what there is of planes [v,y,x] in a window, else as it is there. */
static void take_known(const struct v2v_still *still, float *to, const float *planes,
                       const struct v2v_core_window *window, const struct v2v_part *known)
{
    const int64_t height = still->plan.height, width = still->plan.width;
    const int64_t rows = window->rows.count, columns = window->columns.count;
    const int64_t left = window->columns.first + known->first;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < still->problem.psf->views * rows; i++) {
        const int64_t v = i / rows, y = i % rows + window->rows.first;
        if (y >= 0 && y < height) {
            memcpy(to + i * columns + known->first, planes + (v * height + y) * width + left,
                   (size_t)known->count * sizeof *to);
        }
    }
}

/** Local: what a window gives, to its place. */
static void put(const struct v2v_still *still, float *volume, const struct v2v_core_window *window)
{
    const struct v2v_part *rows = &window->core_rows, *columns = &window->core_columns;
    const int64_t top = rows->first - window->rows.first;
    const int64_t left = columns->first - window->columns.first;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < still->whole->slices.count * rows->count; i++) {
        const int64_t z = i / rows->count, y = i % rows->count;
        memcpy(volume + (z * still->plan.height + rows->first + y) * still->plan.width +
                   columns->first,
               still->volume + (z * window->rows.count + top + y) * window->columns.count + left,
               (size_t)columns->count * sizeof *volume);
    }
}

/** Collective(shard): reconstruct a window and put its core in its place. */
static enum v2v_status fill(struct v2v_still *still, float *volume, const float *views,
                            const struct v2v_core_window *window)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = still->problem.psf;
    struct v2v_averaging averaging;
    const struct v2v_surroundings around = {
        still->light_here, still->seen_here,
        v2v_windows_in_frame(&window->rows, still->plan.height),
        v2v_windows_in_frame(&window->columns, still->plan.width), still->highest};
    V2V_TRY(make_window(still, window->rows.count, window->columns.count));
    v2v_windows_cut(still->light_here, still->light, psf->slices, window, &still->plan);
    v2v_windows_cut(still->seen_here, still->seen, psf->views, window, &still->plan);
    /* beyond the frame, views of the key frame's light */
    memcpy(still->views, still->seen_here,
           (size_t)(psf->views * window->rows.count * window->columns.count) * sizeof(float));
    take_known(still, still->views, views, window, &around.columns);
    if (still->whole->averaging != NULL) {
        averaging = *still->whole->averaging;
        take_known(still, still->frames, averaging.frames, window, &around.columns);
        averaging.frames = still->frames;
        still->window->averaging = &averaging;
    }
    still->window->frame = still->whole->frame;
    still->window->most_iterations = still->iterations;
    still->window->around = &around;
    still->window->ops->inherit(still->window, still->whole);
    rc = still->window->ops->run(still->window, &still->volume, still->views, NULL);
    still->window->around = NULL;
    still->window->averaging = NULL;
    V2V_TRY(rc);
    put(still, volume, window);
done:
    return rc;
}

/** Local: to what windows miss of their views, with a weight. */
static void add_misfit(struct v2v_misfit *sum, const struct v2v_misfit *of, double weight)
{
    sum->missed += weight * of->missed * of->missed;
    sum->coarse += weight * of->coarse * of->coarse;
    sum->noise_of_coarse = of->noise_of_coarse; /* of the whole frame */
}

/** Local: a window by itself may have too few saturated samples to tell, or too many. */
static void find_highest(struct v2v_still *still, const float *views)
{
    const int64_t pixels = still->plan.height * still->plan.width;
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < still->problem.psf->views; v++) {
        still->highest[v] = v2v_saturated_value(views + v * pixels, pixels);
    }
}

enum v2v_status v2v_still_run(struct v2v_still *still, double *part, float *volume,
                              const float *views, const float *recorded)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_estimator *whole = still->whole;
    struct v2v_core_window windows[V2V_WINDOWS_MOST];
    struct v2v_misfit squares = {0};
    double pixels = 0.0;
    whole->misfit = squares;
    rc = v2v_estimator_check_views(whole, views, still->problem.psf->views);
    V2V_TRY(v2v_par_agree(whole->shard, rc));
    const double left = find_changed(still, recorded != NULL ? recorded : views);
    /* one answer for all: ranks on other processors may round another way */
    v2v_par_broadcast(whole->shard, still->changed, still->tiles, 0);
    const int64_t count = v2v_windows_cover(windows, still->changed, &still->plan);
    *part = fmin(v2v_windows_part(windows, count, &still->plan), 1.0);
    v2v_log(V2V_LOG_DEBUG, "frame %lld: %lld windows, %.1f %% of the frame",
            (long long)whole->frame, (long long)count, 100.0 * *part);
    if (*part > most_part) {
        *part = 1.0;
        V2V_TRY(whole->ops->run(whole, &volume, views, NULL));
        goto done;
    }
    still->left = fmax(still->left, left);
    v2v_still_recall(still, volume);
    if (count > 0) {
        whole->ops->measure(whole, views);
        find_highest(still, views);
    }
    for (int64_t i = 0; i < count; i++) {
        const double own = (double)(windows[i].rows.count * windows[i].columns.count);
        V2V_TRY(fill(still, volume, views, &windows[i]));
        add_misfit(&squares, &still->window->misfit, own);
        pixels += own;
    }
    if (*part > telling_part) {
        whole->misfit = (struct v2v_misfit){.missed = sqrt(squares.missed / pixels),
                                            .coarse = sqrt(squares.coarse / pixels),
                                            .noise_of_coarse = squares.noise_of_coarse};
    }
done:
    return rc;
}

double v2v_still_left(const struct v2v_still *still)
{
    return still->left;
}
