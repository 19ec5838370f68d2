/** Pixels brighter than light through the optics can make one: hot, or hit by a particle. */
#ifndef V2V3D_TENSOR_HOT_PIXELS_H
#define V2V3D_TENSOR_HOT_PIXELS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_HOT_PIXELS_SCRATCH = 1 << 16 };

/** They become the median of their eight neighbours (fewer at an edge). A pixel is hot where it
 *  exceeds 2 `sharpness` times the sum of its neighbours by more than half of the 99.9th percentile
 *  and 8 times the noise, all above the median of the frame; percentiles and noise by up to 65536
 *  samples. Nothing is changed where that percentile is the median: there is no light to compare
 *  with.
 *  @kind   Local, deterministic
 *  @param  images [count,height,width], of one frame, finite
 *  @param  scratch [V2V_HOT_PIXELS_SCRATCH]
 *  @param  sharpness most that a pixel of a point's image holds over the sum of its neighbours
 *  @return how many were hot
 *  @source REFERENCE.md 1 */
int64_t v2v_hot_pixels_mend(float *images, float *scratch, int64_t count, int64_t height,
                            int64_t width, double sharpness);

#ifdef __cplusplus
}
#endif

#endif
