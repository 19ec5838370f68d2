#ifndef V2V3D_TENSOR_COARSE_H
#define V2V3D_TENSOR_COARSE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Means over squares of side x side pixels, times `scale`, fewer of them at the last row and
 *  column; pixels that are not finite count as 0.
 *  @kind Local, no allocation. @param from [count,height,width]
 *  @param to [count,height / side,width / side], rounded up */
void v2v_coarse_images(float *to, const float *from, int64_t count, int64_t height, int64_t width,
                       int64_t side, float scale);

/** Smoothed in place by (1 2 1) / 4 along y and x; edges repeated.
 *  @kind Local, no allocation. @param images [count,height,width] */
void v2v_soften_images(float *images, int64_t count, int64_t height, int64_t width);

#ifdef __cplusplus
}
#endif

#endif
