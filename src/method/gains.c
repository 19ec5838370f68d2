#include "method/gains.h"

#include "method/tv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>

/* Iterations of a volume: more carry on more of what gains are off (tests/bench/views.md). */
enum { SETTLED = 14 };

/* Of the noise that is added to predictions. */
enum { SEED = 1 };

int v2v_gains_iterations(void)
{
    return 2 * SETTLED;
}

/** Logarithms of how bright the views `seen` are by what the volume of `views` shows: `predicted`.
 *  Collective(comm). */
static enum v2v_status show(struct v2v_calibrator *self, struct v2v_left_out *all,
                            double *brightness, float *predicted, const float *views,
                            const float *seen)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_left_out_run(all, self->volume, views, NULL));
    v2v_left_out_predict(all, predicted, self->volume);
    for (int64_t v = 0; v < self->count; v++) {
        const int64_t at = v * self->pixels;
        brightness[v] = log(v2v_registration_brightness(seen + at, predicted + at, self->width,
                                                        self->rows, self->columns));
    }
    v2v_calibrator_step(self, SETTLED);
done:
    return rc;
}

/* to = from + noise, all views, but where `to` is blind */
static void add_noise(const struct v2v_calibrator *self, float *to, const float *from, double noise)
{
    for (int64_t i = 0; i < self->count * self->pixels; i++) {
        const float noisy = from[i] + (float)(noise * v2v_random_normal(SEED, 0, (uint64_t)i));
        to[i] = to[i] != V2V_BLIND ? noisy : V2V_BLIND;
    }
}

/* Gains by the step less its bias; returns the largest change of a logarithm. */
static double take(struct v2v_calibrator *self, double *gain, const double *bias)
{
    double mean = 0.0, moved = 0.0;
    for (int64_t v = 0; v < self->count; v++) {
        gain[v] = fmin(fmax(gain[v] - bias[v], -log(2.0)), log(2.0));
        mean += gain[v] / (double)self->count;
    }
    for (int64_t v = 0; v < self->count; v++) {
        self->calibration->view[v].gain *= exp(gain[v] - mean);
        moved = fmax(moved, fabs(gain[v] - mean));
    }
    return moved;
}

enum v2v_status v2v_gains_step(struct v2v_calibrator *self, double *moved)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_left_out *all = NULL;
    double *gain = NULL;
    float *const views = self->undistorted, *const predicted = self->predicted[0];
    v2v_watchdog_beat("calibrate: gains by all views");
    V2V_TRY(v2v_par_agree(self->comm, V2V_ALLOC(gain, "calibrate.gains", 2 * self->count)));
    double *const bias = gain + self->count;
    V2V_TRY(v2v_calibrator_apply(self));
    V2V_TRY(v2v_calibrator_leave_out(self, &all, (struct v2v_left_out_views){0}, SETTLED));
    V2V_TRY(show(self, all, gain, predicted, views, views));
    add_noise(self, views, predicted, v2v_tv_noise(all->estimator).deviation);
    V2V_TRY(show(self, all, bias, self->predicted[1], views, predicted));
    *moved = take(self, gain, bias);
    v2v_par_broadcast(self->comm, moved, sizeof *moved, 0);
done:
    v2v_left_out_destroy(&all);
    v2v_mem_free(gain);
    return rc;
}
