#ifndef V2V3D_SRC_OPTICS_MOMENTS_H
#define V2V3D_SRC_OPTICS_MOMENTS_H

#include <stdint.h>

/** Sums over a slice [height,width] in double precision: of its light [0], and of it times y [1]
 *  and x [2], counted from the first pixel. @kind Local. */
void v2v_slice_moments(double moment[3], const float *slice, int64_t height, int64_t width);

#endif
