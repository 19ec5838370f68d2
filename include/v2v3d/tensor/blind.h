#ifndef V2V3D_TENSOR_BLIND_H
#define V2V3D_TENSOR_BLIND_H

#include <float.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A sample of views of which nothing is known, in place of its value: what an aperture or a mask
 *  keeps from the camera, dead rows, a dead view. Finite, since NaN and Inf are errors; units that
 *  views are in, shading and distortion leave it alone. */
#define V2V_BLIND (-FLT_MAX)

/** Mark the samples of a frame's views that see nothing. They have one value v: over blocks of 8 x
 *  8, or runs of 32 along a row or column, with what touches them of that value. Samples below v
 *  and above it exist elsewhere, for noise of the dark goes both ways: the dark of few photons,
 *  which nothing is below, is seen, and so are saturated samples, and counts coarser than their
 *  noise. A view of one value sees nothing where the others vary.
 *  @kind   Local, no allocation; the same with any number of threads
 *  @param  marks [count,height,width] out: 1 where nothing is seen, else 0 @param views finite
 *  @param  zero what samples without light are about; NaN: not known, and parts see nothing whose
 *          value lies well below all others
 *  @return how many see nothing
 *  @cost   a pass over the views, others where there are such parts
 *  @source REFERENCE.md 10 */
int64_t v2v_blind_find(uint8_t *marks, const float *views, double zero, int64_t count,
                       int64_t height, int64_t width);

/** Those that are marked become V2V_BLIND. @kind Local. */
void v2v_blind_leave(float *views, const uint8_t *marks, int64_t samples);

/** Samples that are V2V_BLIND become dark. @kind Local. */
void v2v_blind_darken(float *views, int64_t samples);

/** They become the mean of what their view sees, 0 where that is nothing, which shows no structure
 *  of its own. @kind Local. @param views [count,pixels] */
void v2v_blind_fill(float *views, int64_t count, int64_t pixels);

/** Those of `from` are as well in `views`. @kind Local. */
void v2v_blind_take_over(float *views, const float *from, int64_t samples);

/** How many samples are V2V_BLIND. @kind Local. */
int64_t v2v_blind_count(const float *views, int64_t samples);

/** What isn't V2V_BLIND, in its order. @kind Local. @param seen may be the views
 *  @return how many */
int64_t v2v_blind_gather_seen(float *seen, const float *views, int64_t samples);

#ifdef __cplusplus
}
#endif

#endif
