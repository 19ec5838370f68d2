#include "method/tv_lambda.h"

#include "method/square.h"
#include "method/tv.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/method/left_out.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Weights that may be tried, 0.0075 to 1.92 of sigma; downhill from 0.03, or from HALF below what
 * noise says. */
enum { WEIGHTS = 17, MIDDLE = 4, HALF = 2 };
#define LEAST_WEIGHT 0.0075
#define WEIGHT_RATIO 1.4142135623730951

enum { FOLDS = V2V_LEFT_OUT_CHOICES };

/* Ranks that share a volume of the square at most, two dozen rows each. */
enum { MOST_TOGETHER = 8 };

/* Pixels of the square's side. */
enum { SIDE = 144 };

/* Fewer favour large weights, whose volumes come sooner; but half of them show whether half of a
 * weight may predict better: of 82 drawn recordings, those below two deviations then come to less
 * than three, and those that come to five have four (tests/bench/quality.md). */
enum { ITERATIONS = 30, EARLY_ITERATIONS = 16 };
static const double may_be_better = 2.0;

/* Points of light whose noise is below this part of the brightness come so late that large weights
 * would be favoured for good (tests/bench/quality.md). */
enum { ITERATIONS_OF_POINTS = 100 };
static const double clear_noise = 0.0125;

/* Of the weight that predicts best, which volumes of all views take: most of 18 simulated
 * recordings are nearest to their truth below it (tests/bench/quality.md). */
#define OF_ALL_VIEWS 0.92

/* Where views are missed by no more than noise: the weight by noise of a tenth of the brightness,
 * and the power of the noise that it goes by; of normal noise, and of photons, of which there is
 * little in the dark to be held down; times the root of how much of it a voxel sees, which is no
 * less than usual of one view, of which nothing tells the depth (tests/bench/quality.md). */
static const struct usual {
    double weight, power;
} of_normal_noise = {0.03, 0.15}, of_photons = {0.0275, 0.4};
static const double usual_noise = 0.1, least_noise = 0.002;

/* Nothing is smoothed along z there, and light has no other slice to go to. */
static const double of_one_slice = 2.0;

/* Views missed by so many times their noise are missed by more than noise, which shows early:
 * after two iterations 16 recordings in register are missed by 0.982 to 1.028, after six by 0.981
 * to 0.991, four out of register by 1.34 and more all along. */
static const double noise_alone = 1.05;
enum { FIRST_LOOK = 6 };

/* Noise does not tell the weight of points and lines of light: what views left out say is taken
 * below the first part of what noise says; where a voxel sees so many times the usual noise (PSFs
 * of few slices, sharp ones), below the second, since extended scenes lose similarity by more
 * (tests/bench/quality.md). */
static const double taken_below = 0.6, much_seen = 3.0, taken_below_if_sharp = 0.2;

/* And above this part of it, where a voxel sees so many times the usual noise: of few slices beside
 * many views the noise tells too little (tests/bench/quality.md). */
static const double taken_above = 1.2, enough_seen = 2.5;

/* And where they are sure of it: deviations of noise by which one choice of views, and both, are
 * predicted better; fewer are chance where views or slices are few or the square is small. Two of
 * three views say what is not so, surely (tests/bench/quality.md). */
static const double sure_of_one = 5.0, sure_of_all = 6.0;
enum { FEWEST_ASKED = 4 };

/* Points of light want next to no variation and a weight of the volume itself instead. Tried with
 * parts of the variation's weight that views left out want, in as many iterations as that takes,
 * and taken where they predict better by so many deviations; both parts, unless the volume's light
 * would fit into less than this part of its voxels (tests/bench/quality.md). */
static const double sparse_part[] = {1.0 / 4.0, 1.0 / 16.0}, sparsity = 1.0, sure_of_sparse = 2.0,
                    filled_by_points = 0.025;
enum {
    SPARSE = sizeof sparse_part / sizeof sparse_part[0],
    TRIED = WEIGHTS + SPARSE, /* without a weight of the volume, then with it */
    SPARSE_ITERATIONS = 100
};

struct chooser {
    struct v2v_square_views square;
    double seen;      /* v2v_tv_noise_seen */
    double noise;     /* part of the brightness; 0: not measured */
    float *volume;    /* [z,height,width] */
    float *predicted; /* [left out,height,width] */
    int iterations;   /* of a trial */
    struct v2v_config config;
    struct v2v_problem problem; /* of the square */
    struct v2v_comm *comm;      /* of the ranks that share the work .. */
    struct v2v_comm *sharing;   /* .. and those of them that share a volume of views left out */
    int groups, group;          /* of ranks that share volumes, and this rank's */
    struct v2v_left_out *fold[FOLDS];
    double best_alone;           /* weight, without sparsity; of it parts are tried with it */
    double missed[FOLDS][TRIED]; /* sums of the squares; < 0: not tried */
    double filled[FOLDS][TRIED]; /* part of the voxels that hold the light, if each has the same */
    int64_t judged;              /* samples of the views that a fold leaves out */
    float *samples; /* [fold,weight,judged]: by how much they are missed; 0 where not tried */
};

static float *samples_of(const struct chooser *self, int fold, int index)
{
    return self->samples + (fold * TRIED + index) * self->judged;
}

/* What predictions miss samples of the views left out by. */
static void miss(float *samples, const struct chooser *self, const struct v2v_left_out *fold)
{
    const int64_t width = self->square.width, pixels = self->square.height * width;
    const struct v2v_part rows = self->square.judged.rows, columns = self->square.judged.columns;
    for (int64_t i = fold->used; i < fold->views; i++) {
        const float *predicted = self->predicted + (i - fold->used) * pixels;
        const float *recorded = self->square.views + fold->view[i] * pixels;
        const float highest = v2v_saturated_value(recorded, pixels);
        for (int64_t y = rows.first; y < rows.first + rows.count; y++) {
            for (int64_t x = columns.first; x < columns.first + columns.count; x++) {
                const int64_t at = y * width + x;
                *samples++ = v2v_rest_of(recorded[at], predicted[at], highest);
            }
        }
    }
}

static double weight_of(double index)
{
    return LEAST_WEIGHT * pow(WEIGHT_RATIO, index);
}

/* Of the nearest one, whether or not it may be tried. */
static int index_of(double weight)
{
    return (int)lround(log(weight / LEAST_WEIGHT) / log(WEIGHT_RATIO));
}

struct weights {
    double lambda, sparsity;
};

/* A volume without the views of a fold, by a weight; by which group, as far as there are groups. */
struct trial {
    int fold, index, group, iterations;
};
enum { TRIALS = FOLDS }; /* at once */

static void set_weights(struct v2v_estimator *estimator, const struct chooser *self, int index)
{
    if (index < WEIGHTS) {
        v2v_tv_set_weights(estimator, weight_of(index), self->config.deconv.sparsity.value);
    } else {
        v2v_tv_set_weights(estimator, self->best_alone * sparse_part[index - WEIGHTS], sparsity);
    }
}

/* Light of this rank's slices, and its squares. */
static void sum_light(double light[2], const struct chooser *self, struct v2v_part slices)
{
    const int64_t voxels = slices.count * self->square.height * self->square.width;
    light[0] = v2v_sum(self->volume, voxels);
    light[1] = v2v_sum_of_squares(self->volume, voxels);
}

/* What a volume misses by, on one rank of the group, and its light, on all of them.
 * Collective(self->sharing). */
static enum v2v_status run_trial(struct chooser *self, const struct trial *trial, double light[2])
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out **fold = &self->fold[trial->fold];
    v2v_watchdog_beat("trying a weight of the total variation");
    if (*fold == NULL) {
        V2V_TRY(v2v_left_out_choose(fold, &v2v_estimator_tv, &self->problem, trial->fold,
                                    self->sharing));
    }
    set_weights((*fold)->estimator, self, trial->index);
    (*fold)->estimator->most_iterations = trial->iterations;
    V2V_TRY(v2v_left_out_run(*fold, self->volume, self->square.views,
                             v2v_square_averaging(&self->square)));
    v2v_left_out_predict(*fold, self->predicted, self->volume);
    sum_light(light, self, (*fold)->estimator->slices);
    if (v2v_comm_rank(self->sharing) == 0) {
        miss(samples_of(self, trial->fold, trial->index), self, *fold);
    }
done:
    return rc;
}

/* Each by its group; missed on all ranks. Collective(self->comm). */
static enum v2v_status run_trials(struct chooser *self, const struct trial *trials, int count)
{
    enum v2v_status rc = V2V_OK;
    const double voxels =
        (double)v2v_mem_product(self->problem.psf->slices, self->square.height, self->square.width);
    double light[TRIALS][2] = {{0.0}};
    for (int k = 0; k < count && rc == V2V_OK; k++) {
        memset(samples_of(self, trials[k].fold, trials[k].index), 0,
               (size_t)self->judged * sizeof *self->samples);
        if (trials[k].group % self->groups == self->group) {
            rc = run_trial(self, &trials[k], light[k]);
        }
    }
    V2V_TRY(v2v_par_agree(self->comm, rc));
    v2v_par_sum_f64(self->comm, light[0], 2 * count);
    for (int k = 0; k < count; k++) {
        const int fold = trials[k].fold, index = trials[k].index;
        float *samples = samples_of(self, fold, index);
        double squares = 0.0;
        v2v_par_sum_f32(self->comm, samples, self->judged); /* of one rank and zeros */
        for (int64_t i = 0; i < self->judged; i++) {
            squares += (double)samples[i] * (double)samples[i];
        }
        self->missed[fold][index] = squares;
        self->filled[fold][index] =
            light[k][1] > 0.0 ? light[k][0] * light[k][0] / (light[k][1] * voxels) : 1.0;
    }
done:
    return rc;
}

/* Both folds by a weight, unless they are known. Collective(self->comm). */
static enum v2v_status try_weight(struct chooser *self, int index)
{
    enum v2v_status rc = V2V_OK;
    const int iterations = index < WEIGHTS ? self->iterations : SPARSE_ITERATIONS;
    struct trial trials[FOLDS];
    int count = 0;
    for (int f = 0; f < FOLDS; f++) {
        if (self->missed[f][index] < 0.0) {
            trials[count++] = (struct trial){f, index, f, iterations};
        }
    }
    if (count > 0) {
        V2V_TRY(run_trials(self, trials, count));
    }
done:
    return rc;
}

static double missed_by(const struct chooser *self, int index)
{
    return self->missed[0][index] + self->missed[1][index];
}

/* By how many deviations a weight predicts the first folds better than another. What it misses
 * samples by is their noise, each its own, which scatters the difference of squares. */
static double better_by(const struct chooser *self, int index, int than, int folds)
{
    double gained = 0.0, variance = 0.0;
    for (int f = 0; f < folds; f++) {
        const float *a = samples_of(self, f, index), *b = samples_of(self, f, than);
        for (int64_t i = 0; i < self->judged; i++) {
            const double missed = (double)a[i], apart = (double)b[i] - missed;
            gained += apart * (apart + 2.0 * missed);
            variance += pow(2.0 * apart * missed, 2.0);
        }
    }
    return variance > 0.0 ? gained / sqrt(variance) : 0.0;
}

/* Downhill to a weight that neither neighbour is better than. */
static enum v2v_status descend(struct chooser *self, int start, int *best)
{
    enum v2v_status rc = V2V_OK;
    int here = start, last = -1;
    V2V_TRY(try_weight(self, here));
    while (here != last) {
        last = here;
        for (int next = last - 1; next <= last + 1; next += 2) {
            if (next >= 0 && next < WEIGHTS) {
                V2V_TRY(try_weight(self, next));
                here = missed_by(self, next) < missed_by(self, here) ? next : here;
            }
        }
    }
    *best = here;
done:
    return rc;
}

/* The least of a parabola through the best weight and its neighbours, on a logarithmic scale. */
static double between(const struct chooser *self, int best)
{
    if (best == 0 || best == WEIGHTS - 1) {
        return weight_of(best);
    }
    const double before = missed_by(self, best - 1) - missed_by(self, best);
    const double behind = missed_by(self, best + 1) - missed_by(self, best);
    return weight_of(best +
                     (before + behind > 0.0 ? 0.5 * (before - behind) / (before + behind) : 0.0));
}

/* All weights predict the same: dark volumes. */
static int tells_nothing(const struct chooser *self, int best)
{
    return best > 0 && best < WEIGHTS - 1 && missed_by(self, best - 1) == missed_by(self, best) &&
           missed_by(self, best + 1) == missed_by(self, best);
}

/** Local. */
static enum v2v_status prepare(struct chooser *self, const struct v2v_problem *problem,
                               const float *views, const struct v2v_averaging *averaging)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_square_views_init(&self->square, problem, views, averaging, SIDE));
    const int64_t height = self->square.height, width = self->square.width;
    self->seen = v2v_tv_noise_seen(problem->psf);
    self->iterations = ITERATIONS;
    self->config = *problem->config;
    self->config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, LEAST_WEIGHT};
    self->config.deconv.iterations = ITERATIONS;
    self->problem = (struct v2v_problem){
        .config = &self->config, .psf = problem->psf, .height = height, .width = width};
    for (int i = 0; i < TRIED; i++) {
        self->missed[0][i] = self->missed[1][i] = -1.0;
    }
    V2V_TRY(
        V2V_ALLOC(self->volume, "tv.lambda", v2v_mem_product(problem->psf->slices, height, width)));
    V2V_TRY(V2V_ALLOC(self->predicted, "tv.lambda", V2V_LEFT_OUT_MOST * height * width));
    self->judged =
        V2V_LEFT_OUT_MOST * self->square.judged.rows.count * self->square.judged.columns.count;
    V2V_TRY(V2V_ALLOC(self->samples, "tv.lambda", v2v_mem_product(FOLDS, TRIED, self->judged)));
done:
    return rc;
}

/* The weight for noise such as was measured; `fallback` for dark views. */
static double usual_weight(const struct v2v_estimator *estimator, const struct chooser *self,
                           double fallback)
{
    const struct v2v_tv_noise noise = v2v_tv_noise(estimator);
    const struct usual *usual = noise.gain > 0.0 ? &of_photons : &of_normal_noise;
    const double times = fmax(noise.part, least_noise) / usual_noise;
    const double seen = fmax(self->seen, self->problem.psf->views > 1 ? 0.0 : 1.0);
    const double slices = self->problem.psf->slices == 1 ? of_one_slice : 1.0;
    const double weight = usual->weight * pow(times, usual->power) * sqrt(seen) * slices;
    return noise.part > 0.0 ? weight : fallback;
}

static int is_noise_alone(void *context, int64_t iteration, const struct v2v_iterate *iterate)
{
    (void)context;
    return iteration >= FIRST_LOOK && iterate->estimator->misfit.missed <= noise_alone;
}

/* What a volume of all views misses them by, of their noise, by the weight that this noise wants;
 * of dark views *weight stays. */
static enum v2v_status miss_all(double *missed, double *weight, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_estimator *estimator = NULL;
    const struct v2v_monitor monitor = {is_noise_alone, NULL};
    v2v_watchdog_beat("what total variation misses");
    V2V_TRY(v2v_estimator_create(&estimator, &v2v_estimator_tv, &self->problem, self->comm));
    estimator->averaging = v2v_square_averaging(&self->square);
    estimator->ops->measure(estimator, self->square.views);
    estimator->ops->inherit(estimator, estimator); /* so that the run does not look again */
    *weight = usual_weight(estimator, self, *weight);
    self->noise = v2v_tv_noise(estimator).part;
    v2v_tv_set_weights(estimator, *weight, self->config.deconv.sparsity.value);
    V2V_TRY(estimator->ops->run(estimator, &self->volume, self->square.views, &monitor));
    *missed = estimator->misfit.missed;
done:
    v2v_estimator_destroy(&estimator);
    return rc;
}

/* A weight of the volume, where it predicts better than the best one of the variation alone.
 * Collective(self->comm). */
static enum v2v_status choose_sparse(struct weights *chosen, struct chooser *self, int best)
{
    enum v2v_status rc = V2V_OK;
    const struct trial trials[SPARSE] = {{0, WEIGHTS, 0, SPARSE_ITERATIONS},
                                         {0, WEIGHTS + 1, 1, SPARSE_ITERATIONS}};
    if (self->config.deconv.sparsity.mode == V2V_NUMBER_GIVEN) {
        return V2V_OK;
    }
    self->best_alone = weight_of(best);
    V2V_TRY(run_trials(self, trials, SPARSE));
    const double better[SPARSE] = {better_by(self, WEIGHTS, best, 1),
                                   better_by(self, WEIGHTS + 1, best, 1)};
    const int part = self->missed[0][WEIGHTS + 1] < self->missed[0][WEIGHTS];
    const int sparse = WEIGHTS + part, is_of_points = self->filled[0][best] < filled_by_points;
    v2v_log(V2V_LOG_DEBUG,
            "sparsity: views left out are predicted better by %.1f, %.1f deviations, %.2g filled",
            better[0], better[1], self->filled[0][best]);
    if ((is_of_points ? better[part] : fmin(better[0], better[1])) > sure_of_sparse) {
        V2V_TRY(try_weight(self, sparse));
        if (better_by(self, sparse, best, FOLDS) > sure_of_sparse) {
            *chosen = (struct weights){self->best_alone * sparse_part[sparse - WEIGHTS], sparsity};
        }
    }
done:
    return rc;
}

/* The first fold by two weights. Collective(self->comm). */
static enum v2v_status try_two(struct chooser *self, int index, int other, int iterations)
{
    const struct trial trials[TRIALS] = {{0, index, 0, iterations}, {0, other, 1, iterations}};
    return run_trials(self, trials, TRIALS);
}

/* Points of light in little noise, by a weight that was tried? */
static int is_of_clear_points(const struct chooser *self, int index)
{
    return self->noise > 0.0 && self->noise < clear_noise &&
           self->filled[0][index] < filled_by_points;
}

/* Whether half of a weight may predict one fold better; of a few iterations at first.
 * Collective(self->comm). */
static enum v2v_status try_half(int *is_likely, struct chooser *self, int index, int half)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(try_two(self, index, half, EARLY_ITERATIONS));
    const int is_clear = is_of_clear_points(self, half);
    self->iterations = is_clear ? ITERATIONS_OF_POINTS : ITERATIONS;
    *is_likely = is_clear || better_by(self, half, index, 1) >= may_be_better;
    if (*is_likely) {
        V2V_TRY(try_two(self, index, half, self->iterations));
    } else { /* of too few iterations to be compared with others */
        self->missed[0][index] = self->missed[0][half] = -1.0;
    }
done:
    return rc;
}

/* Where half of a weight surely predicts one fold better, the weight may be far less.
 * Collective(self->comm). */
static enum v2v_status choose_less(struct weights *chosen, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const int index = index_of(chosen->lambda);
    const int half = (int)v2v_larger(index - HALF, 0);
    int is_likely = 0;
    if (half >= index || index >= WEIGHTS) {
        return V2V_OK;
    }
    V2V_TRY(try_half(&is_likely, self, index, half));
    if (is_likely && better_by(self, half, index, 1) > sure_of_one) {
        int best = half;
        V2V_TRY(descend(self, half, &best));
        V2V_TRY(try_weight(self, index));
        if (better_by(self, best, index, FOLDS) > sure_of_all) {
            chosen->lambda = OF_ALL_VIEWS * between(self, best);
        }
        V2V_TRY(choose_sparse(chosen, self, best));
    }
done:
    return rc;
}

/* Uphill from the weight that noise says. Collective(self->comm). */
static enum v2v_status choose_more(struct weights *chosen, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const int index = index_of(chosen->lambda);
    int best = index;
    if (index < 0 || index >= WEIGHTS - 1) {
        return V2V_OK;
    }
    V2V_TRY(try_weight(self, index));
    for (int next = index + 1; next < WEIGHTS && best == next - 1; next++) {
        V2V_TRY(try_weight(self, next));
        best = missed_by(self, next) < missed_by(self, best) ? next : best;
    }
    if (best > index) {
        chosen->lambda = OF_ALL_VIEWS * between(self, best);
    }
done:
    return rc;
}

/** Collective(world): a square is too small to be sent from host to host. */
static enum v2v_status share(struct chooser *self, const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grid_work work;
    V2V_TRY(v2v_par_agree(world, v2v_estimator_tv.describe_work(&work, &self->problem)));
    const int most = self->config.parallel.reproducible ? 1 : MOST_TOGETHER;
    V2V_TRY(v2v_comm_split_host(&self->comm, world, (int)v2v_smaller(most, work.most_shards)));
    const int rank = v2v_comm_rank(self->comm);
    self->groups = (int)v2v_smaller(v2v_comm_size(self->comm), TRIALS);
    self->group = rank % self->groups;
    V2V_TRY(v2v_comm_split(&self->sharing, self->comm, self->group, rank));
done:
    return rc;
}

/* Local. */
static void take(struct v2v_deconv_settings *deconv, const struct weights *chosen, const char *why)
{
    char also[32] = "";
    if (chosen->sparsity > 0.0) {
        snprintf(also, sizeof also, " and sparsity %.3g", chosen->sparsity);
    }
    deconv->lambda.value = chosen->lambda;
    deconv->sparsity.value = chosen->sparsity;
    v2v_log(V2V_LOG_INFO, "lambda %.3g%s, by views left out of a frame%s", chosen->lambda, also,
            why);
}

/** Views left out are to say. Collective(self->comm). */
static enum v2v_status ask(struct v2v_deconv_settings *deconv, struct chooser *self,
                           const char *why)
{
    enum v2v_status rc = V2V_OK;
    int best = MIDDLE;
    struct weights chosen = {0.0, deconv->sparsity.value};
    V2V_TRY(try_weight(self, MIDDLE));
    if (is_of_clear_points(self, MIDDLE)) {
        self->iterations = ITERATIONS_OF_POINTS;
        self->missed[0][MIDDLE] = self->missed[1][MIDDLE] = -1.0; /* anew */
    }
    V2V_TRY(descend(self, MIDDLE, &best));
    chosen.lambda = OF_ALL_VIEWS * between(self, best);
    const int may_be_sparse =
        deconv->lambda.mode == V2V_NUMBER_AUTO || self->filled[0][best] < filled_by_points;
    if (may_be_sparse && best <= MIDDLE - HALF) {
        V2V_TRY(choose_sparse(&chosen, self, best));
    }
    if (tells_nothing(self, best)) {
        v2v_log(V2V_LOG_INFO, "the frame has no light to choose lambda by");
    }
    take(deconv, &chosen, why);
done:
    return rc;
}

/** What they say, where it is more than noise says. Collective(self->comm). */
static enum v2v_status ask_for_more(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    struct weights chosen = {deconv->lambda.value, deconv->sparsity.value};
    V2V_TRY(choose_more(&chosen, self));
    if (chosen.lambda > taken_above * deconv->lambda.value) {
        take(deconv, &chosen, ", which want more than noise does");
    }
done:
    return rc;
}

/** What they say, where it is far less than noise says. Collective(self->comm). */
static enum v2v_status ask_for_less(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const double part = self->seen > much_seen ? taken_below_if_sharp : taken_below;
    struct weights chosen = {deconv->lambda.value, deconv->sparsity.value};
    V2V_TRY(choose_less(&chosen, self));
    if (chosen.lambda < part * deconv->lambda.value) {
        take(deconv, &chosen, ", which want less than noise does");
    } else if (self->seen > enough_seen && chosen.lambda >= deconv->lambda.value) {
        V2V_TRY(ask_for_more(deconv, self));
    }
done:
    return rc;
}

/** Collective(self->comm). */
static enum v2v_status settle(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_number *lambda = &deconv->lambda;
    const int are_enough = self->problem.psf->views > FOLDS; /* to leave some out */
    double missed = 0.0;
    V2V_TRY(miss_all(&missed, &lambda->value, self));
    v2v_log(V2V_LOG_DEBUG, "lambda %.3g by the noise; views are missed by %.3g of it",
            lambda->value, missed);
    if (lambda->mode == V2V_NUMBER_AUTO) {
        V2V_TRY(ask(deconv, self, ""));
    } else if (are_enough && missed > noise_alone) {
        V2V_TRY(ask(deconv, self, ", since volumes miss more of the views than noise"));
    } else if (self->problem.psf->views >= FEWEST_ASKED && missed > 0.0) {
        V2V_TRY(ask_for_less(deconv, self));
    }
    lambda->mode = deconv->sparsity.mode = V2V_NUMBER_GIVEN;
done:
    return rc;
}

enum v2v_status v2v_tv_settle_weights(struct v2v_deconv_settings *deconv,
                                      const struct v2v_problem *problem, const float *views,
                                      const struct v2v_averaging *averaging,
                                      const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct chooser *self = NULL;
    const struct v2v_number *lambda = &deconv->lambda;
    if (lambda->mode == V2V_NUMBER_GIVEN) {
        return V2V_OK;
    }
    if (problem->psf->views <= FOLDS && lambda->mode == V2V_NUMBER_AUTO) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "--lambda auto leaves views out: it needs %d or more, not %lld", FOLDS + 1,
                        (long long)problem->psf->views);
    }
    V2V_TRY(v2v_par_agree(world, V2V_ALLOC(self, "tv.lambda", 1)));
    V2V_TRY(v2v_par_agree(world, prepare(self, problem, views, averaging)));
    V2V_TRY(v2v_par_agree(world, share(self, world)));
    V2V_TRY(v2v_par_agree(world, settle(deconv, self)));
done:
    if (self != NULL) {
        for (int64_t fold = 0; fold < FOLDS; fold++) {
            v2v_left_out_destroy(&self->fold[fold]);
        }
        v2v_comm_destroy(&self->sharing);
        v2v_comm_destroy(&self->comm);
        v2v_mem_free(self->samples);
        v2v_mem_free(self->predicted);
        v2v_mem_free(self->volume);
        v2v_square_views_fini(&self->square);
        v2v_mem_free(self);
    }
    return rc;
}
