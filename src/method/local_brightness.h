/** How much brighter than in another frame of a recording what is about a pixel is: cells that
 *  flash, dyes that bleach where the light is. */
#ifndef METHOD_LOCAL_BRIGHTNESS_H
#define METHOD_LOCAL_BRIGHTNESS_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** A factor for every square of every view. */
struct v2v_local_brightness;

/** Floats that v2v_local_brightness_create takes. @kind Local. */
int64_t v2v_local_brightness_floats(int64_t views, int64_t height, int64_t width);

/** @kind Local @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_local_brightness_create(struct v2v_local_brightness **local, int64_t views,
                                            int64_t height, int64_t width) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_local_brightness_destroy(struct v2v_local_brightness **local);

/** Start with a frame. The variance of a sample's noise is unit * (photons + even).
 *  @kind Local, no allocation. @param views, photons [v,y,x], finite @param even 0 or more */
void v2v_local_brightness_begin(struct v2v_local_brightness *local, const float *views,
                                const float *photons, double unit, double even);

/** What the neighbour's samples are multiplied with to be as bright as the frame's: the factor of
 *  all, and more or less of it where noise would not explain it.
 *  @kind   Local, no allocation; the same bits with any number of threads
 *  @param  to [v,y,x] out, 1/4 to 4 of the factor
 *  @param  neighbour [v,y,x]; samples that are not finite count as 0
 *  @param  factor of all, above 0
 *  @source REFERENCE.md 12 */
void v2v_local_brightness_find(struct v2v_local_brightness *local, float *to,
                               const float *neighbour, double factor);

#endif
