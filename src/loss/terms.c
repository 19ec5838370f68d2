#include "loss/terms.h"

#include <math.h>
#include <string.h>

/* Mean of difference^2. */
double v2v_term_mse(const struct v2v_term_view *view, float *gradient, const float *difference,
                    double weight)
{
    double sum = 0.0;
    const float factor = (float)(2.0 * weight / view->compared);
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < view->ny * view->nx; i++) {
        sum += (double)difference[i] * difference[i];
        gradient[i] += factor * difference[i];
    }
    return sum / view->compared;
}

/* |D| to the power of the term, D replaced by what the inverse transform turns into the gradient.
 */
static double modulus(struct v2v_complex *d, int squared)
{
    double re = d->re, im = d->im, power = re * re + im * im;
    if (squared) {
        d->re *= 2.0f;
        d->im *= 2.0f;
        return power;
    }
    double size = sqrt(power), inverse = size > 0.0 ? 1.0 / size : 0.0;
    d->re = (float)(re * inverse);
    d->im = (float)(im * inverse);
    return size;
}

/* Sum over all frequencies of the difference's |D| (reference) or |D|^2 (paper), D its unnormalised
 * transform, over the pixels compared: in the reference a mean over all frequencies. */
double v2v_term_fft(const struct v2v_term_view *view, float *gradient, const float *difference,
                    double weight)
{
    const int squared = view->profile == V2V_LOSS_PAPER;
    const int64_t nx = view->nx, pixels = view->ny * nx, half = nx / 2 + 1;
    const double mean = 1.0 / view->compared;
    double sum = 0.0;
    memcpy(view->scratch, difference, (size_t)pixels * sizeof *difference);
    v2v_fft2_forward(view->fft, view->spectrum, view->scratch);
    for (int64_t i = 0; i < view->ny * half; i++) {
        /* the half spectrum leaves out the mirror image of all but these columns */
        int alone = i % half == 0 || 2 * (i % half) == nx;
        sum += (alone ? 1.0 : 2.0) * modulus(&view->spectrum[i], squared);
    }
    if (weight != 0.0) {
        v2v_fft2_inverse(view->fft, view->scratch, view->spectrum);
        for (int64_t i = 0; i < pixels; i++) {
            gradient[i] += (float)(weight * mean) * view->scratch[i];
        }
    }
    return sum * mean;
}

/* Sum of relu(-own). */
double v2v_term_pos(const struct v2v_term_volume *volume, float *gradient, const float *own,
                    const float *other, double weight)
{
    double sum = 0.0;
    const float step = (float)-weight;
    (void)other;
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < volume->width; i++) {
        float below = own[i] < 0.0f ? 1.0f : 0.0f;
        sum -= (double)(below * own[i]);
        gradient[i] += below * step;
    }
    return sum;
}

/* Sum (paper) or mean over all voxels (reference) of relu(background - m), m the mean volume. */
double v2v_term_dc(const struct v2v_term_volume *volume, float *gradient, const float *own,
                   const float *other, double weight)
{
    const double voxels = (double)volume->slices * volume->slice, background = volume->background;
    const double scale =
        volume->share * (volume->profile == V2V_LOSS_REFERENCE ? 1.0 / voxels : 1.0);
    const float step = (float)(-weight * scale);
    double sum = 0.0;
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < volume->width; i++) {
        double lack = background - 0.5 * ((double)own[i] + (double)other[i]);
        sum += lack > 0.0 ? lack : 0.0;
        gradient[i] += lack > 0.0 ? step : 0.0f;
    }
    return scale * sum;
}

/* Mean over the inner slices of |2 m[z] - m[z-1] - m[z+1]|, m the mean volume. */
double v2v_term_tv(const struct v2v_term_volume *volume, float *gradient, const float *own,
                   const float *other, double weight)
{
    if (volume->z == 0 || volume->z == volume->slices - 1) {
        return 0.0;
    }
    const int64_t stride = volume->stride;
    const double scale = volume->share / ((double)(volume->slices - 2) * volume->slice);
    const float step = (float)(weight * scale);
    double sum = 0.0;
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < volume->width; i++) {
        float middle = own[i] + other[i];
        float around = own[i - stride] + other[i - stride] + own[i + stride] + other[i + stride];
        float bend = 0.5f * (2.0f * middle - around);
        float sign = bend > 0.0f ? step : bend < 0.0f ? -step : 0.0f;
        sum += (double)fabsf(bend);
        gradient[i] += 2.0f * sign;
        gradient[i - stride] -= sign;
        gradient[i + stride] -= sign;
    }
    return scale * sum;
}
