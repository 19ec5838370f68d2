#ifndef V2V3D_SRC_OPTICS_SIZES_H
#define V2V3D_SRC_OPTICS_SIZES_H

#include <stdint.h>

/** The centre pixel of a side of `side` pixels: ceil(side/2)-1 (REFERENCE.md 2). */
static inline int64_t v2v_psf_centre(int64_t side)
{
    return (side + 1) / 2 - 1;
}

#endif
