#ifndef V2V3D_OPTICS_TAPS_H
#define V2V3D_OPTICS_TAPS_H

#include "v2v3d/base/status.h"
#include "v2v3d/optics/shifts.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Merged alignment (REFERENCE.md 8): a shift by (dy,dx) followed by a 3 x 3 convolution reads
 *  feat[v, y+k+dy, x+l+dx]; all (z,k,l) that read the same pixel of a view share one tap. */
struct v2v_tap {
    int32_t view; /**< place in the branch's list of views */
    int32_t y, x; /**< k+dy, l+dx: offset of the pixel read */
};

struct v2v_taps {
    int64_t views, slices;
    int64_t count;
    struct v2v_tap *tap; /**< [count], sorted by view, y, x */
    int32_t *of;         /**< [view,z,k,l] -> tap, -1 where (k,l) is left out */
};

/** The 3 x 3 kernel positions that count, by row and column: bit 0 is k = -1, bit 2 is k = +1. On
 * the one-pixel border ring the reference pads the shifted map with zeros, so there one row or
 * column of positions is left out. */
enum { V2V_TAPS_ALL = 7, V2V_TAPS_NOT_FIRST = 6, V2V_TAPS_NOT_LAST = 3 };

/** Tabulate the taps of the listed views; `merged` 0: every (z,k,l) has its own, as the reference
 *  computes. @kind Local.
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_taps_create(struct v2v_taps *taps, const struct v2v_shifts *shifts,
                                const int32_t *views, int64_t count, unsigned rows,
                                unsigned columns, int merged) V2V_MUST_CHECK;
void v2v_taps_fini(struct v2v_taps *taps);

#ifdef __cplusplus
}
#endif

#endif
