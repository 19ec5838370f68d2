#ifndef V2V3D_EVAL_UNCERTAINTY_H
#define V2V3D_EVAL_UNCERTAINTY_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** From two volumes a, b that have no view in common, their mean and its standard error.
 *  a <- (a + b) / 2,  b[z,y,x] <- root mean square of (a - b) / 2 over 5 x 5 pixels of the slice
 *  (fewer at its edges). Half the difference has the mean's standard deviation where the errors of
 *  the two are independent of each other; one voxel's is a single draw, the neighbours' a spread.
 *  It is the part of the error that differs from view to view: noise, registration, occlusion.
 *  What both volumes do alike, as every prior does (smoothing, light in the wrong depth), is in no
 *  difference: where that matters more, as in noisy views, the map says where, not how much
 *  (tests/bench/README.md has figures).
 *  @kind Local, no allocation. @param a, b [z,y,x], of one shape @param scratch [y,x] */
void v2v_uncertainty_of(float *a, float *b, float *scratch, int64_t slices, int64_t height,
                        int64_t width);

#ifdef __cplusplus
}
#endif

#endif
