/* The single terms of the loss: each adds its gradient and returns its value. Double sums; `weight`
 * 0 leaves the gradient alone. */
#ifndef V2V3D_LOSS_TERMS_H
#define V2V3D_LOSS_TERMS_H

#include "v2v3d/fft/fft2.h"
#include <stdint.h>

/* Mean over `count` of difference^2; gradient[i] = weight * 2 difference[i] / count. */
double v2v_term_mse(float *gradient, const float *difference, int64_t count, double weight);

/* Sum over all frequencies of one image's |D| (L1) or |D|^2 (squared), D its unnormalised
 * transform; gradient[i] += weight * d(sum)/d(image[i]). `image` [ny,nx], spectrum and scratch
 * borrowed. */
struct v2v_term_fft {
    const struct v2v_fft2 *fft;
    int64_t ny, nx;
    int squared;
};
double v2v_term_fourier(const struct v2v_term_fft *term, float *gradient, const float *image,
                        struct v2v_complex *spectrum, float *scratch, double weight);

/* Sum of relu(-volume). */
double v2v_term_positivity(float *gradient, const float *volume, int64_t count, double weight);

/* Sum of relu(background - m), m the mean of a and b; the gradient is the one of a. */
double v2v_term_crosstalk(float *gradient, const float *a, const float *b, int64_t count,
                          double background, double weight);

/* Sum of |2 m[z] - m[z-1] - m[z+1]| over the inner slices, m the mean of a and b; gradient of a. */
double v2v_term_smoothness(float *gradient, const float *a, const float *b, int64_t slices,
                           int64_t pixels, double weight);

#endif
