/* An axis cut into tiles of one size, which overlap, and of each the part that is kept. */
#ifndef RECON_TILING_H
#define RECON_TILING_H

#include "v2v3d/base/bounds.h"
#include "v2v3d/par/comm.h"

struct v2v_tiling {
    int64_t length; /* of the axis */
    int64_t size;   /* of a tile; more than length: what is beyond is made up */
    int64_t count;
};

/* Tiles keep nothing within `margin` of their ends, but at the ends of the axis.
 * size > 2 margin, or one tile is enough. */
static inline struct v2v_tiling v2v_tiling_of(int64_t length, int64_t size, int64_t margin)
{
    const int64_t beyond = v2v_larger(length - size, 0);
    const int64_t more = beyond > 0 ? v2v_parts(beyond, size - 2 * margin) : 0;
    return (struct v2v_tiling){length, size, 1 + more};
}

/* Evenly: the last tile ends with the axis. */
static inline int64_t v2v_tiling_start(const struct v2v_tiling *tiling, int64_t i)
{
    const int64_t beyond = v2v_larger(tiling->length - tiling->size, 0);
    return tiling->count > 1 ? i * beyond / (tiling->count - 1) : 0;
}

/* From where on tile i keeps what it has: the middle of what it shares with the one before. */
static inline int64_t v2v_tiling_border(const struct v2v_tiling *tiling, int64_t i)
{
    return i == 0 ? 0
           : i == tiling->count
               ? tiling->length
               : (v2v_tiling_start(tiling, i - 1) + tiling->size + v2v_tiling_start(tiling, i)) / 2;
}

static inline struct v2v_part v2v_tiling_kept(const struct v2v_tiling *tiling, int64_t i)
{
    const int64_t first = v2v_tiling_border(tiling, i);
    return (struct v2v_part){first, v2v_tiling_border(tiling, i + 1) - first};
}

#endif
