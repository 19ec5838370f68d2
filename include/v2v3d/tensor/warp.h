#ifndef V2V3D_TENSOR_WARP_H
#define V2V3D_TENSOR_WARP_H

#include "v2v3d/base/field.h"

#ifdef __cplusplus
extern "C" {
#endif

/** to[p] = from[p - field(p)] by cubic convolution; beyond the image, its edge goes on. Where both
 *  fields are 0, a copy.
 *  @kind Local. @param to, from [height,width], not the same @param field_y, field_x pixels
 *  @source Keys, Cubic convolution interpolation for digital image processing, IEEE TASSP 1981,
 *  with a = -1/2 */
void v2v_warp_image(float *to, const float *from, int64_t height, int64_t width,
                    const double field_y[V2V_FIELD_TERMS], const double field_x[V2V_FIELD_TERMS]);

/** The transpose of v2v_warp_image, which is not its inverse.
 *  @kind Local. @param to, from [height,width], not the same */
void v2v_warp_image_transpose(float *to, const float *from, int64_t height, int64_t width,
                              const double field_y[V2V_FIELD_TERMS],
                              const double field_x[V2V_FIELD_TERMS]);

/** The inverse: to[p - field(p)] = from[p], likewise; fields change by less than a pixel from one
 *  pixel to the next. What is made of a blind sample (tensor/blind.h) is blind.
 *  @kind Local. @param scratch [2,height,width] */
void v2v_unwarp_image(float *to, const float *from, float *scratch, int64_t height, int64_t width,
                      const double field_y[V2V_FIELD_TERMS], const double field_x[V2V_FIELD_TERMS]);

/** Where the pixels of a row lie: (y, x) further by part[x] (y[x] + more_y, x[x] + more_x), pixels,
 *  below 2^30 of them. */
struct v2v_way {
    const float *y, *x, *part; /**< [width], finite */
    float more_y, more_x;
    float least; /**< a shorter way is none */
};

/** A row of an image from there, likewise, float32: to[x] = from[y + .., x + ..]; where there is no
 *  way, a copy. @kind Local. @param from [height,width], below 2^31 pixels */
void v2v_warp_row(float *to, const float *from, int64_t height, int64_t width, int64_t y,
                  const struct v2v_way *way);

/** image *= exp(sign * field), but for blind samples. @kind Local. */
void v2v_shade_image(float *image, int64_t height, int64_t width,
                     const double field[V2V_FIELD_TERMS], double sign);

#ifdef __cplusplus
}
#endif

#endif
