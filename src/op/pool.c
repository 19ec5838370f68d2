#include "v2v3d/op/pool.h"

#include "v2v3d/base/memory.h"

/* Pieces begin at cache lines. */
enum { LINE_FLOATS = 16 };

void v2v_pool_restart(struct v2v_pool *pool)
{
    pool->taken = 0;
}

enum v2v_status v2v_pool_take(struct v2v_piece *piece, struct v2v_pool *pool, const char *label,
                              int64_t floats)
{
    enum v2v_status rc = V2V_OK;
    v2v_pool_give(piece);
    if (pool == NULL || !pool->shares) {
        V2V_TRY(V2V_ALLOC(piece->own, label, floats));
        return V2V_OK;
    }
    *piece = (struct v2v_piece){.pool = pool, .offset = pool->taken};
    pool->taken += (floats + LINE_FLOATS - 1) / LINE_FLOATS * LINE_FLOATS;
    pool->floats = pool->taken > pool->floats ? pool->taken : pool->floats;
done:
    return rc;
}

void v2v_pool_give(struct v2v_piece *piece)
{
    v2v_mem_free(piece->own);
    *piece = (struct v2v_piece){0};
}

enum v2v_status v2v_pool_fill(struct v2v_pool *pool, const char *label)
{
    return pool->shares ? V2V_ALLOC(pool->data, label, pool->floats) : V2V_OK;
}

void v2v_pool_fini(struct v2v_pool *pool)
{
    v2v_mem_free(pool->data);
    *pool = (struct v2v_pool){0};
}
