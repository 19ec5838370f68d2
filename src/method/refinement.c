#include "method/refinement.h"

#include "method/least_squares.h"
#include "method/tv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/cost.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* Iterations of a volume: more carry on more of what gains are off (tests/bench/views.md). */
enum { SETTLED = 14 };

/* Of the noise that is added to predictions. */
enum { SEED = 1 };

/* Noise, of the root mean square of projections: below it single precision would decide. */
static const double least_noise = 3e-2;

/* How large the volume's errors may be: their mean square, of the volume's own
 * (tests/bench/views.md). */
static const double largest_errors = 2.0;

/* Numbers of a view. */
enum { GAIN, DOWN, RIGHT };

/* What is asked for, one after the other; units are parts of a gain, and pixels. */
static const struct subject {
    int first, count; /* numbers of a view */
    double missed;    /* noise is at least so many times what views are missed by: shifts take for
                         theirs what else displaces views (tests/bench/views.md) */
    double most_less, most_more; /* of a step */
} subjects[] = {
    {GAIN, 1, 0.0, 0.5, 1.0},
    {DOWN, RIGHT - DOWN + 1, 3.0, 1.0, 1.0},
};
enum { SUBJECTS = sizeof subjects / sizeof *subjects };

int v2v_refinement_iterations(void)
{
    return 2 * (SETTLED + SUBJECTS * v2v_least_squares_products());
}

/** What the volume of `views` shows. Collective(comm). @param predicted out; may be `views` */
static enum v2v_status show(struct v2v_calibrator *self, struct v2v_left_out *all, float *predicted,
                            const float *views)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_left_out_run(all, self->volume, views, NULL));
    v2v_left_out_predict(all, predicted, self->volume);
    v2v_calibrator_step(self, SETTLED);
done:
    return rc;
}

/* to = from + noise, all views, but where they are blind */
static void add_noise(const struct v2v_calibrator *self, float *to, const float *from, double noise)
{
    for (int64_t i = 0; i < self->count * self->pixels; i++) {
        const float noisy = from[i] + (float)(noise * v2v_random_normal(SEED, 0, (uint64_t)i));
        to[i] = self->undistorted[i] != V2V_BLIND ? noisy : V2V_BLIND;
    }
}

/** Mean square of a voxel, of what is judged. Collective(comm).
 *  @param own slices of the volume @param of_slice [slices] room, of zeros */
static double light_of(const struct v2v_calibrator *self, struct v2v_part own, double *of_slice)
{
    const int64_t slices = self->problem->psf->slices;
    double sum = 0.0;
    for (int64_t z = 0; z < own.count; z++) {
        for (int64_t y = 0; y < self->rows.count; y++) {
            const float *row = self->volume + z * self->pixels +
                               (self->rows.first + y) * self->width + self->columns.first;
            of_slice[own.first + z] += v2v_sum_of_squares(row, self->columns.count);
        }
    }
    v2v_par_sum_f64(self->comm, of_slice, slices); /* each of one rank: no rounding */
    for (int64_t z = 0; z < slices; z++) {
        sum += of_slice[z];
    }
    return sum / (double)(slices * self->rows.count * self->columns.count);
}

/* missed = views - predicted, but where `views` or what was recorded is blind */
static void compare(const struct v2v_calibrator *self, float *missed, const float *views,
                    const float *predicted)
{
    const float *recorded = self->undistorted;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < self->count * self->pixels; i++) {
        missed[i] = recorded[i] != V2V_BLIND ? views[i] - predicted[i] : V2V_BLIND;
    }
}

/* What is known of views and volume. */
struct levels {
    double noise, missed; /* deviations: of the views' noise; of what is judged from projections */
    double projections;   /* their root mean square */
    double light;         /* mean square of a voxel */
};

static void measure(struct levels *levels, const struct v2v_calibrator *self,
                    const float *predicted)
{
    double missed = 0.0, squares = 0.0;
    int64_t count = 0;
    for (int64_t v = 0; v < self->count; v++) {
        for (int64_t y = 0; y < self->rows.count; y++) {
            const int64_t first =
                v * self->pixels + (self->rows.first + y) * self->width + self->columns.first;
            for (int64_t i = first; i < first + self->columns.count; i++) {
                const double seen = self->undistorted[i], shown = predicted[i];
                if (self->undistorted[i] != V2V_BLIND) {
                    missed += (seen - shown) * (seen - shown);
                    squares += shown * shown;
                    count++;
                }
            }
        }
    }
    levels->missed = count > 0 ? sqrt(missed / (double)count) : 0.0;
    levels->projections = count > 0 ? sqrt(squares / (double)count) : 0.0;
}

/** What a volume of all views shows, and one of a copy: its projections and noise. The levels are
 *  rank 0's. Collective(comm). */
static enum v2v_status look(struct v2v_calibrator *self, struct levels *levels)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *all = NULL;
    double *of_slice = NULL;
    float *const predicted = self->predicted[0], *const copy = self->predicted[1];
    V2V_TRY(v2v_par_agree(self->comm,
                          V2V_ALLOC(of_slice, "calibrate.refinement", self->problem->psf->slices)));
    V2V_TRY(v2v_calibrator_apply(self));
    V2V_TRY(v2v_calibrator_leave_out(self, &all, (struct v2v_left_out_views){0}, SETTLED));
    V2V_TRY(show(self, all, predicted, self->undistorted));
    levels->noise = v2v_tv_noise(all->estimator).deviation;
    levels->light = light_of(self, all->estimator->slices, of_slice);
    measure(levels, self, predicted);
    v2v_par_broadcast(self->comm, levels, sizeof *levels, 0);
    add_noise(self, copy, predicted, levels->noise);
    V2V_TRY(show(self, all, copy, copy));
done:
    v2v_left_out_destroy(&all);
    v2v_mem_free(of_slice);
    return rc;
}

/* What is asked for, and room for it. */
struct question {
    struct v2v_least_squares_terms terms;
    double *step, *bias; /* [term,v] */
    float *missed;       /* [v,place] */
};

/** Local. */
static enum v2v_status take_memory(struct question *question, const struct v2v_calibrator *self,
                                   int terms)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = self->count, most = terms * views;
    V2V_TRY(V2V_ALLOC(question->step, "calibrate.refinement", 2 * most));
    V2V_TRY(
        V2V_ALLOC(question->missed, "calibrate.missed", v2v_mem_product(views, self->pixels, 1)));
    V2V_TRY(V2V_ALLOC(question->terms.images, "calibrate.terms",
                      v2v_mem_product(most, self->pixels, 1)));
    question->bias = question->step + most;
done:
    return rc;
}

static void free_question(struct question *question)
{
    v2v_mem_free(question->terms.images);
    v2v_mem_free(question->missed);
    v2v_mem_free(question->step);
}

/* What a unit of each number would add to these: as bright again; a pixel lower, further right. */
static void differentiate(const struct v2v_calibrator *self, const struct question *question,
                          const struct subject *subject, const float *views)
{
    const int64_t height = self->height, width = self->width, samples = self->count * self->pixels;
    for (int t = 0; t < subject->count; t++) {
        float *const image = question->terms.images + t * samples;
        const int number = subject->first + t;
        const int64_t back = number == DOWN ? width : 1;
#pragma omp parallel for schedule(static)
        for (int64_t i = 0; i < samples; i++) {
            const int64_t y = i / width % height, x = i % width;
            const int is_inside = y > 0 && y + 1 < height && x > 0 && x + 1 < width;
            const float slope = is_inside ? 0.5f * (views[i - back] - views[i + back]) : 0.0f;
            image[i] = number == GAIN ? views[i] : slope;
        }
    }
}

/* Steps less their bias. */
static void take(struct v2v_calibrator *self, const struct question *question,
                 const struct subject *subject)
{
    for (int64_t i = 0; i < subject->count * self->count; i++) {
        struct v2v_view_calibration *const view = &self->calibration->view[i % self->count];
        const double step = question->step[i] - question->bias[i];
        const double by = fmin(fmax(step, -subject->most_less), subject->most_more);
        const int64_t number = subject->first + i / self->count;
        if (number == GAIN) {
            view->gain *= 1.0 + by;
        } else {
            view->shift[number - DOWN] += by;
        }
    }
}

/** By what the views are missed by and what the copy is. Collective(comm). */
static void solve(struct v2v_calibrator *self, struct question *question,
                  struct v2v_least_squares *least_squares, const struct subject *subject,
                  const struct levels *levels)
{
    const float *const predicted = self->predicted[0], *const copy = self->predicted[1];
    const double least = fmax(levels->noise, least_noise * levels->projections);
    const struct v2v_volume_errors errors = {.noise = fmax(least, subject->missed * levels->missed),
                                             .square = largest_errors * levels->light};
    question->terms.count = subject->count;
    question->terms.is_relative = subject->first == GAIN;
    compare(self, question->missed, predicted, copy);
    differentiate(self, question, subject, copy);
    v2v_least_squares_solve(least_squares, question->bias, question->missed, &question->terms,
                            &errors);
    compare(self, question->missed, self->undistorted, predicted);
    differentiate(self, question, subject, predicted);
    v2v_least_squares_solve(least_squares, question->step, question->missed, &question->terms,
                            &errors);
    v2v_calibrator_step(self, 2 * v2v_least_squares_products());
}

enum v2v_status v2v_refinement_step(struct v2v_calibrator *self, int has_shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_least_squares *least_squares = NULL;
    struct question question = {0};
    struct levels levels;
    v2v_watchdog_beat("calibrate: by all views");
    V2V_TRY(look(self, &levels));
    V2V_TRY(v2v_par_agree(self->comm,
                          take_memory(&question, self, has_shifts ? V2V_LEAST_SQUARES_TERMS : 1)));
    V2V_TRY(v2v_least_squares_create(&least_squares, &self->psf, self->height, self->width,
                                     self->rows, self->columns, v2v_split_of_slabs(&self->config),
                                     self->comm));
    for (const struct subject *subject = subjects; subject < subjects + (has_shifts ? SUBJECTS : 1);
         subject++) {
        solve(self, &question, least_squares, subject, &levels);
        take(self, &question, subject);
    }
done:
    v2v_least_squares_destroy(&least_squares);
    free_question(&question);
    return rc;
}
