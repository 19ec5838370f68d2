#include "v2v3d/loss/loss.h"

#include <string.h>

/* One row: its squared differences, and dL/drow. */
static double judge_row(float *gradient, const float *volume, const float *known, float factor,
                        int64_t count)
{
    double sum = 0.0;
#pragma omp simd reduction(+ : sum)
    for (int64_t x = 0; x < count; x++) {
        const float difference = volume[x] - known[x];
        sum += (double)difference * difference;
        gradient[x] = factor * difference;
    }
    return sum;
}

/* Of one slice, all of which its thread adds up. */
static double judge_slice(float *gradient, const float *volume, const float *known, float factor,
                          const struct v2v_volume_loss *loss)
{
    const struct v2v_window *window = &loss->window;
    double sum = 0.0;
    memset(gradient, 0, (size_t)(loss->height * loss->width) * sizeof *gradient);
    for (int64_t y = window->y0; y < window->y1; y++) {
        const int64_t at = y * loss->width + window->x0;
        sum += judge_row(gradient + at, volume + at, known + at, factor, window->x1 - window->x0);
    }
    return sum;
}

void v2v_volume_loss_evaluate(const struct v2v_volume_loss *loss, double *terms, float *dvolume,
                              const float *volume, const float *known)
{
    const struct v2v_window *window = &loss->window;
    const int64_t pixels = loss->height * loss->width, slices = loss->slices;
    const double compared =
        (double)(slices * (window->y1 - window->y0) * (window->x1 - window->x0));
    double weight[V2V_LOSS_TERMS], sum = 0.0;
    v2v_loss_weights(weight, loss->settings);
    const float factor = (float)(2.0 * weight[V2V_LOSS_MSE] / compared);
#pragma omp parallel for ordered schedule(static, 1)
    for (int64_t z = 0; z < slices; z++) {
        const int64_t at = z * pixels;
        const double slice = judge_slice(dvolume + at, volume + at, known + at, factor, loss);
#pragma omp ordered
        sum += slice;
    }
    memset(terms, 0, V2V_LOSS_TERMS * sizeof *terms);
    terms[V2V_LOSS_MSE] = sum / compared;
    terms[V2V_LOSS_TOTAL] = weight[V2V_LOSS_MSE] * terms[V2V_LOSS_MSE];
}
