#include "method/gains.h"

#include "method/gain_equations.h"
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

int v2v_gains_iterations(void)
{
    return 2 * (SETTLED + v2v_gain_equations_products());
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

/** Mean square of a voxel, of what is judged. Collective(comm). @param of_slice [slices] room */
static double light_of(const struct v2v_calibrator *self, double *of_slice)
{
    const int64_t slices = self->problem->psf->slices;
    const struct v2v_part own =
        v2v_par_part(slices, v2v_comm_size(self->comm), v2v_comm_rank(self->comm));
    double sum = 0.0;
    for (int64_t z = 0; z < slices; z++) {
        of_slice[z] = 0.0;
    }
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

/* Gains by a step less its bias, at most doubled or halved; returns the largest change of a
 * logarithm. */
static double take(struct v2v_calibrator *self, double *step, const double *bias)
{
    double mean = 0.0, moved = 0.0;
    for (int64_t v = 0; v < self->count; v++) {
        step[v] = log1p(fmin(fmax(step[v] - bias[v], -0.5), 1.0));
        mean += step[v] / (double)self->count;
    }
    for (int64_t v = 0; v < self->count; v++) {
        self->calibration->view[v].gain *= exp(step[v] - mean);
        moved = fmax(moved, fabs(step[v] - mean));
    }
    return moved;
}

/** step and bias [views], by what the views are missed by and what the copy is. Writes over all
 *  three images. Collective(comm). */
static enum v2v_status solve(struct v2v_calibrator *self, double *step, double *bias, float *missed,
                             float *predicted, float *copy, const struct v2v_gain_knowledge *known)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_gain_equations *equations = NULL;
    V2V_TRY(v2v_gain_equations_create(&equations, &self->psf, self->height, self->width, self->rows,
                                      self->columns, v2v_split_of_slabs(&self->config),
                                      self->comm));
    compare(self, missed, predicted, copy);
    v2v_gain_equations_solve(equations, bias, missed, copy, known);
    compare(self, missed, self->undistorted, predicted);
    v2v_gain_equations_solve(equations, step, missed, predicted, known);
    v2v_calibrator_step(self, 2 * v2v_gain_equations_products());
done:
    v2v_gain_equations_destroy(&equations);
    return rc;
}

enum v2v_status v2v_gains_step(struct v2v_calibrator *self, double *moved)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = self->count;
    struct v2v_left_out *all = NULL;
    double *step = NULL, *of_slice = NULL;
    float *missed = NULL, *const predicted = self->predicted[0], *const copy = self->predicted[1];
    v2v_watchdog_beat("calibrate: gains by all views");
    rc = V2V_ALLOC(step, "calibrate.gains", 2 * count);
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(of_slice, "calibrate.gains", self->problem->psf->slices);
    }
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(missed, "calibrate.missed", v2v_mem_product(count, self->pixels, 1));
    }
    V2V_TRY(v2v_par_agree(self->comm, rc));
    V2V_TRY(v2v_calibrator_apply(self));
    V2V_TRY(v2v_calibrator_leave_out(self, &all, (struct v2v_left_out_views){0}, SETTLED));
    V2V_TRY(show(self, all, predicted, self->undistorted));
    const struct v2v_gain_knowledge known = {v2v_tv_noise(all->estimator).deviation,
                                             light_of(self, of_slice)};
    add_noise(self, copy, predicted, known.noise);
    V2V_TRY(show(self, all, copy, copy));
    v2v_left_out_destroy(&all); /* before its like is made */
    V2V_TRY(solve(self, step, step + count, missed, predicted, copy, &known));
    *moved = take(self, step, step + count);
    v2v_par_broadcast(self->comm, moved, sizeof *moved, 0);
done:
    v2v_left_out_destroy(&all);
    v2v_mem_free(missed);
    v2v_mem_free(of_slice);
    v2v_mem_free(step);
    return rc;
}
