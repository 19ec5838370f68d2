#include "v2v3d/method/calibrate.h"

#include "method/anderson.h"
#include "method/photons.h"
#include "method/registration.h"
#include "method/square.h"
#include "method/tv.h"
#include "v2v3d/base/field.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/left_out.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>
#include <string.h>

/* Of total variation, in noise of the views: views that are out of register want much, noisy ones
 * little. */
static const double weights[] = {0.8, 0.2, 0.05};
enum { WEIGHTS = sizeof weights / sizeof *weights };
/* Iterations that tell shifts of pixels, of their hundredths, and the last part of a residual; and
 * after which the volume stands still. */
enum { COARSE = 12, FINE = 20, LAST = 40, SETTLED = 60 };

/* Pixels of the judged square's side. */
enum { SIDE = 160 };

/* What is not lowered by so much is not worth its parameters. */
static const double least_lowered = 0.03;

/* Rounds end when no view moves by more, pixels. */
static const double still = 0.03;

/* Gains from all views: rounds, and what ends them: the largest change of a logarithm. */
enum { GAIN_ROUNDS = 6 };
static const double steady = 1e-3;

/* Of the noise that is added to predictions. */
enum { SEED = 1 };

/* From coarse to fine, few parameters to many. */
static const struct stage {
    unsigned terms; /* of method/registration.h */
    int smoothing;  /* pixels */
    int iterations; /* of total variation */
    int rounds;     /* at most */
    int is_optional;
} stages[] = {
    {V2V_REGISTER_SHIFT, 4, COARSE, 2, 0},
    {V2V_REGISTER_SHIFT, 2, COARSE, 2, 0},
    {V2V_REGISTER_SHIFT, 1, FINE, 8, 0},
    {V2V_REGISTER_SHIFT | V2V_REGISTER_SLOPE, 1, LAST, 3, 1},
    {V2V_REGISTER_SHIFT | V2V_REGISTER_SLOPE | V2V_REGISTER_FIELDS, 1, LAST, 4, 1},
};
enum { STAGES = sizeof stages / sizeof *stages, FIRST_FINE = 2 };

struct calibrator {
    const struct v2v_problem *problem;
    const struct v2v_comm *comm;
    const float *views;
    int64_t count, pixels; /* views; pixels of one */
    struct v2v_config config;
    struct v2v_psf_file psf; /* as calibrated so far */
    float *undistorted;      /* [v,y,x] */
    float *volume, *deep;    /* [slices of this rank,y,x]; the latter weighted by depth */
    float *predicted[2];     /* [v,y,x] of either */
    float *scratch;          /* [y,x] */
    double (*parallax)[2];   /* [v] */
    struct v2v_registration *registration; /* [v] */
    struct v2v_registration_images images;
    struct v2v_calibration *calibration;
    struct v2v_anderson *anderson;
    double *gain, *bias;           /* [v]: logarithms: of a step, and what tv has of it by itself */
    double *at, *to;               /* all numbers of all views: before and after a step */
    struct v2v_part rows, columns; /* judged: the frame but for its margin */
    struct v2v_square busiest;
    double frame, square; /* residuals of the last look */
};

/** Local. */
static enum v2v_status take_memory(struct calibrator *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = self->problem->psf;
    const int64_t slices = v2v_mem_product(psf->slices, self->pixels, 1);
    V2V_TRY(v2v_calibration_init(self->calibration, self->count, self->problem->height,
                                 self->problem->width));
    V2V_TRY(V2V_ALLOC(self->undistorted, "calibrate.views",
                      v2v_mem_product(self->count, self->pixels, 1)));
    V2V_TRY(V2V_ALLOC(self->volume, "calibrate.volume", slices));
    V2V_TRY(V2V_ALLOC(self->deep, "calibrate.volume", slices));
    for (int i = 0; i < 2; i++) {
        V2V_TRY(V2V_ALLOC(self->predicted[i], "calibrate.predicted",
                          v2v_mem_product(self->count, self->pixels, 1)));
    }
    V2V_TRY(V2V_ALLOC(self->scratch, "calibrate.scratch", self->pixels));
    V2V_TRY(V2V_ALLOC(self->parallax, "calibrate.parallax", self->count));
    V2V_TRY(v2v_anderson_create(&self->anderson, self->count * V2V_REGISTER_NUMBERS));
    V2V_TRY(V2V_ALLOC(self->at, "calibrate.numbers", self->count * V2V_REGISTER_NUMBERS));
    V2V_TRY(V2V_ALLOC(self->to, "calibrate.numbers", self->count * V2V_REGISTER_NUMBERS));
    V2V_TRY(V2V_ALLOC(self->gain, "calibrate.numbers", self->count));
    V2V_TRY(V2V_ALLOC(self->bias, "calibrate.numbers", self->count));
    V2V_TRY(V2V_ALLOC(self->registration, "calibrate.equations", self->count));
    V2V_TRY(
        v2v_registration_images_init(&self->images, self->problem->height, self->problem->width));
done:
    return rc;
}

static void release_memory(struct calibrator *self)
{
    v2v_registration_images_fini(&self->images);
    v2v_mem_free(self->bias);
    v2v_mem_free(self->gain);
    v2v_mem_free(self->to);
    v2v_mem_free(self->at);
    v2v_anderson_destroy(&self->anderson);
    v2v_mem_free(self->registration);
    v2v_mem_free(self->parallax);
    v2v_mem_free(self->scratch);
    v2v_mem_free(self->predicted[1]);
    v2v_mem_free(self->predicted[0]);
    v2v_mem_free(self->deep);
    v2v_mem_free(self->volume);
    v2v_mem_free(self->undistorted);
    v2v_psf_file_fini(&self->psf);
}

/** Local: PSFs and views as the calibration has them so far. */
static enum v2v_status apply(struct calibrator *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = self->problem->psf;
    const int64_t samples = v2v_mem_product(psf->views * psf->slices, psf->height, psf->width);
    v2v_psf_file_fini(&self->psf);
    self->psf = *psf;
    self->psf.data = NULL;
    V2V_TRY(V2V_ALLOC(self->psf.data, "calibrate.psf", samples));
    memcpy(self->psf.data, psf->data, (size_t)samples * sizeof *psf->data);
    V2V_TRY(v2v_calibration_apply_to_psf(&self->psf, self->calibration));
    v2v_calibration_undistort(self->undistorted, self->views, self->calibration);
done:
    return rc;
}

/* volume * depth, -1 .. 1. */
static void weight_by_depth(const struct calibrator *self, struct v2v_part slices)
{
    for (int64_t z = 0; z < slices.count; z++) {
        const float depth = (float)v2v_line_place(slices.first + z, self->problem->psf->slices);
        for (int64_t i = 0; i < self->pixels; i++) {
            self->deep[z * self->pixels + i] = depth * self->volume[z * self->pixels + i];
        }
    }
}

/** Of some views, as calibrated so far. Collective(comm). */
static enum v2v_status leave_out(struct calibrator *self, struct v2v_left_out **left_out,
                                 struct v2v_left_out_views without, int iterations)
{
    struct v2v_problem problem = *self->problem;
    self->config.deconv.iterations = iterations;
    problem.config = &self->config;
    problem.psf = &self->psf;
    return v2v_left_out_create(left_out, &v2v_estimator_tv, &problem, without, 1, self->comm);
}

/* Predictions of a fold, from the volume of the other views, against what was recorded.
 * Collective(comm). */
static enum v2v_status look_at_fold(struct calibrator *self, int64_t fold,
                                    const struct stage *stage)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *left_out = NULL;
    v2v_watchdog_beat("calibrate: views left out");
    V2V_TRY(leave_out(self, &left_out, v2v_left_out_fold(self->count, fold), stage->iterations));
    V2V_TRY(v2v_left_out_run(left_out, self->volume, self->undistorted));
    weight_by_depth(self, left_out->estimator->slices);
    v2v_left_out_predict(left_out, self->predicted[0], self->volume);
    v2v_left_out_predict(left_out, self->predicted[1], self->deep);
    for (int64_t i = 0; i < self->count - left_out->used; i++) {
        const int32_t v = left_out->view[left_out->used + i];
        const struct v2v_view_calibration *view = &self->calibration->view[v];
        float *prediction[2];
        for (int k = 0; k < 2; k++) {
            prediction[k] = self->predicted[k] + i * self->pixels;
            v2v_calibration_distort_view(prediction[k], self->scratch, view, self->problem->height,
                                         self->problem->width);
        }
        v2v_registration_compare(&self->registration[v], &self->images,
                                 self->views + v * self->pixels, prediction[0], prediction[1],
                                 stage->smoothing, self->rows, self->columns);
        self->registration[v].in_square = v2v_registration_missed(
            self->views + v * self->pixels, prediction[0], self->problem->width, self->busiest.rows,
            self->busiest.columns);
    }
done:
    v2v_left_out_destroy(&left_out);
    return rc;
}

/* Every view predicted from others: residuals, and the equations that the next step solves.
 * Collective(comm). */
static enum v2v_status look(struct calibrator *self, const struct stage *stage)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_missed frame = {0.0, 0.0}, square = {0.0, 0.0};
    V2V_TRY(v2v_par_agree(self->comm, apply(self)));
    for (int64_t fold = 0; fold < v2v_left_out_folds(self->count); fold++) {
        V2V_TRY(look_at_fold(self, fold, stage));
    }
    for (int64_t v = 0; v < self->count; v++) {
        frame.squares += self->registration[v].in_frame.squares;
        frame.of += self->registration[v].in_frame.of;
        square.squares += self->registration[v].in_square.squares;
        square.of += self->registration[v].in_square.of;
    }
    self->frame = frame.of > 0.0 ? sqrt(frame.squares / frame.of) : 0.0;
    self->square = square.of > 0.0 ? sqrt(square.squares / square.of) : 0.0;
    /* what decides the rounds is the same everywhere: other processors may round another way */
    v2v_par_broadcast(self->comm, &self->frame, sizeof self->frame, 0);
    v2v_log(V2V_LOG_DEBUG, "views left out are missed by %.4f, in the square by %.4f", self->frame,
            self->square);
done:
    return rc;
}

/** From where the numbers were, `self->at`, by a step to where they are, mixed with the steps
 *  before; what all views share is taken out. Collective(comm). */
static void mix(struct calibrator *self)
{
    struct v2v_calibration *const now = self->calibration;
    v2v_registration_fix_modes(now, self->parallax);
    v2v_registration_to_numbers(self->to, now);
    v2v_anderson_step(self->anderson, self->at, self->to);
    v2v_registration_from_numbers(now, self->at);
    v2v_par_broadcast(self->comm, now->view, self->count * (int64_t)sizeof *now->view, 0);
}

/** Steps of a stage; each ends with a look, the last one for the next stage. Collective(comm). */
static enum v2v_status run_stage(struct calibrator *self, const struct stage *stage,
                                 int64_t *rounds)
{
    enum v2v_status rc = V2V_OK;
    const struct stage *const next = stage + (stage < &stages[STAGES - 1]);
    double moved = INFINITY;
    v2v_anderson_restart(self->anderson);
    for (int r = 1; r <= stage->rounds && moved > still; r++) {
        v2v_registration_to_numbers(self->at, self->calibration);
        moved = v2v_registration_step(self->calibration, self->registration, stage->terms,
                                      stage->smoothing);
        mix(self);
        v2v_par_broadcast(self->comm, &moved, sizeof moved, 0);
        const int is_last = r == stage->rounds || moved <= still;
        V2V_TRY(look(self, is_last ? next : stage));
        ++*rounds;
    }
done:
    return rc;
}

/** The weight that predicts best, downhill from the first, with which the last look was; another
 *  with the best is the last one then. Collective(comm). */
static enum v2v_status choose_weight(struct calibrator *self, const struct stage *stage)
{
    enum v2v_status rc = V2V_OK;
    double *const lambda = &self->config.deconv.lambda.value, best = self->frame;
    for (int k = 1; k < WEIGHTS; k++) {
        *lambda = weights[k];
        V2V_TRY(look(self, stage));
        if (self->frame >= best) {
            *lambda = weights[k - 1];
            V2V_TRY(look(self, stage));
            break;
        }
        best = self->frame;
    }
done:
    return rc;
}

/** The stages before `end`, an optional one undone where it was not worth it. Collective(comm). */
static enum v2v_status run_stages(struct calibrator *self, struct v2v_calibration_report *report,
                                  int first, int end)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_view_calibration *before = NULL, *const now = self->calibration->view;
    const size_t bytes = (size_t)self->count * sizeof *now;
    V2V_TRY(v2v_par_agree(self->comm, V2V_ALLOC(before, "calibrate.before", self->count)));
    for (int s = first; s < end; s++) {
        const double frame = self->frame, square = self->square;
        memcpy(before, now, bytes);
        V2V_TRY(run_stage(self, &stages[s], &report->rounds));
        if (stages[s].is_optional && self->frame > (1.0 - least_lowered) * frame) {
            memcpy(now, before, bytes);
            self->frame = frame;
            self->square = square;
            if (s + 1 < end) {
                V2V_TRY(look(self, &stages[s + 1]));
            }
            continue;
        }
        report->has_slopes |= (stages[s].terms & V2V_REGISTER_SLOPE) != 0;
        report->has_fields |= (stages[s].terms & V2V_REGISTER_FIELDS) != 0;
    }
done:
    v2v_mem_free(before);
    return rc;
}

/** Residuals of the views as they came, at the weight under way. Collective(comm). */
static enum v2v_status look_uncalibrated(struct calibrator *self,
                                         struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_calibration nothing = {0}, *const found = self->calibration;
    V2V_TRY(v2v_par_agree(
        self->comm, v2v_calibration_init(&nothing, found->views, found->height, found->width)));
    self->calibration = &nothing;
    rc = look(self, &stages[STAGES - 1]);
    self->calibration = found;
    V2V_TRY(rc);
    if (self->frame < report->frame_before) {
        report->frame_before = self->frame;
        report->heldout_before = self->square;
    }
done:
    v2v_calibration_fini(&nothing);
    return rc;
}

/** Logarithms of how bright the views `seen` are by what the volume of `views` shows: `predicted`.
 *  Collective(comm). */
static enum v2v_status show(struct calibrator *self, struct v2v_left_out *all, double *brightness,
                            float *predicted, const float *views, const float *seen)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_left_out_run(all, self->volume, views));
    v2v_left_out_predict(all, predicted, self->volume);
    for (int64_t v = 0; v < self->count; v++) {
        const int64_t at = v * self->pixels;
        brightness[v] = log(v2v_registration_brightness(
            seen + at, predicted + at, self->problem->width, self->rows, self->columns));
    }
done:
    return rc;
}

/* to = from + noise, all views */
static void add_noise(const struct calibrator *self, float *to, const float *from, double noise)
{
    for (int64_t i = 0; i < self->count * self->pixels; i++) {
        to[i] = from[i] + (float)(noise * v2v_random_normal(SEED, 0, (uint64_t)i));
    }
}

/* Gains by the step less its bias; returns the largest change of a logarithm. */
static double take_gains(struct calibrator *self)
{
    double *const gain = self->gain;
    double mean = 0.0, moved = 0.0;
    for (int64_t v = 0; v < self->count; v++) {
        gain[v] = fmin(fmax(gain[v] - self->bias[v], -log(2.0)), log(2.0));
        mean += gain[v] / (double)self->count;
    }
    for (int64_t v = 0; v < self->count; v++) {
        self->calibration->view[v].gain *= exp(gain[v] - mean);
        moved = fmax(moved, fabs(gain[v] - mean));
    }
    return moved;
}

/** Gains by how the volume of all views shows them, less how the volume of what that shows, with
 *  noise, shows it in turn. @return *moved: the largest change of a logarithm. Collective(comm). */
static enum v2v_status step_of_gains(struct calibrator *self, double *moved)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *all = NULL;
    float *const views = self->undistorted, *const predicted = self->predicted[0];
    v2v_watchdog_beat("calibrate: gains by all views");
    V2V_TRY(v2v_par_agree(self->comm, apply(self)));
    V2V_TRY(leave_out(self, &all, (struct v2v_left_out_views){0}, SETTLED));
    V2V_TRY(show(self, all, self->gain, predicted, views, views));
    add_noise(self, views, predicted, v2v_tv_noise(all->estimator).deviation);
    V2V_TRY(show(self, all, self->bias, self->predicted[1], views, predicted));
    *moved = take_gains(self);
done:
    v2v_left_out_destroy(&all);
    return rc;
}

/** They end with a look. Collective(comm). */
static enum v2v_status find_gains(struct calibrator *self, int64_t *rounds)
{
    enum v2v_status rc = V2V_OK;
    double moved = INFINITY;
    v2v_anderson_restart(self->anderson);
    for (int r = 0; r < GAIN_ROUNDS && moved > steady; r++) {
        v2v_registration_to_numbers(self->at, self->calibration);
        V2V_TRY(step_of_gains(self, &moved));
        mix(self);
        v2v_par_broadcast(self->comm, &moved, sizeof moved, 0);
        ++*rounds;
        v2v_log(V2V_LOG_DEBUG, "gains by all views: moved by %.4f", moved);
    }
    V2V_TRY(look(self, &stages[STAGES - 1]));
done:
    return rc;
}

static enum v2v_status find(struct calibrator *self, struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    report->frame_before = INFINITY;
    self->config.deconv.lambda = (struct v2v_number){V2V_NUMBER_GIVEN, weights[0]};
    V2V_TRY(look_uncalibrated(self, report));
    if (!(report->frame_before > 0.0 && isfinite(report->frame_before))) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "the frame is dark, or too bright for float32: there is "
                                      "nothing to calibrate by"));
    }
    V2V_TRY(look(self, &stages[0]));
    V2V_TRY(run_stages(self, report, 0, FIRST_FINE));
    V2V_TRY(choose_weight(self, &stages[FIRST_FINE]));
    V2V_TRY(run_stages(self, report, FIRST_FINE, STAGES));
    V2V_TRY(find_gains(self, &report->rounds));
    report->weight = self->config.deconv.lambda.value;
    report->frame_after = self->frame;
    report->heldout_after = self->square;
    if (report->weight < weights[0]) {
        V2V_TRY(look_uncalibrated(self, report));
    }
done:
    return rc;
}

enum v2v_status v2v_calibrate(struct v2v_calibration *calibration,
                              struct v2v_calibration_report *report,
                              const struct v2v_problem *problem, const float *views,
                              const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = problem->psf;
    struct calibrator self = {.problem = problem,
                              .comm = comm,
                              .views = views,
                              .count = psf->views,
                              .pixels = problem->height * problem->width,
                              .config = *problem->config,
                              .calibration = calibration};
    *report = (struct v2v_calibration_report){0};
    *calibration = (struct v2v_calibration){0};
    if (psf->views < 2) {
        return V2V_FAIL(V2V_E_INPUT, "one view alone: there is no other to predict it");
    }
    V2V_TRY(v2v_camera_check(problem));
    self.config.deconv.stop = V2V_STOP_FIXED;
    self.config.deconv.noise = V2V_NOISE_MODEL_GAUSSIAN; /* a volume's errors are no photons' */
    self.config.deconv.electrons_per_count.mode = V2V_NUMBER_AUTO;
    self.config.deconv.read_noise.mode = V2V_NUMBER_AUTO;
    self.rows = v2v_registration_judged(problem->height);
    self.columns = v2v_registration_judged(problem->width);
    V2V_TRY(v2v_par_agree(comm, take_memory(&self)));
    v2v_psf_parallax(self.parallax, psf);
    self.busiest = v2v_square_find(views, problem->width, self.rows, self.columns, SIDE);
    report->square_rows = self.busiest.rows;
    report->square_columns = self.busiest.columns;
    V2V_TRY(find(&self, report));
done:
    release_memory(&self);
    if (rc != V2V_OK) {
        v2v_calibration_fini(calibration);
    }
    return rc;
}
