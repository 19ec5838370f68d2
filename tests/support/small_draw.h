/** Random arrays for tests. */
#ifndef TEST_SMALL_DRAW_H
#define TEST_SMALL_DRAW_H

#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

/** [count] normal numbers of this deviation; v2v_mem_free gives them back. */
static inline float *small_draw(int64_t count, uint64_t stream, double deviation)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(deviation * v2v_random_normal(5, stream, (uint64_t)i));
    }
    return x;
}

#endif
