#ifndef V2V3D_TENSOR_SATURATION_H
#define V2V3D_TENSOR_SATURATION_H

#include "v2v3d/tensor/blind.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Pixels that the camera cut off: those at the highest value, if they are at least 10 and two
 *  times as many as at the next lower one, and less than half of all; else 0. Counts of light thin
 *  out towards their end. Blind samples (tensor/blind.h) are none.
 *  @kind Local. */
int64_t v2v_saturated_pixels(const float *views, int64_t count);

/** Their value: the light was that or more. INFINITY where there are none. @kind Local. */
float v2v_saturated_value(const float *views, int64_t count);

/** Saturated samples of each view become V2V_BLIND. @kind Local. @param views [count,pixels]
 *  @return how many of the view that has most */
int64_t v2v_saturated_leave(float *views, int64_t count, int64_t pixels);

/** What a camera that ends where these views do shows of their projections: no more than they have
 *  where they are saturated. @kind Local. @param projected, views [count,pixels] */
void v2v_saturated_cap(float *projected, const float *views, int64_t count, int64_t pixels);

/** Does a sample tell against a prediction? A blind one (tensor/blind.h) doesn't, nor a saturated
 *  one that it is above. @kind Local. @param highest as v2v_saturated_value says */
static inline int v2v_sample_tells(float recorded, float predicted, float highest)
{
    return recorded != V2V_BLIND && !(recorded == highest && predicted > recorded);
}

/** What a prediction leaves of a sample, 0 of one that doesn't tell. @kind Local. */
static inline float v2v_rest_of(float recorded, float predicted, float highest)
{
    return v2v_sample_tells(recorded, predicted, highest) ? recorded - predicted : 0.0f;
}

#ifdef __cplusplus
}
#endif

#endif
