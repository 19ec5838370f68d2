#ifndef V2V3D_EVAL_STRUCTURE_H
#define V2V3D_EVAL_STRUCTURE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** How the coarse structure of a view y is met by the projection p of a volume: means of squares of
 *  8 x 8 pixels about their view's mean, away from the border, where light that comes from beyond
 *  it is in no volume; and mixed second differences of neighbours, which tell the noise. */
struct v2v_structure {
    double yy, yp, pp;    /**< sums over the squares .. */
    double dyy, dyp, dpp; /**< .. and over the differences: 4 sigma^2 each, of white noise */
    double squares, differences;
    double light;         /**< sum of p^2 of the squares .. */
    double lyy, lyp, lpp; /**< .. and of p^2 times the mean of their differences: noise as it counts
                               for brightness, that of photons being where the light is */
};

/** One view, of zeros where it has fewer than four squares, or only tails of a structure that lies
 *  at the border. Add the members for several.
 *  @kind Local. @param recorded, projected [y,x] */
struct v2v_structure v2v_structure_of(const float *recorded, const float *projected, int64_t height,
                                      int64_t width);
void v2v_structure_add(struct v2v_structure *sum, const struct v2v_structure *structure);

/** |y - s p| / |y| of the structure, by the best s, without the noise of y - s p itself: 0 where
 *  that may be all. NaN where y has no structure, or is no number. As little as 0.006 of views in
 *  register at any noise, 0.2 of a real recording after its calibration; 0.08 to 0.4 in another
 *  order or mirrored (tests/bench/views.md). @kind Local. */
double v2v_structure_missed(const struct v2v_structure *structure);

/** Do these views show any, up to the border, above their noise? Of a frame before the light came,
 *  they do not.
 *  @kind Local. @param views [count,y,x] */
int v2v_structure_is_seen(const float *views, int64_t count, int64_t height, int64_t width);

/** Does one of these views show less than a tenth of what the others do, most of which show it
 *  plainly? As of a shutter that opens late. @kind Local. @param views [count,y,x] */
int v2v_structure_lacks_view(const float *views, int64_t count, int64_t height, int64_t width);

/** Are views of this size large enough to tell? @kind Local. */
int v2v_structure_can_be_seen(int64_t height, int64_t width);

/** How many times as bright as the volume has it a view's structure is, beside the other views:
 *  1 unless that is known, of the others too, beyond 5 % and the noise where the light is, and most
 *  of what the volume misses of the view. As of one that was blocked, or of another gain.
 *  @kind Local. @param others their sum */
double v2v_structure_brightness(const struct v2v_structure *view,
                                const struct v2v_structure *others);

/** How far each view lies from its projection, away from the border (v2v_fourier_shift).
 *  @kind Local. @param shift [count,2] out, pixels in y, x, NaN where there is no telling
 *  @param recorded, projected [count,y,x] @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_structure_shifts(double *shift, const float *recorded, const float *projected,
                                     int64_t count, int64_t height, int64_t width) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
