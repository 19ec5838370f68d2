#include "method/tv_trials.h"

#include "method/tv.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

#define LEAST_WEIGHT 0.0075
#define WEIGHT_RATIO 1.4142135623730951

/* Parts of the best weight that are tried where the volume has one, and what that is. */
static const double sparse_part[V2V_TV_SPARSE] = {1.0 / 4.0, 1.0 / 16.0}, sparsity = 1.0;

/* Ranks that share a volume of the square at most, two dozen rows each. */
enum { MOST_TOGETHER = 8 };

/* Pixels of the square's side. */
enum { SIDE = 144 };

double v2v_trials_lambda(double index)
{
    return LEAST_WEIGHT * pow(WEIGHT_RATIO, index);
}

int v2v_trials_index(double lambda)
{
    return (int)lround(log(lambda / LEAST_WEIGHT) / log(WEIGHT_RATIO));
}

struct v2v_tv_weights v2v_trials_weights(const struct v2v_trials *trials, int index)
{
    return index < V2V_TV_WEIGHTS
               ? (struct v2v_tv_weights){v2v_trials_lambda(index),
                                         trials->config.deconv.sparsity.value}
               : (struct v2v_tv_weights){trials->best_alone * sparse_part[index - V2V_TV_WEIGHTS],
                                         sparsity};
}

void v2v_trials_forget(struct v2v_trials *trials, int index)
{
    for (int f = 0; f < V2V_TV_FOLDS; f++) {
        trials->missed[f][index] = -1.0;
    }
}

/* Local. */
static enum v2v_status prepare(struct v2v_trials *trials, const struct v2v_problem *problem,
                               const float *views, const struct v2v_averaging *averaging)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_square_views_init(&trials->square, problem, views, averaging, SIDE));
    const int64_t height = trials->square.height, width = trials->square.width;
    trials->config = *problem->config;
    trials->config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, LEAST_WEIGHT};
    trials->problem = (struct v2v_problem){
        .config = &trials->config, .psf = problem->psf, .height = height, .width = width};
    for (int i = 0; i < V2V_TV_TRIED; i++) {
        v2v_trials_forget(trials, i);
    }
    V2V_TRY(V2V_ALLOC(trials->volume, "tv.trials",
                      v2v_mem_product(problem->psf->slices, height, width)));
    V2V_TRY(V2V_ALLOC(trials->predicted, "tv.trials", V2V_LEFT_OUT_MOST * height * width));
    trials->judged =
        V2V_LEFT_OUT_MOST * trials->square.judged.rows.count * trials->square.judged.columns.count;
    V2V_TRY(V2V_ALLOC(trials->samples, "tv.trials",
                      v2v_mem_product(V2V_TV_FOLDS, V2V_TV_TRIED, trials->judged)));
done:
    return rc;
}

/* Collective(world). */
static enum v2v_status share(struct v2v_trials *trials, const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_work work;
    V2V_TRY(v2v_par_agree(world, v2v_estimator_tv.describe_work(&work, &trials->problem)));
    const int most = trials->config.parallel.reproducible ? 1 : MOST_TOGETHER;
    V2V_TRY(v2v_comm_split_host(&trials->comm, world, (int)v2v_smaller(most, work.most_shards)));
    const int rank = v2v_comm_rank(trials->comm);
    trials->groups = (int)v2v_smaller(v2v_comm_size(trials->comm), V2V_TRIALS);
    trials->group = rank % trials->groups;
    V2V_TRY(v2v_comm_split(&trials->sharing, trials->comm, trials->group, rank));
done:
    return rc;
}

enum v2v_status v2v_trials_init(struct v2v_trials *trials, const struct v2v_problem *problem,
                                const float *views, const struct v2v_averaging *averaging,
                                const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    *trials = (struct v2v_trials){0};
    V2V_TRY(v2v_par_agree(world, prepare(trials, problem, views, averaging)));
    V2V_TRY(v2v_par_agree(world, share(trials, world)));
done:
    return rc;
}

void v2v_trials_fini(struct v2v_trials *trials)
{
    for (int f = 0; f < V2V_TV_FOLDS; f++) {
        v2v_left_out_destroy(&trials->fold[f]);
    }
    v2v_comm_destroy(&trials->sharing);
    v2v_comm_destroy(&trials->comm);
    v2v_mem_free(trials->samples);
    v2v_mem_free(trials->predicted);
    v2v_mem_free(trials->volume);
    v2v_square_views_fini(&trials->square);
}

static float *samples_of(const struct v2v_trials *trials, int fold, int index)
{
    return trials->samples + (fold * V2V_TV_TRIED + index) * trials->judged;
}

/* What predictions miss samples of the views left out by. */
static void miss(float *samples, const struct v2v_trials *trials, const struct v2v_left_out *fold)
{
    const int64_t width = trials->square.width, pixels = trials->square.height * width;
    const struct v2v_part rows = trials->square.judged.rows,
                          columns = trials->square.judged.columns;
    for (int64_t i = fold->used; i < fold->views; i++) {
        const float *predicted = trials->predicted + (i - fold->used) * pixels;
        const float *recorded = trials->square.views + fold->view[i] * pixels;
        const float highest = v2v_saturated_value(recorded, pixels);
        for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
            for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
                const int64_t at = y * width + x;
                *samples++ = v2v_rest_of(recorded[at], predicted[at], highest);
            }
        }
    }
}

/* Light of this rank's slices, and its squares. */
static void sum_light(double light[2], const struct v2v_trials *trials, struct v2v_part slices)
{
    const int64_t voxels = slices.count * trials->square.height * trials->square.width;
    light[0] = v2v_sum(trials->volume, voxels);
    light[1] = v2v_sum_of_squares(trials->volume, voxels);
}

/* What a volume misses by, on one rank of the group, and its light, on all of them.
 * Collective(trials->sharing). */
static enum v2v_status run_trial(struct v2v_trials *trials, const struct v2v_trial *trial,
                                 double light[2])
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_tv_weights weights = v2v_trials_weights(trials, trial->index);
    struct v2v_left_out **fold = &trials->fold[trial->fold];
    v2v_watchdog_beat("trying a weight of the total variation");
    if (*fold == NULL) {
        V2V_TRY(v2v_left_out_choose(fold, &v2v_estimator_tv, &trials->problem, trial->fold,
                                    trials->sharing));
    }
    v2v_tv_set_weights((*fold)->estimator, weights.lambda, weights.sparsity);
    (*fold)->estimator->most_iterations = trial->iterations;
    V2V_TRY(v2v_left_out_run(*fold, trials->volume, trials->square.views,
                             v2v_square_averaging(&trials->square)));
    v2v_left_out_predict(*fold, trials->predicted, trials->volume);
    sum_light(light, trials, (*fold)->estimator->slices);
    if (v2v_comm_rank(trials->sharing) == 0) {
        miss(samples_of(trials, trial->fold, trial->index), trials, *fold);
    }
done:
    return rc;
}

enum v2v_status v2v_trials_run(struct v2v_trials *trials, const struct v2v_trial *list, int count)
{
    enum v2v_status rc = V2V_OK;
    const double voxels = (double)v2v_mem_product(trials->problem.psf->slices,
                                                  trials->square.height, trials->square.width);
    double light[V2V_TRIALS][2] = {{0.0}};
    for (int k = 0; k < count && rc == V2V_OK; k++) {
        memset(samples_of(trials, list[k].fold, list[k].index), 0,
               (size_t)trials->judged * sizeof *trials->samples);
        if (list[k].group % trials->groups == trials->group) {
            rc = run_trial(trials, &list[k], light[k]);
        }
    }
    V2V_TRY(v2v_par_agree(trials->comm, rc));
    v2v_par_sum_f64(trials->comm, light[0], 2 * count);
    for (int k = 0; k < count; k++) {
        const int fold = list[k].fold, index = list[k].index;
        float *samples = samples_of(trials, fold, index);
        double squares = 0.0;
        v2v_par_sum_f32(trials->comm, samples, trials->judged); /* of one rank and zeros */
        for (int64_t i = 0; i < trials->judged; i++) {
            squares += (double)samples[i] * (double)samples[i];
        }
        trials->missed[fold][index] = squares;
        trials->filled[fold][index] =
            light[k][1] > 0.0 ? light[k][0] * light[k][0] / (light[k][1] * voxels) : 1.0;
    }
done:
    return rc;
}

enum v2v_status v2v_trials_try(struct v2v_trials *trials, int index, int iterations)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_trial list[V2V_TV_FOLDS];
    int count = 0;
    for (int f = 0; f < V2V_TV_FOLDS; f++) {
        if (trials->missed[f][index] < 0.0) {
            list[count++] = (struct v2v_trial){f, index, f, iterations};
        }
    }
    if (count > 0) {
        V2V_TRY(v2v_trials_run(trials, list, count));
    }
done:
    return rc;
}

double v2v_trials_missed(const struct v2v_trials *trials, int index)
{
    return trials->missed[0][index] + trials->missed[1][index];
}

double v2v_trials_better(const struct v2v_trials *trials, int index, int than, int folds)
{
    double gained = 0.0, variance = 0.0;
    for (int f = 0; f < folds; f++) {
        const float *a = samples_of(trials, f, index), *b = samples_of(trials, f, than);
        for (int64_t i = 0; i < trials->judged; i++) {
            const double missed = (double)a[i], apart = (double)b[i] - missed;
            gained += apart * (apart + 2.0 * missed);
            variance += pow(2.0 * apart * missed, 2.0);
        }
    }
    return variance > 0.0 ? gained / sqrt(variance) : 0.0;
}
