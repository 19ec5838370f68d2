#include "v2v3d/method/calibrate.h"

#include "method/anderson.h"
#include "method/calibrator.h"
#include "method/refinement.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Of total variation, in noise of the views: views that are out of register want much, noisy ones
 * little. */
static const double weights[] = {0.8, 0.2, 0.05};
enum { WEIGHTS = sizeof weights / sizeof *weights };

/* Iterations that tell shifts of pixels, of their hundredths, and the last part of a residual. */
enum { COARSE = 12, FINE = 20, LAST = 24 };

/* Pixels of a side that tell shifts of pixels, and of their hundredths; 0: all there are. */
enum { SMALL = 208, LARGE = 512, WHOLE = 0 };

/* Two views are left out of every volume by which others judge; of those that lead there, a third
 * of the views, which takes less than half of the time. */
enum { ALL_FOLDS = 1 << 30, THIRDS = 3 };

/* Rounds end when no view moves by more, pixels, or less of the residual is gone by one. */
static const double still = 0.03, least_by_round = 1e-3;

/* By all views: rounds at most, what ends them, of a gain and of a shift, and the weight of
 * curvature (tests/bench/views.md). */
enum { REFINING = 6 };
static const double steady_gain = 3e-4, steady_shift = 3e-3, curvature_of_refining = 0.5;

/* From coarse to fine, few parameters to many. */
static const struct stage {
    struct v2v_look look;
    int rounds;            /* at most */
    double least;          /* part of the residual that it takes, or it is undone; 0: it stays .. */
    double least_at_first; /* .. and its first round, or there is no other */
} stages[] = {
    {{SMALL, 4, COARSE, THIRDS, V2V_REGISTER_SHIFT}, 2, 0.0, 0.0},
    {{SMALL, 2, COARSE, THIRDS, V2V_REGISTER_SHIFT}, 2, 0.0, 0.0},
    {{SMALL, 1, FINE, THIRDS, V2V_REGISTER_SHIFT}, 8, 0.0, 0.0},
    {{LARGE, 1, FINE, THIRDS, V2V_REGISTER_SHIFT}, 8, 0.0, 0.0},
    {{LARGE, 1, FINE, THIRDS, V2V_REGISTER_SLOPE}, 3, 0.03, 0.01},
    {{WHOLE, 1, FINE, THIRDS, V2V_REGISTER_SLOPE | V2V_REGISTER_FIELDS}, 8, 0.03, 0.01},
    {{WHOLE, 1, FINE, THIRDS, V2V_REGISTER_SLOPE | V2V_REGISTER_FIELDS | V2V_REGISTER_FINE_FIELDS},
     12,
     0.01,
     0.005},
};
/* Of two, 2 of 2pSAM's, views in register came out shifted by 0.3 to 1.4 pixels, volumes up to 2 dB
 * worse. */
enum { LEAST_VIEWS = 3 };
enum { STAGES = sizeof stages / sizeof *stages, FIRST_FINE = 2 };

static const struct v2v_look judging = {WHOLE, 1, LAST, ALL_FOLDS, V2V_REGISTER_SHIFT};

struct calibration_run {
    struct v2v_calibrator at;
    double (*parallax)[2]; /* [v] */
    struct v2v_anderson *anderson;
    double *from, *to;                 /* all numbers of all views: before and after a step */
    struct v2v_view_calibration *kept; /* [v]: of before, or of the best round so far */
    double (*missed)[2];               /* [v]: of its length; of the deviation of its noise */
    unsigned terms;                    /* that are kept, of method/registration.h */
    int64_t rounds;
    double ahead; /* iterations of the whole frame at most, of what is not begun yet */
};

/** From where the numbers were, `from`, by a step to where they are, mixed with the steps before.
 *  What all views share has been taken out of the step. Collective(comm). */
static void mix(struct calibration_run *self)
{
    struct v2v_calibration *const now = self->at.calibration;
    v2v_registration_to_numbers(self->to, now);
    v2v_anderson_step(self->anderson, self->from, self->to);
    v2v_registration_from_numbers(now, self->from);
    v2v_par_broadcast(self->at.comm, now->view, self->at.count * (int64_t)sizeof *now->view, 0);
    self->rounds++;
}

static int is_optional(const struct stage *stage)
{
    return stage->least > 0.0;
}

/* Iterations at most, of the whole frame: of a stage, of all that follows the stages, of all. */
static double cost_of_stage(const struct calibration_run *self, const struct stage *stage)
{
    return (double)(stage->rounds + is_optional(stage)) *
           v2v_calibrator_cost(&self->at, &stage->look);
}

static double cost_of_weights(const struct calibration_run *self)
{
    return WEIGHTS * v2v_calibrator_cost(&self->at, &stages[FIRST_FINE].look);
}

static double cost_of_end(const struct calibration_run *self)
{
    return 3.0 * v2v_calibrator_cost(&self->at, &judging) +
           (double)(2 * REFINING * v2v_refinement_iterations()) *
               v2v_calibrator_share(&self->at, LARGE);
}

static double cost_of_all(const struct calibration_run *self)
{
    double cost =
        v2v_calibrator_cost(&self->at, &judging) + 2.0 * cost_of_weights(self) + cost_of_end(self);
    for (int s = 0; s < STAGES; s++) {
        cost += cost_of_stage(self, &stages[s]);
    }
    return cost;
}

/** A part begins that takes so much at most; what those before did not take is not ahead. Local. */
static void begin_part(struct calibration_run *self, double cost)
{
    self->at.progress.total = (int64_t)(self->at.done + self->ahead);
    self->ahead -= cost;
}

/** Rounds of a look and a step; of an optional stage, or where a round was in vain, back to where
 *  most was predicted.
 *  @return of an optional one *lowered: the part of the residual that is gone. Collective(comm). */
static enum v2v_status run_stage(struct calibration_run *self, const struct stage *stage,
                                 double *lowered)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibrator *const at = &self->at;
    struct v2v_view_calibration *const now = at->calibration->view;
    const size_t bytes = (size_t)at->count * sizeof *now;
    double moved = INFINITY, first = INFINITY, least = INFINITY;
    int is_lower = 1;
    v2v_anderson_restart(self->anderson);
    memcpy(self->kept, now, bytes);
    for (int r = 0; r <= stage->rounds; r++) {
        const int is_last = r == stage->rounds || (moved <= still && !is_optional(stage));
        if (is_last && !is_optional(stage)) { /* nothing is compared with it */
            break;
        }
        V2V_TRY(v2v_calibrator_look(at, &stage->look));
        is_lower = at->missed <= (1.0 - least_by_round) * least;
        first = r == 0 ? at->missed : first;
        if (at->missed < least) {
            least = at->missed;
            memcpy(self->kept, now, bytes);
        }
        *lowered = 1.0 - least / first;
        if (is_last || !is_lower ||
            (r > 0 && is_optional(stage) && *lowered < stage->least_at_first)) {
            break;
        }
        v2v_registration_to_numbers(self->from, at->calibration);
        moved = v2v_registration_step(at->calibration, at->registration, stage->look.terms,
                                      stage->look.smoothing);
        v2v_registration_fix_modes(at->calibration, self->parallax);
        mix(self);
        v2v_par_broadcast(at->comm, &moved, sizeof moved, 0);
    }
    if (is_optional(stage) || !is_lower) {
        memcpy(now, self->kept, bytes);
    }
done:
    return rc;
}

/* Times what noise takes that is certain. Shifts of views in register take up to 9; fields of views
 * with little noise that have none take up to 17, of 7, 6, 5, 4 views 32, 53, 49, 72: predictions
 * err alike in neighbouring pixels (tests/bench/views.md). */
enum { CERTAIN = 3, CERTAIN_OF_SHIFTS = 10, CERTAIN_OF_COARSE_BY_VIEWS = 500 };

/** Is this part of the residual no more than what so many unknowns of a view take of noise alone?
 *  Each takes one of as many squares as there are pixels, give or take. Local. */
static int is_by_noise(const struct v2v_calibrator *at, double lowered, int unknowns, int certain)
{
    const double left = 1.0 - lowered, pixels = (double)(at->rows.count * at->columns.count);
    return !(1.0 - left * left > (double)(certain * unknowns) / pixels);
}

/** Was a stage worth it, and within the bounds of what a file may say? Local. */
static int is_kept(const struct calibration_run *self, const struct stage *stage, double lowered)
{
    const int unknowns =
        v2v_registration_unknowns(stage->look.terms) - v2v_registration_unknowns(self->terms);
    const int certain = (stage->look.terms & V2V_REGISTER_FINE_FIELDS) != 0
                            ? CERTAIN
                            : CERTAIN + CERTAIN_OF_COARSE_BY_VIEWS / (int)self->at.count;
    return !is_optional(stage) ||
           (lowered >= stage->least && !is_by_noise(&self->at, lowered, unknowns, certain) &&
            v2v_calibration_is_within_bounds(self->at.calibration));
}

/** The stages before `end`, each undone where it was not worth it. Collective(comm). */
static enum v2v_status run_stages(struct calibration_run *self, int first, int end)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_view_calibration *before = NULL, *const now = self->at.calibration->view;
    const size_t bytes = (size_t)self->at.count * sizeof *now;
    V2V_TRY(v2v_par_agree(self->at.comm, V2V_ALLOC(before, "calibrate.before", self->at.count)));
    for (int s = first; s < end; s++) {
        const unsigned terms = stages[s].look.terms;
        double lowered = 0.0;
        begin_part(self, cost_of_stage(self, &stages[s]));
        if ((terms & V2V_REGISTER_FINE_FIELDS) != 0 && (self->terms & V2V_REGISTER_FIELDS) == 0) {
            continue; /* what is coarse was not worth it */
        }
        memcpy(before, now, bytes);
        V2V_TRY(run_stage(self, &stages[s], &lowered));
        if (is_kept(self, &stages[s], lowered)) {
            self->terms |= terms;
        } else {
            memcpy(now, before, bytes);
        }
    }
done:
    v2v_mem_free(before);
    return rc;
}

/** A look at the views as they came. Collective(comm). */
static enum v2v_status look_uncalibrated(struct calibration_run *self, const struct v2v_look *look)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibration nothing = {0}, *const found = self->at.calibration;
    V2V_TRY(v2v_par_agree(
        self->at.comm, v2v_calibration_init(&nothing, found->views, found->height, found->width)));
    self->at.calibration = &nothing;
    rc = v2v_calibrator_look(&self->at, look);
    self->at.calibration = found;
done:
    v2v_calibration_fini(&nothing);
    return rc;
}

/** The weight that predicts best, downhill from the first; of the views as they came, or as
 *  calibrated so far. Collective(comm). */
static enum v2v_status choose_weight(struct calibration_run *self, int is_calibrated, double *best)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_look *look = &stages[FIRST_FINE].look;
    double least = INFINITY;
    begin_part(self, cost_of_weights(self));
    for (int k = 0; k < WEIGHTS; k++) {
        self->at.config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weights[k]};
        V2V_TRY(is_calibrated ? v2v_calibrator_look(&self->at, look)
                              : look_uncalibrated(self, look));
        if (!(self->at.missed < least)) {
            break;
        }
        least = self->at.missed;
        *best = weights[k];
    }
    self->at.config.deconv.lambda.value = *best;
done:
    return rc;
}

/* The largest change of a gain or a shift, of what ends rounds. */
static double moved_by(const struct v2v_view_calibration *now,
                       const struct v2v_view_calibration *before, int64_t views)
{
    double moved = 0.0;
    for (int64_t v = 0; v < views; v++) {
        const double of_gain = fabs(log(now[v].gain / before[v].gain));
        const double down = fabs(now[v].shift[0] - before[v].shift[0]);
        const double right = fabs(now[v].shift[1] - before[v].shift[1]);
        moved = fmax(moved, fmax(of_gain / steady_gain, fmax(down, right) / steady_shift));
    }
    return moved;
}

/** Gains, and shifts where they may change, by a volume of all views. Collective(comm). */
static enum v2v_status refine(struct calibration_run *self, int has_shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibration *const now = self->at.calibration;
    const size_t bytes = (size_t)self->at.count * sizeof *now->view;
    double *const curvature = &self->at.config.deconv.curvature, predicting = *curvature;
    double moved = INFINITY;
    *curvature = curvature_of_refining;
    v2v_calibrator_go(&self->at, LARGE);
    v2v_anderson_restart(self->anderson);
    for (int r = 0; r < REFINING && moved > 1.0; r++) {
        v2v_registration_to_numbers(self->from, self->at.calibration);
        memcpy(self->kept, now->view, bytes);
        V2V_TRY(v2v_refinement_step(&self->at, has_shifts));
        v2v_registration_fix_modes(now, self->parallax);
        moved = moved_by(now->view, self->kept, self->at.count);
        v2v_par_broadcast(self->at.comm, &moved, sizeof moved, 0);
        mix(self);
        v2v_log(V2V_LOG_DEBUG, "by all views: moved by %.3f of what ends rounds", moved);
    }
done:
    *curvature = predicting;
    return rc;
}

/* Times what half of the views are missed by, of their length as well as of their noise: 0.95 to
 * 1.2 as calibrated, also by others than these views' own, 4 of one displaced by 70 pixels, 1.75 of
 * one of eight that shows something else (tests/bench/views.md). */
static const double much_missed = 1.5;

/** Which view do the others predict worse than most, if one at all? Local. */
static void find_odd(const struct calibration_run *self, struct v2v_calibration_report *report)
{
    const struct v2v_calibrator *at = &self->at;
    double(*const missed)[2] = self->missed;
    report->odd_view = -1;
    for (int64_t v = 0; v < at->count; v++) {
        const struct v2v_missed *in_frame = &at->registration[v].in_frame;
        const double noise = v2v_noise_of_images(at->scratch, at->recorded + v * at->pixels, 1,
                                                 at->height, at->width);
        missed[v][0] = sqrt(in_frame->squares / in_frame->of);
        missed[v][1] = sqrt(in_frame->squares / in_frame->seen) / noise;
    }
    for (int64_t v = 0; v < at->count; v++) {
        int64_t better = 0;
        for (int64_t o = 0; o < at->count; o++) {
            better += missed[v][0] > much_missed * missed[o][0] &&
                      missed[v][1] > much_missed * missed[o][1];
        }
        if (2 * better > at->count &&
            (report->odd_view < 0 || missed[v][0] > missed[report->odd_view][0])) {
            report->odd_view = v;
        }
    }
}

/** Collective(comm). */
static enum v2v_status judge(struct calibration_run *self, struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_calibrator_look(&self->at, &judging));
    report->frame_after = self->at.missed;
    report->heldout_after = self->at.missed_in_square;
    find_odd(self, report);
done:
    return rc;
}

/** Where views are predicted hardly better than as they came, they stay so. Local. */
static void undo_in_vain(struct calibration_run *self, struct v2v_calibration_report *report)
{
    struct v2v_calibration *const found = self->at.calibration;
    const double lowered = 1.0 - report->frame_after / report->frame_before;
    if (!is_by_noise(&self->at, lowered, v2v_registration_unknowns(self->terms), CERTAIN)) {
        return;
    }
    self->terms = 0;
    for (int64_t v = 0; v < found->views; v++) {
        found->view[v] = (struct v2v_view_calibration){.gain = 1.0};
    }
    report->frame_after = report->frame_before;
    report->heldout_after = report->heldout_before;
    report->is_gains_alone = 0;
    report->is_in_vain = 1;
}

/** Where views are predicted hardly better than by their gains alone, these are found once more
 *  and nothing else is kept. Unlike gains lower the residual by much, and would vouch for shifts
 *  that noise made. Collective(comm). */
static enum v2v_status undo_shifts_in_vain(struct calibration_run *self,
                                           struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibration *const now = self->at.calibration;
    const size_t bytes = (size_t)now->views * sizeof *now->view;
    const struct v2v_calibration_report of_all = *report;
    const int unknowns = v2v_registration_unknowns(self->terms) - 1; /* all but the gain */
    if (self->terms != V2V_REGISTER_SHIFT) {
        return V2V_OK; /* what is more was worth it, or nothing was */
    }
    memcpy(self->kept, now->view, bytes);
    for (int64_t v = 0; v < now->views; v++) {
        now->view[v] = (struct v2v_view_calibration){.gain = now->view[v].gain};
    }
    V2V_TRY(judge(self, report));
    if (is_by_noise(&self->at, 1.0 - of_all.frame_after / report->frame_after, unknowns,
                    CERTAIN_OF_SHIFTS)) {
        report->is_gains_alone = 1;
        V2V_TRY(refine(self, 0));
        V2V_TRY(judge(self, report));
        undo_in_vain(self, report);
    } else {
        memcpy(now->view, self->kept, bytes);
        *report = of_all;
    }
done:
    return rc;
}

/** Views as they came, by the weight that suits them, then by those that are found.
 *  Collective(comm). */
static enum v2v_status find(struct calibration_run *self, struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibrator *const at = &self->at;
    double weight = weights[0];
    V2V_TRY(choose_weight(self, 0, &weight));
    begin_part(self, v2v_calibrator_cost(at, &judging));
    V2V_TRY(look_uncalibrated(self, &judging));
    report->frame_before = at->missed;
    report->heldout_before = at->missed_in_square;
    if (!(at->missed > 0.0 && isfinite(at->missed))) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "the frame is dark, or too bright for float32: there is "
                                      "nothing to calibrate by"));
    }
    at->config.deconv.lambda.value = weights[0];
    V2V_TRY(run_stages(self, 0, FIRST_FINE));
    V2V_TRY(choose_weight(self, 1, &report->weight));
    V2V_TRY(run_stages(self, FIRST_FINE, STAGES));
    begin_part(self, cost_of_end(self));
    V2V_TRY(refine(self, 1));
    V2V_TRY(judge(self, report));
    undo_in_vain(self, report);
    V2V_TRY(undo_shifts_in_vain(self, report));
    report->rounds = self->rounds;
    report->has_slopes = (self->terms & V2V_REGISTER_SLOPE) != 0;
    report->has_fields = (self->terms & V2V_REGISTER_FIELDS) != 0;
done:
    return rc;
}

/** Collective(comm). */
static enum v2v_status begin(struct calibration_run *self)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibrator *const at = &self->at;
    const struct v2v_psf_file *psf = at->problem->psf;
    const int64_t numbers = psf->views * V2V_REGISTER_NUMBERS;
    V2V_TRY(v2v_calibrator_init(at));
    at->config.deconv.stop = V2V_STOP_FIXED;
    at->config.deconv.curvature = 0.0; /* predicts no better here: tests/bench/views.md */
    at->config.deconv.sparsity = (struct v2v_number){.mode = V2V_NUMBER_GIVEN};
    at->config.recon.neighbours = 0;                    /* of one frame */
    at->config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN; /* a volume's errors are no photons' */
    at->config.deconv.electrons_per_count.mode = V2V_NUMBER_AUTO;
    at->config.deconv.read_noise.mode = V2V_NUMBER_AUTO;
    V2V_TRY(
        v2v_calibration_init(at->calibration, psf->views, at->problem->height, at->problem->width));
    for (int64_t v = 0; v < psf->views; v++) {
        at->calibration->number[v] = v2v_kept_views_number(at->config.input.without_views, v);
    }
    V2V_TRY(V2V_ALLOC(self->parallax, "calibrate.parallax", psf->views));
    V2V_TRY(v2v_anderson_create(&self->anderson, numbers));
    V2V_TRY(V2V_ALLOC(self->from, "calibrate.numbers", numbers));
    V2V_TRY(V2V_ALLOC(self->to, "calibrate.numbers", numbers));
    V2V_TRY(V2V_ALLOC(self->kept, "calibrate.kept", psf->views));
    V2V_TRY(V2V_ALLOC(self->missed, "calibrate.missed", psf->views));
    v2v_psf_parallax(self->parallax, psf);
done:
    return v2v_par_agree(at->comm, rc);
}

static void end(struct calibration_run *self)
{
    v2v_mem_free(self->missed);
    v2v_mem_free(self->kept);
    v2v_mem_free(self->to);
    v2v_mem_free(self->from);
    v2v_anderson_destroy(&self->anderson);
    v2v_mem_free(self->parallax);
    v2v_calibrator_fini(&self->at);
}

/* A view that shows nothing has no shift, and any gain; a frame of them alone is told later. */
static enum v2v_status check_views(const struct v2v_problem *problem, const float *views)
{
    const int64_t pixels = problem->height * problem->width, count = problem->psf->views;
    int64_t flat = 0, first = -1;
    for (int64_t v = 0; v < count; v++) {
        if (v2v_is_of_one_value(views + v * pixels, pixels)) {
            flat++;
            first = first < 0 ? v : first;
        }
    }
    if (flat > 0 && flat < count) {
        return V2V_FAIL(
            V2V_E_INPUT,
            "view %lld has one value everywhere: it cannot be calibrated; without it "
            "(--without-views) others can",
            (long long)v2v_kept_views_number(problem->config->input.without_views, first));
    }
    return V2V_OK;
}

enum v2v_status v2v_calibrate(struct v2v_calibration *calibration,
                              struct v2v_calibration_report *report,
                              const struct v2v_problem *problem, const float *views,
                              const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct calibration_run self = {
        .at = {.problem = problem, .comm = comm, .views = views, .calibration = calibration}};
    *report = (struct v2v_calibration_report){0};
    *calibration = (struct v2v_calibration){0};
    v2v_stop_heed_ending();
    if (problem->psf->views < LEAST_VIEWS) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%lld views: one that is predicted by one other at most seems out of "
                        "register where it is in it; three or more can be calibrated",
                        (long long)problem->psf->views);
    }
    V2V_TRY(check_views(problem, views));
    V2V_TRY(begin(&self));
    report->square_rows = self.at.busiest.rows;
    report->square_columns = self.at.busiest.columns;
    self.ahead = cost_of_all(&self);
    v2v_progress_begin(&self.at.progress, "calibrating, steps at most", 0, (int64_t)self.ahead);
    V2V_TRY(find(&self, report));
done:
    v2v_progress_end(&self.at.progress);
    end(&self);
    if (rc != V2V_OK) {
        v2v_calibration_fini(calibration);
    }
    return rc;
}
