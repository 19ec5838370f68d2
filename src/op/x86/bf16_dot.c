/* The products of the tile unit by AVX-512's instructions for bf16, for processors without one. */
#include "op/x86/amx.h"

#include <immintrin.h>
#include <string.h>

#define TARGET __attribute__((target("arch=x86-64-v4,avx512bf16,prefer-vector-width=512")))

/* Pixels whose sums are in registers together, with both halves of the outputs. */
enum { PIXELS = 8 };

static inline __attribute__((always_inline)) int32_t pair_at(const bf16 *values)
{
    int32_t pair;
    memcpy(&pair, values, sizeof pair);
    return pair;
}

/* sums [half of the outputs][16 pixels][16], the first PIXELS of them. */
TARGET static void multiply_some(float *sums, const bf16 *values, const bf16 *weights,
                                 const struct amx_walk *walk, int64_t blocks, int fresh)
{
    enum { HALF = AMX_SIDE * AMX_SIDE };
    __m512 sum[2][PIXELS];
#pragma GCC unroll 8
    for (int i = 0; i < PIXELS; i++) {
        sum[0][i] = fresh ? _mm512_setzero_ps() : _mm512_loadu_ps(sums + i * AMX_SIDE);
        sum[1][i] = fresh ? _mm512_setzero_ps() : _mm512_loadu_ps(sums + HALF + i * AMX_SIDE);
    }
    for (int64_t step = 0; step < blocks * walk->taps; step++) {
        const bf16 *value = values + step / walk->taps * walk->block + walk->tap[step % walk->taps];
        for (int k = 0; k < AMX_DEPTH; k += 2, weights += AMX_DEPTH) {
            const __m512bh low = (__m512bh)_mm512_loadu_si512(weights);
            const __m512bh high = (__m512bh)_mm512_loadu_si512(weights + AMX_TILE);
#pragma GCC unroll 8
            for (int i = 0; i < PIXELS; i++) {
                const __m512bh x =
                    (__m512bh)_mm512_set1_epi32(pair_at(value + i * walk->pixel + k));
                sum[0][i] = _mm512_dpbf16_ps(sum[0][i], x, low);
                sum[1][i] = _mm512_dpbf16_ps(sum[1][i], x, high);
            }
        }
        weights += AMX_TILE;
    }
#pragma GCC unroll 8
    for (int i = 0; i < PIXELS; i++) {
        _mm512_storeu_ps(sums + i * AMX_SIDE, sum[0][i]);
        _mm512_storeu_ps(sums + HALF + i * AMX_SIDE, sum[1][i]);
    }
}

void v2v_dot_multiply(float *sums, const bf16 *const values[2], const bf16 *weights,
                      const struct amx_walk *walk, int64_t blocks, int fresh)
{
    for (int half = 0; half < 2; half++) {
        for (int64_t i = 0; i < AMX_SIDE; i += PIXELS) {
            multiply_some(sums + (int64_t)half * AMX_SUMS / 2 + i * AMX_SIDE,
                          values[half] + i * walk->pixel, weights, walk, blocks, fresh);
        }
    }
}
