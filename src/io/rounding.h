/** Voxels as whole numbers of steps. */
#ifndef V2V_IO_ROUNDING_H
#define V2V_IO_ROUNDING_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** The largest whole number. */
#define V2V_ROUNDING_MOST 65535.0

/** The step of which 65535 are `peak`; of a peak that is not above 0 the finest. @kind Local. */
double v2v_rounding_step(double peak);

/** Of `peak` and the voxels the largest. @kind Local. */
double v2v_rounding_peak(double peak, const float *voxels, int64_t count);

/** To the nearest of 0 .. 65535 steps, in place. @kind Local, on all threads.
 *  @return voxels that have none within half a step */
int64_t v2v_rounding_apply(float *voxels, int64_t count, double step);

/** One line on what that cost: a warning where voxels were clipped. @kind Local. */
void v2v_rounding_report(const char *path, double step, int64_t clipped);

#endif
