#ifndef V2V3D_TENSOR_SMOOTH_H
#define V2V3D_TENSOR_SMOOTH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Means over squares of 2 * radius + 1 pixels; beyond the image as at its edges.
 *  @kind Local, no allocation. @param to, scratch [y,x]; `to` may be `image` */
void v2v_smooth_image(float *to, float *scratch, const float *image, int64_t height, int64_t width,
                      int radius);

/** How many pixels' noise such a mean, taken twice, has the variance of the mean of.
 *  @kind Local. */
double v2v_smooth_twice_count(int radius);

#ifdef __cplusplus
}
#endif

#endif
