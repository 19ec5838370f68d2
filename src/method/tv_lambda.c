#include "method/tv_lambda.h"

#include "method/tv.h"
#include "method/tv_trials.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>
#include <stdio.h>

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
static const double sure_of_sparse = 2.0, filled_by_points = 0.025;
enum { SPARSE_ITERATIONS = 100 };

/* Downhill from here, 0.03, or from HALF below what noise says. */
enum { MIDDLE = 4, HALF = 2 };

enum { FOLDS = V2V_TV_FOLDS, WEIGHTS = V2V_TV_WEIGHTS, SPARSE = V2V_TV_SPARSE };

struct chooser {
    struct v2v_trials trials;
    double seen;    /* v2v_tv_noise_seen */
    double noise;   /* part of the brightness; 0: not measured */
    int iterations; /* of a trial without a weight of the volume */
};

/* Collective(self->trials.comm). */
static enum v2v_status try_weight(struct chooser *self, int index)
{
    return v2v_trials_try(&self->trials, index, self->iterations);
}

static double missed_by(const struct chooser *self, int index)
{
    return v2v_trials_missed(&self->trials, index);
}

static double better_by(const struct chooser *self, int index, int than, int folds)
{
    return v2v_trials_better(&self->trials, index, than, folds);
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
        return v2v_trials_lambda(best);
    }
    const double before = missed_by(self, best - 1) - missed_by(self, best);
    const double behind = missed_by(self, best + 1) - missed_by(self, best);
    return v2v_trials_lambda(
        best + (before + behind > 0.0 ? 0.5 * (before - behind) / (before + behind) : 0.0));
}

/* All weights predict the same: dark volumes. */
static int tells_nothing(const struct chooser *self, int best)
{
    return best > 0 && best < WEIGHTS - 1 && missed_by(self, best - 1) == missed_by(self, best) &&
           missed_by(self, best + 1) == missed_by(self, best);
}

/* The weight for noise such as was measured; `fallback` for dark views. */
static double usual_weight(const struct v2v_estimator *estimator, const struct chooser *self,
                           double fallback)
{
    const struct v2v_tv_noise noise = v2v_tv_noise(estimator);
    const struct usual *usual = noise.gain > 0.0 ? &of_photons : &of_normal_noise;
    const double times = fmax(noise.part, least_noise) / usual_noise;
    const double seen = fmax(self->seen, self->trials.problem.psf->views > 1 ? 0.0 : 1.0);
    const double slices = self->trials.problem.psf->slices == 1 ? of_one_slice : 1.0;
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
    V2V_TRY(v2v_estimator_create(&estimator, &v2v_estimator_tv, &self->trials.problem,
                                 self->trials.comm));
    estimator->averaging = v2v_square_averaging(&self->trials.square);
    estimator->ops->measure(estimator, self->trials.square.views);
    estimator->ops->inherit(estimator, estimator); /* so that the run does not look again */
    *weight = usual_weight(estimator, self, *weight);
    self->noise = v2v_tv_noise(estimator).part;
    v2v_tv_set_weights(estimator, *weight, self->trials.config.deconv.sparsity.value);
    V2V_TRY(
        estimator->ops->run(estimator, &self->trials.volume, self->trials.square.views, &monitor));
    *missed = estimator->misfit.missed;
done:
    v2v_estimator_destroy(&estimator);
    return rc;
}

/* A weight of the volume, where it predicts better than the best one of the variation alone.
 * Collective(self->trials.comm). */
static enum v2v_status choose_sparse(struct v2v_tv_weights *chosen, struct chooser *self, int best)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_trial list[SPARSE] = {{0, WEIGHTS, 0, SPARSE_ITERATIONS},
                                           {0, WEIGHTS + 1, 1, SPARSE_ITERATIONS}};
    if (self->trials.config.deconv.sparsity.mode == V2V_NUMBER_GIVEN) {
        return V2V_OK;
    }
    self->trials.best_alone = v2v_trials_lambda(best);
    V2V_TRY(v2v_trials_run(&self->trials, list, SPARSE));
    const double better[SPARSE] = {better_by(self, WEIGHTS, best, 1),
                                   better_by(self, WEIGHTS + 1, best, 1)};
    const int part = self->trials.missed[0][WEIGHTS + 1] < self->trials.missed[0][WEIGHTS];
    const int sparse = WEIGHTS + part,
              is_of_points = self->trials.filled[0][best] < filled_by_points;
    v2v_log(V2V_LOG_DEBUG,
            "sparsity: views left out are predicted better by %.1f, %.1f deviations, %.2g filled",
            better[0], better[1], self->trials.filled[0][best]);
    if ((is_of_points ? better[part] : fmin(better[0], better[1])) > sure_of_sparse) {
        V2V_TRY(v2v_trials_try(&self->trials, sparse, SPARSE_ITERATIONS));
        if (better_by(self, sparse, best, FOLDS) > sure_of_sparse) {
            *chosen = v2v_trials_weights(&self->trials, sparse);
        }
    }
done:
    return rc;
}

/* The first fold by two weights. Collective(self->trials.comm). */
static enum v2v_status try_two(struct chooser *self, int index, int other, int iterations)
{
    const struct v2v_trial list[V2V_TRIALS] = {{0, index, 0, iterations},
                                               {0, other, 1, iterations}};
    return v2v_trials_run(&self->trials, list, V2V_TRIALS);
}

/* Points of light in little noise, by a weight that was tried? */
static int is_of_clear_points(const struct chooser *self, int index)
{
    return self->noise > 0.0 && self->noise < clear_noise &&
           self->trials.filled[0][index] < filled_by_points;
}

/* Whether half of a weight may predict one fold better; of a few iterations at first.
 * Collective(self->trials.comm). */
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
        v2v_trials_forget(&self->trials, index);
        v2v_trials_forget(&self->trials, half);
    }
done:
    return rc;
}

/* Where half of a weight surely predicts one fold better, the weight may be far less.
 * Collective(self->trials.comm). */
static enum v2v_status choose_less(struct v2v_tv_weights *chosen, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const int index = v2v_trials_index(chosen->lambda);
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

/* Uphill from the weight that noise says. Collective(self->trials.comm). */
static enum v2v_status choose_more(struct v2v_tv_weights *chosen, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const int index = v2v_trials_index(chosen->lambda);
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

/* Local. */
static void take(struct v2v_deconv_settings *deconv, const struct v2v_tv_weights *chosen,
                 const char *why)
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

/** Views left out are to say. Collective(self->trials.comm). */
static enum v2v_status ask(struct v2v_deconv_settings *deconv, struct chooser *self,
                           const char *why)
{
    enum v2v_status rc = V2V_OK;
    int best = MIDDLE;
    struct v2v_tv_weights chosen = {0.0, deconv->sparsity.value};
    V2V_TRY(try_weight(self, MIDDLE));
    if (is_of_clear_points(self, MIDDLE)) {
        self->iterations = ITERATIONS_OF_POINTS;
        v2v_trials_forget(&self->trials, MIDDLE); /* anew */
    }
    V2V_TRY(descend(self, MIDDLE, &best));
    chosen.lambda = OF_ALL_VIEWS * between(self, best);
    const int may_be_sparse =
        deconv->lambda.mode == V2V_NUMBER_AUTO || self->trials.filled[0][best] < filled_by_points;
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

/** What they say, where it is more than noise says. Collective(self->trials.comm). */
static enum v2v_status ask_for_more(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tv_weights chosen = {deconv->lambda.value, deconv->sparsity.value};
    V2V_TRY(choose_more(&chosen, self));
    if (chosen.lambda > taken_above * deconv->lambda.value) {
        take(deconv, &chosen, ", which want more than noise does");
    }
done:
    return rc;
}

/** What they say, where it is far less than noise says. Collective(self->trials.comm). */
static enum v2v_status ask_for_less(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    const double part = self->seen > much_seen ? taken_below_if_sharp : taken_below;
    struct v2v_tv_weights chosen = {deconv->lambda.value, deconv->sparsity.value};
    V2V_TRY(choose_less(&chosen, self));
    if (chosen.lambda < part * deconv->lambda.value) {
        take(deconv, &chosen, ", which want less than noise does");
    } else if (self->seen > enough_seen && chosen.lambda >= deconv->lambda.value) {
        V2V_TRY(ask_for_more(deconv, self));
    }
done:
    return rc;
}

/** Collective(self->trials.comm). */
static enum v2v_status settle(struct v2v_deconv_settings *deconv, struct chooser *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_number *lambda = &deconv->lambda;
    const int are_enough = self->trials.problem.psf->views > FOLDS; /* to leave some out */
    double missed = 0.0;
    V2V_TRY(miss_all(&missed, &lambda->value, self));
    v2v_log(V2V_LOG_DEBUG, "lambda %.3g by the noise; views are missed by %.3g of it",
            lambda->value, missed);
    if (lambda->mode == V2V_NUMBER_AUTO) {
        V2V_TRY(ask(deconv, self, ""));
    } else if (are_enough && missed > noise_alone) {
        V2V_TRY(ask(deconv, self, ", since volumes miss more of the views than noise"));
    } else if (self->trials.problem.psf->views >= FEWEST_ASKED && missed > 0.0) {
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
    self->seen = v2v_tv_noise_seen(problem->psf);
    self->iterations = ITERATIONS;
    V2V_TRY(v2v_trials_init(&self->trials, problem, views, averaging, world));
    self->trials.config.deconv.iterations = ITERATIONS;
    V2V_TRY(v2v_par_agree(world, settle(deconv, self)));
done:
    if (self != NULL) {
        v2v_trials_fini(&self->trials);
        v2v_mem_free(self);
    }
    return rc;
}
