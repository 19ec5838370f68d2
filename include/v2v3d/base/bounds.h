#ifndef V2V3D_BASE_BOUNDS_H
#define V2V3D_BASE_BOUNDS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The smaller of two. @kind Local. */
static inline int64_t v2v_smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

/** x, or the bound that it is beyond; `high` where the bounds cross. @kind Local. */
static inline int64_t v2v_within(int64_t x, int64_t low, int64_t high)
{
    return v2v_smaller(x > low ? x : low, high);
}

#ifdef __cplusplus
}
#endif

#endif
