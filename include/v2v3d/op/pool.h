#ifndef V2V3D_OP_POOL_H
#define V2V3D_OP_POOL_H

#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Memory for what several sets of operators keep between calls, of which one set at a time is in
 *  use: every set takes its pieces from the beginning on, and finds the last user's values. When
 *  `shares` is 0 every piece is memory of its own, as with a pool that is NULL. */
struct v2v_pool {
    int shares;
    float *data;
    int64_t floats; /**< of the largest set so far */
    int64_t taken;  /**< of the set at hand */
};

/** A part of a pool, or memory of its own. */
struct v2v_piece {
    const struct v2v_pool *pool;
    int64_t offset;
    float *own;
};

/** The next set takes its pieces. @kind Local. */
void v2v_pool_restart(struct v2v_pool *pool);

/** Take `floats` under a label; a piece that was taken before is given back. Zeros when they are
 *  its own. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_pool_take(struct v2v_piece *piece, struct v2v_pool *pool, const char *label,
                              int64_t floats) V2V_MUST_CHECK;
void v2v_pool_give(struct v2v_piece *piece);

/** The memory behind all pieces, once every set has taken its own. @kind Local. @return V2V_OK |
 *  V2V_E_MEMORY */
enum v2v_status v2v_pool_fill(struct v2v_pool *pool, const char *label) V2V_MUST_CHECK;
void v2v_pool_fini(struct v2v_pool *pool);

static inline float *v2v_piece_data(const struct v2v_piece *piece)
{
    return piece->pool != NULL ? piece->pool->data + piece->offset : piece->own;
}

#ifdef __cplusplus
}
#endif

#endif
