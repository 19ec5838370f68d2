/** How far the structures of a frame are away in another frame of a recording. */
#ifndef METHOD_MOTION_H
#define METHOD_MOTION_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** A displacement of every pixel, the same in all views, and one of every view, the same at all its
 *  pixels: what moves along z moves each view its own way. */
struct v2v_motion;

/** Floats that v2v_motion_create takes. @kind Local. */
int64_t v2v_motion_floats(int64_t views, int64_t height, int64_t width);

/** @kind Local @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_motion_create(struct v2v_motion **motion, int64_t views, int64_t height,
                                  int64_t width) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_motion_destroy(struct v2v_motion **motion);

/** Start with a frame. @kind Local, no allocation. @param views [v,y,x], finite
 *  @param sigma of its noise, above 0 */
void v2v_motion_begin(struct v2v_motion *motion, const float *views, double sigma);

/** Find where what is at a pixel of the frame is in another one: there as well where noise would
 *  explain as much, or where less would agree.
 *  @kind   Local, no allocation; the same bits with any number of threads
 *  @param  neighbour [v,y,x]; samples that are not finite count as 0
 *  @param  factor    that makes its brightness the frame's
 *  @cost   some ten passes over the views at a quarter of their pixels, five of what stands still
 *  @source REFERENCE.md 12 */
void v2v_motion_find(struct v2v_motion *motion, const float *neighbour, double factor);

/** The neighbour, moved onto the frame by what was found; by less than a tenth of a pixel it isn't
 *  moved. @kind Local, no allocation. @param to, neighbour [v,y,x], not the same */
void v2v_motion_undo(const struct v2v_motion *motion, float *to, const float *neighbour);

#endif
