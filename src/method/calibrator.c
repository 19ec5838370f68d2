#include "method/calibrator.h"

#include "method/tv.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/field.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>
#include <string.h>

/* Pixels of the judged square's side. */
enum { SIDE = 160 };

static int is_frame(const struct v2v_calibrator *self)
{
    return self->place.rows.count == self->frame.rows.count &&
           self->place.columns.count == self->frame.columns.count;
}

/** Local. */
static enum v2v_status take_memory(struct v2v_calibrator *self)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = self->problem->height * self->problem->width;
    const int64_t views = v2v_mem_product(self->count, pixels, 1);
    const int64_t slices = v2v_mem_product(self->problem->psf->slices, pixels, 1);
    V2V_TRY(V2V_ALLOC(self->recorded, "calibrate.views", views));
    V2V_TRY(V2V_ALLOC(self->undistorted, "calibrate.views", views));
    V2V_TRY(V2V_ALLOC(self->volume, "calibrate.volume", slices));
    V2V_TRY(V2V_ALLOC(self->deep, "calibrate.volume", slices));
    for (int i = 0; i < 2; i++) {
        V2V_TRY(V2V_ALLOC(self->predicted[i], "calibrate.predicted", views));
    }
    V2V_TRY(V2V_ALLOC(self->scratch, "calibrate.scratch", pixels));
    V2V_TRY(V2V_ALLOC(self->registration, "calibrate.equations", self->count));
    V2V_TRY(
        v2v_registration_images_init(&self->images, self->problem->height, self->problem->width));
done:
    return rc;
}

enum v2v_status v2v_calibrator_init(struct v2v_calibrator *self)
{
    const struct v2v_problem *problem = self->problem;
    self->count = problem->psf->views;
    self->config = *problem->config;
    self->side = -1;
    self->frame = (struct v2v_square){{0, problem->height}, {0, problem->width}};
    self->busiest =
        v2v_square_find(self->views, problem->width, v2v_registration_judged(problem->height),
                        v2v_registration_judged(problem->width), SIDE);
    return v2v_par_agree(self->comm, take_memory(self));
}

void v2v_calibrator_fini(struct v2v_calibrator *self)
{
    v2v_registration_images_fini(&self->images);
    v2v_mem_free(self->registration);
    v2v_mem_free(self->scratch);
    v2v_mem_free(self->predicted[1]);
    v2v_mem_free(self->predicted[0]);
    v2v_mem_free(self->deep);
    v2v_mem_free(self->volume);
    v2v_mem_free(self->undistorted);
    v2v_mem_free(self->recorded);
    v2v_psf_file_fini(&self->psf);
}

/* A part of a side with its margin. */
static struct v2v_part with_margin(struct v2v_part part, int64_t side)
{
    const int64_t margin = v2v_field_margin(side);
    return (struct v2v_part){part.first - margin, part.count + 2 * margin};
}

static struct v2v_square place_of(const struct v2v_calibrator *self, int64_t side)
{
    const int64_t height = self->frame.rows.count, width = self->frame.columns.count;
    if (side == 0 || (side >= height && side >= width)) {
        return self->frame;
    }
    const struct v2v_square judged =
        v2v_square_find(self->views, width, v2v_registration_judged(height),
                        v2v_registration_judged(width), side - 2 * V2V_FIELD_MARGIN);
    return (struct v2v_square){with_margin(judged.rows, height),
                               with_margin(judged.columns, width)};
}

void v2v_calibrator_go(struct v2v_calibrator *self, int64_t side)
{
    const int64_t height = self->frame.rows.count, width = self->frame.columns.count;
    if (side == self->side) {
        return;
    }
    self->side = side;
    self->place = place_of(self, side);
    self->height = self->images.height = self->place.rows.count;
    self->width = self->images.width = self->place.columns.count;
    self->pixels = self->height * self->width;
    self->rows = v2v_registration_judged(self->height);
    self->columns = v2v_registration_judged(self->width);
    v2v_square_cut(&self->place, self->recorded, self->views, self->count, height, width);
}

enum v2v_status v2v_calibrator_apply(struct v2v_calibrator *self)
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
    v2v_calibration_undistort(self->predicted[0], self->views, self->predicted[1],
                              self->calibration);
    v2v_square_cut(&self->place, self->undistorted, self->predicted[0], self->count,
                   self->frame.rows.count, self->frame.columns.count);
done:
    return v2v_par_agree(self->comm, rc);
}

/* volume * depth, -1 .. 1. */
static void weight_by_depth(const struct v2v_calibrator *self, struct v2v_part slices)
{
    for (int64_t z = 0; z < slices.count; z++) {
        const float depth = (float)v2v_line_place(slices.first + z, self->problem->psf->slices);
        for (int64_t i = 0; i < self->pixels; i++) {
            self->deep[z * self->pixels + i] = depth * self->volume[z * self->pixels + i];
        }
    }
}

enum v2v_status v2v_calibrator_leave_out(struct v2v_calibrator *self,
                                         struct v2v_left_out **left_out,
                                         struct v2v_left_out_views without, int iterations)
{
    struct v2v_problem problem = *self->problem;
    self->config.deconv.iterations = iterations;
    problem.config = &self->config;
    problem.psf = &self->psf;
    problem.height = self->height;
    problem.width = self->width;
    return v2v_left_out_create(left_out, &v2v_estimator_tv, &problem, without, 1, self->comm);
}

/* A view beside its prediction, and that of the volume weighted by depth. */
static void compare(struct v2v_calibrator *self, int32_t v, float *prediction[2],
                    const struct v2v_look *look)
{
    const float *recorded = self->recorded + v * self->pixels;
    struct v2v_registration *registration = &self->registration[v];
    /* fields are fitted to the frame, after all looks at parts of it */
    for (int k = 0; k < 2 && is_frame(self); k++) {
        v2v_calibration_distort_view(prediction[k], self->scratch, &self->calibration->view[v],
                                     self->height, self->width);
    }
    v2v_registration_compare(registration, &self->images, recorded, prediction[0], prediction[1],
                             look->terms, look->smoothing, self->rows, self->columns);
    if (is_frame(self)) {
        registration->in_square = v2v_registration_missed(
            recorded, prediction[0], self->width, self->busiest.rows, self->busiest.columns);
    }
}

/* Predictions of a fold, from the volume of the other views, against what was recorded.
 * Collective(comm). */
static enum v2v_status look_at_fold(struct v2v_calibrator *self, struct v2v_left_out_views fold,
                                    const struct v2v_look *look)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *left_out = NULL;
    v2v_watchdog_beat("calibrate: views left out");
    V2V_TRY(v2v_calibrator_leave_out(self, &left_out, fold, look->iterations));
    V2V_TRY(v2v_left_out_run(left_out, self->volume, self->undistorted, NULL));
    weight_by_depth(self, left_out->estimator->slices);
    v2v_left_out_predict(left_out, self->predicted[0], self->volume);
    v2v_left_out_predict(left_out, self->predicted[1], self->deep);
    for (int64_t i = 0; i < self->count - left_out->used; i++) {
        float *prediction[2] = {self->predicted[0] + i * self->pixels,
                                self->predicted[1] + i * self->pixels};
        compare(self, left_out->view[left_out->used + i], prediction, look);
    }
    v2v_calibrator_step(self, look->iterations);
done:
    v2v_left_out_destroy(&left_out);
    return rc;
}

static double root_of(struct v2v_missed missed)
{
    return missed.of > 0.0 ? sqrt(missed.squares / missed.of) : 0.0;
}

static int64_t folds_of(const struct v2v_calibrator *self, const struct v2v_look *look)
{
    const int64_t most = v2v_left_out_folds(self->count);
    return most < self->count ? v2v_smaller(most, look->folds) : most; /* few: one by one */
}

enum v2v_status v2v_calibrator_look(struct v2v_calibrator *self, const struct v2v_look *look)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_missed frame = {0.0, 0.0, 0.0}, square = {0.0, 0.0, 0.0};
    const int64_t folds = folds_of(self, look);
    v2v_calibrator_go(self, look->side);
    V2V_TRY(v2v_calibrator_apply(self));
    for (int64_t fold = 0; fold < folds; fold++) {
        V2V_TRY(look_at_fold(self, (struct v2v_left_out_views){fold, folds, self->count}, look));
    }
    for (int64_t v = 0; v < self->count; v++) {
        frame.squares += self->registration[v].in_frame.squares;
        frame.of += self->registration[v].in_frame.of;
        square.squares += self->registration[v].in_square.squares;
        square.of += self->registration[v].in_square.of;
    }
    self->missed = root_of(frame);
    self->missed_in_square = root_of(square);
    /* what decides the rounds is the same everywhere: other processors may round another way */
    v2v_par_broadcast(self->comm, &self->missed, sizeof self->missed, 0);
    v2v_log(V2V_LOG_DEBUG, "%lld x %lld pixels: views left out are missed by %.4f",
            (long long)self->height, (long long)self->width, self->missed);
done:
    return rc;
}

/* Of a square, or of the frame where it is shorter. */
static double length_of(int64_t side, int64_t whole)
{
    return (double)(side == 0 ? whole : v2v_smaller(side, whole));
}

double v2v_calibrator_share(const struct v2v_calibrator *self, int64_t side)
{
    const int64_t height = self->frame.rows.count, width = self->frame.columns.count;
    return length_of(side, height) * length_of(side, width) / (double)(height * width);
}

double v2v_calibrator_cost(const struct v2v_calibrator *self, const struct v2v_look *look)
{
    return (double)(folds_of(self, look) * look->iterations) *
           v2v_calibrator_share(self, look->side);
}

void v2v_calibrator_step(struct v2v_calibrator *self, int iterations)
{
    self->done += (double)iterations * v2v_calibrator_share(self, self->side);
    v2v_progress_step(&self->progress, (int64_t)self->done, NULL);
}
