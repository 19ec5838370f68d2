#include "loss/terms.h"

#include <math.h>
#include <string.h>

double v2v_term_mse(float *gradient, const float *difference, int64_t count, double weight)
{
    double sum = 0.0;
    const float factor = (float)(2.0 * weight / (double)count);
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < count; i++) {
        sum += (double)difference[i] * difference[i];
        gradient[i] = factor * difference[i];
    }
    return sum / (double)count;
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

double v2v_term_fourier(const struct v2v_term_fft *term, float *gradient, const float *image,
                        struct v2v_complex *spectrum, float *scratch, double weight)
{
    int64_t ny = term->ny, nx = term->nx, half = nx / 2 + 1;
    double sum = 0.0;
    memcpy(scratch, image, (size_t)(ny * nx) * sizeof *image);
    v2v_fft2_forward(term->fft, spectrum, scratch);
    for (int64_t y = 0; y < ny; y++) {
        for (int64_t x = 0; x < half; x++) {
            /* the half spectrum leaves out the mirror image of all but these columns */
            int alone = x == 0 || 2 * x == nx;
            sum += (alone ? 1.0 : 2.0) * modulus(&spectrum[y * half + x], term->squared);
        }
    }
    if (weight != 0.0) {
        v2v_fft2_inverse(term->fft, scratch, spectrum);
        for (int64_t i = 0; i < ny * nx; i++) {
            gradient[i] += (float)weight * scratch[i];
        }
    }
    return sum;
}

double v2v_term_positivity(float *gradient, const float *volume, int64_t count, double weight)
{
    double sum = 0.0;
    const float step = (float)-weight;
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < count; i++) {
        float below = volume[i] < 0.0f ? 1.0f : 0.0f;
        sum -= (double)(below * volume[i]);
        gradient[i] += below * step;
    }
    return sum;
}

double v2v_term_crosstalk(float *gradient, const float *a, const float *b, int64_t count,
                          double background, double weight)
{
    double sum = 0.0;
    const float step = (float)(-0.5 * weight);
#pragma omp simd reduction(+ : sum)
    for (int64_t i = 0; i < count; i++) {
        double lack = background - 0.5 * ((double)a[i] + (double)b[i]);
        sum += lack > 0.0 ? lack : 0.0;
        gradient[i] += lack > 0.0 ? step : 0.0f;
    }
    return sum;
}

double v2v_term_smoothness(float *gradient, const float *a, const float *b, int64_t slices,
                           int64_t pixels, double weight)
{
    double sum = 0.0;
    const float step = (float)(0.5 * weight);
    for (int64_t z = 1; z + 1 < slices; z++) {
        const float *am = a + z * pixels, *bm = b + z * pixels;
        float *g = gradient + z * pixels;
#pragma omp simd reduction(+ : sum)
        for (int64_t i = 0; i < pixels; i++) {
            float middle = am[i] + bm[i];
            float around = am[i - pixels] + bm[i - pixels] + am[i + pixels] + bm[i + pixels];
            float bend = 0.5f * (2.0f * middle - around);
            float sign = bend > 0.0f ? step : bend < 0.0f ? -step : 0.0f;
            sum += (double)fabsf(bend);
            g[i] += 2.0f * sign;
            g[i - pixels] -= sign;
            g[i + pixels] -= sign;
        }
    }
    return sum;
}
