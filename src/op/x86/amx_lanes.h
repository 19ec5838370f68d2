/* Vectors of 16 floats on their way to the tile unit. */
#ifndef OP_AMX_LANES_H
#define OP_AMX_LANES_H

#include "v2v3d/base/bounds.h"

#include <immintrin.h>
#include <stdint.h>

#define AMX_LANES_TARGET                                                                           \
    __attribute__((target("arch=x86-64-v4,avx512bf16,prefer-vector-width=512")))
#define AMX_LANES_INLINE AMX_LANES_TARGET static inline __attribute__((always_inline))

enum { LANES = 16 };

AMX_LANES_INLINE __mmask16 first_lanes(int64_t count)
{
    return (__mmask16)((1U << v2v_within(count, 0, LANES)) - 1);
}

/* [16 of low][16 of high] in bf16 */
AMX_LANES_INLINE __m512i rounded(__m512 low, __m512 high)
{
    return (__m512i)_mm512_cvtne2ps_pbh(high, low);
}

/* low[0], high[0], low[1], high[1] .. in bf16 */
AMX_LANES_INLINE __m512i interleaved(__m512 low, __m512 high)
{
    const __m512i order =
        _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6,
                         21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
    return _mm512_permutexvar_epi16(order, rounded(low, high));
}

#endif
