/** Pixels brighter than light through the optics can make one: hot, or hit by a particle; and such
 *  as are darker than the dark. */
#ifndef V2V3D_TENSOR_HOT_PIXELS_H
#define V2V3D_TENSOR_HOT_PIXELS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Most that a pixel of an image, of at least a tenth of its brightest, holds over the sum of its
 *  eight neighbours: INFINITY where one has dark neighbours alone, 0 for a dark image.
 *  @kind Local. @param image [height,width] */
double v2v_sharpness_of_image(const float *image, int64_t height, int64_t width);

enum { V2V_HOT_PIXELS_SCRATCH = 1 << 16 };

/** How many were. */
struct v2v_mended {
    int64_t hot, cold;
};

/** They become the median of their eight neighbours (fewer at an edge). A pixel is hot where it
 *  exceeds 2 `sharpness` times the sum of its neighbours by more than half of the 99.9th percentile
 *  and 8 times the noise, all above the median of the frame; percentiles and noise by up to 65536
 *  samples. None is where that percentile is the median: there is no light to compare with. It is
 *  cold where it is below the first percentile by more than half of what that is below the median,
 *  8 times the noise and 1e-3 of what the 99.9th is above the median. Cold pixels that touch each
 *  other, up to 31, become the median of what touches them, before hot ones are looked for; those
 *  that touch them belong to them if they are a quarter as far below, and none of them is less than
 *  half as far.
 *  @kind   Local, deterministic
 *  @param  images [count,height,width], of one frame, finite
 *  @param  scratch [V2V_HOT_PIXELS_SCRATCH]
 *  @param  sharpness of points' images
 *  @source REFERENCE.md 1 */
struct v2v_mended v2v_hot_pixels_mend(float *images, float *scratch, int64_t count, int64_t height,
                                      int64_t width, double sharpness);

#ifdef __cplusplus
}
#endif

#endif
