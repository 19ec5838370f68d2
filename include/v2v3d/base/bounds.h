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

/** The larger of two. @kind Local. */
static inline int64_t v2v_larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

/** x, or the bound that it is beyond; `high` where the bounds cross. @kind Local. */
static inline int64_t v2v_within(int64_t x, int64_t low, int64_t high)
{
    return v2v_smaller(x > low ? x : low, high);
}

/** How many parts of `part` hold `count`. @kind Local. */
static inline int64_t v2v_parts(int64_t count, int64_t part)
{
    return (count + part - 1) / part;
}

/** The smallest multiple that is not below n >= 0. @kind Local. */
static inline int64_t v2v_round_up(int64_t n, int64_t multiple)
{
    return v2v_parts(n, multiple) * multiple;
}

#ifdef __cplusplus
}
#endif

#endif
