#ifndef V2V3D_TENSOR_STATISTICS_H
#define V2V3D_TENSOR_STATISTICS_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Histogram background of REFERENCE.md 5 and 6: `bins` bins between minimum and mean; the edge
 * (right when `right`, else left) of the fullest bin, the first of equals. @kind Local. */
double v2v_background(const float *x, int64_t count, int bins, int right);

/** The p-th percentile (0..100) with linear interpolation, as numpy's default.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_percentile(double *value, const float *x, int64_t count,
                               double p) V2V_MUST_CHECK;

/** Rearrange x so that x[k] is its k-th smallest value, nothing before it larger, nothing behind it
 *  smaller; with a NaN it ends somewhere. @kind Local, nothing is allocated. @return x[k] */
float v2v_select(float *x, int64_t count, int64_t k);

/** Mean of side x side pixels of an image of that width, `at` the first of them. @kind Local. */
double v2v_mean_of_square(const float *at, int64_t width, int64_t side);

/** Where the dark of images lies, as where the zero of a camera was not subtracted, or more than
 *  it: the mean of squares of 16 x 16 pixels (of what there is of smaller images) that a hundredth
 *  of them are below, and twice its error, which it is too low by: of white noise, or what quarters
 *  of the darkest tenth of the squares tell. */
struct v2v_dark {
    double above; /**< zero; 0 where that mean is less than 5 errors above it, or than a hundredth
                       of the brightest square */
    double below; /**< zero; 0 where that mean is less than 7 errors below it, or this less than
                       such a hundredth */
};

/** @kind Local. @param scratch [count,height,width] */
struct v2v_dark v2v_dark_of_images(float *scratch, const float *images, int64_t count,
                                   int64_t height, int64_t width);

/** Standard deviation of white noise of which |a - b - c + d| are given: their median over
 *  2 * 0.6745. @kind Local. @param differences [count], rearranged @param count above 0 */
double v2v_noise_of_differences(float *differences, int64_t count);

/** Standard deviation of white noise in images of at least 2 x 2 pixels (0 below): the median of
 *  |a - b - c + d| over all 2 x 2 neighbours, which smooth light leaves alone, over 2 * 0.6745;
 *  where that is 0, as of few photons, half the root of their mean square.
 *  @kind Local. @param scratch [count,height-1,width-1] */
double v2v_noise_of_images(float *scratch, const float *images, int64_t count, int64_t height,
                           int64_t width);

/** The noise's variance over the level of the light: gain * level + variance. */
struct v2v_noise_line {
    double gain, variance;
    double gain_error; /**< standard error of `gain`, of white normal noise */
    double colour;     /**< how fast squares of 2 x 2 differences grow with the level, over those of
                        3 x 3: 1 for white noise; 0 where these don't grow */
};

/** The line of images of at least 3 x 6 pixels (0 below), by the squares of their second
 *  differences in both directions, which light that PSFs have smoothed leaves alone, over its level
 *  in 1 : 2 : 1 means; through the means of levels, weighted by the variance to the power of -2. A
 *  block of 3 x 3 counts to the level of the one three columns on, whose noise is another's. Levels
 *  beyond +-most, about, count for nothing. @kind Local, nothing is allocated. */
struct v2v_noise_line v2v_noise_line_of_images(const float *images, int64_t count, int64_t height,
                                               int64_t width, double most);

/** Sums in double precision, in a fixed order of blocks. @kind Local. */
double v2v_sum(const float *x, int64_t count);
double v2v_sum_of_squares(const float *x, int64_t count);

/** Sum of products in double precision, in a fixed order. @kind Local, one thread. */
double v2v_sum_of_products(const float *a, const float *b, int64_t count);

/** The sum of products, in their order. @kind Local. */
double v2v_dot(const double *a, const double *b, int64_t count);

/** Least, most, and the sums that mean and standard deviation follow from; zeroed: of nothing. */
struct v2v_figures {
    int64_t count;
    double least, most, sum, squares;
};

/** @kind Local. */
void v2v_figures_add(struct v2v_figures *figures, const float *x, int64_t count);
double v2v_figures_mean(const struct v2v_figures *figures);
/** Of the whole, not of a sample; to about 1e-8 of the largest modulus. */
double v2v_figures_deviation(const struct v2v_figures *figures);

/** Index of the first NaN or Inf, -1 when all are finite. @kind Local. */
int64_t v2v_first_not_finite(const float *x, int64_t count);

/** Have all the same value? @kind Local. */
int v2v_is_of_one_value(const float *x, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
