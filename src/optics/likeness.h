#ifndef V2V3D_SRC_OPTICS_LIKENESS_H
#define V2V3D_SRC_OPTICS_LIKENESS_H

#include <stdint.h>

/** Light [0] and centroid [1,2] = y, x of a slice [height,width], pixels from its first one; 0
 *  where it is dark. @kind Local. */
void v2v_slice_centroid(double figures[3], const float *slice, int64_t height, int64_t width);

#endif
