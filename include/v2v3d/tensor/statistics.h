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
 *  smaller; no NaN. @kind Local, nothing is allocated. @return x[k] */
float v2v_select(float *x, int64_t count, int64_t k);

/** Sum of squares in double precision, in a fixed order of blocks. @kind Local. */
double v2v_sum_of_squares(const float *x, int64_t count);

/** Index of the first NaN or Inf, -1 when all are finite. @kind Local. */
int64_t v2v_first_not_finite(const float *x, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
