/** Brightness that changes from frame to frame, as of dyes that bleach. */
#ifndef METHOD_BRIGHTNESS_H
#define METHOD_BRIGHTNESS_H

#include <stdint.h>

/** A piece of a view in two frames. */
struct v2v_ratio {
    float ratio, light;
};

/** Pieces that v2v_brightness_factor looks at, at most. @kind Local. */
int64_t v2v_brightness_pieces(int64_t views, int64_t height, int64_t width);

/** The factor that a neighbouring frame's light is multiplied with to be this frame's, where no
 *  more than half of the light changed otherwise: the median of the ratios of pieces of 8 x 8
 *  pixels, weighed by their light in both frames. 1 where hardly a piece stands out of the noise,
 *  or where one frame is four times as bright.
 *  @kind   Local, no allocation
 *  @param  frame, neighbour [v,y,x] @param scratch [pieces] @param sigma of a sample
 *  @source REFERENCE.md 12 */
double v2v_brightness_factor(struct v2v_ratio *scratch, const float *frame, const float *neighbour,
                             int64_t views, int64_t height, int64_t width, double sigma);

#endif
