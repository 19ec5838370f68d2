/* Between plain float32 images and what the tile unit reads and writes. */
#include "op/x86/amx.h"
#include "op/x86/amx_lanes.h"

#define TARGET AMX_LANES_TARGET
#define INLINE AMX_LANES_INLINE

/* Pairs of neighbouring rows change places across the diagonal; four rounds turn 16 x 16. */
INLINE void turn_quads(__m512i *row)
{
    __m512i part[LANES];
    for (int i = 0; i < LANES; i += 2) {
        part[i] = _mm512_unpacklo_epi32(row[i], row[i + 1]);
        part[i + 1] = _mm512_unpackhi_epi32(row[i], row[i + 1]);
    }
    for (int i = 0; i < LANES; i += 4) {
        row[i] = _mm512_unpacklo_epi64(part[i], part[i + 2]);
        row[i + 1] = _mm512_unpackhi_epi64(part[i], part[i + 2]);
        row[i + 2] = _mm512_unpacklo_epi64(part[i + 1], part[i + 3]);
        row[i + 3] = _mm512_unpackhi_epi64(part[i + 1], part[i + 3]);
    }
}

INLINE void turn(__m512i *row)
{
    __m512i part[LANES];
    turn_quads(row);
    for (int i = 0; i < 4; i++) {
        __m512i a = _mm512_shuffle_i32x4(row[i], row[i + 4], 0x88);
        __m512i b = _mm512_shuffle_i32x4(row[i], row[i + 4], 0xdd);
        __m512i c = _mm512_shuffle_i32x4(row[i + 8], row[i + 12], 0x88);
        __m512i d = _mm512_shuffle_i32x4(row[i + 8], row[i + 12], 0xdd);
        part[i] = _mm512_shuffle_i32x4(a, c, 0x88);
        part[i + 8] = _mm512_shuffle_i32x4(a, c, 0xdd);
        part[i + 4] = _mm512_shuffle_i32x4(b, d, 0x88);
        part[i + 12] = _mm512_shuffle_i32x4(b, d, 0xdd);
    }
    for (int i = 0; i < LANES; i++) {
        row[i] = part[i];
    }
}

INLINE __m512 some(const float *row, int64_t x, __mmask16 mask)
{
    return row != NULL ? _mm512_maskz_loadu_ps(mask, row + x) : _mm512_setzero_ps();
}

TARGET void v2v_amx_pack_pixels(bf16 *to, const float *const row[AMX_DEPTH], int64_t pixels,
                                int64_t step)
{
    for (int64_t x = 0; x < pixels; x += LANES) {
        __mmask16 mask = first_lanes(pixels - x);
        __m512i pairs[LANES];
        for (int i = 0; i < LANES; i++) {
            pairs[i] = interleaved(some(row[2 * i], x, mask), some(row[2 * i + 1], x, mask));
        }
        turn(pairs);
        for (int64_t i = 0; i < v2v_smaller(pixels - x, LANES); i++) {
            _mm512_storeu_si512(to + (x + i) * step * AMX_DEPTH, pairs[i]);
        }
    }
}

INLINE __m512 take(const float *from, int64_t count, int64_t step)
{
    __mmask16 mask = first_lanes(count);
    if (step == 1) {
        return _mm512_maskz_loadu_ps(mask, from);
    }
    const __m512i lanes = _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
    __m512i place = _mm512_mullo_epi32(lanes, _mm512_set1_epi32((int)step));
    return _mm512_mask_i32gather_ps(_mm512_setzero_ps(), mask, place, from, sizeof *from);
}

/* 32 numbers, zeros behind the last. */
INLINE __m512i take_rounded(const float *from, int64_t count, int64_t step)
{
    const float *second = count > LANES ? from + LANES * step : from;
    return rounded(take(from, count, step), take(second, count - LANES, step));
}

TARGET void v2v_amx_pack_row(bf16 *to, const float *from, int64_t pixels, int64_t step)
{
    for (int64_t x = 0; x < pixels; x += AMX_DEPTH) {
        int64_t count = pixels - x;
        __mmask32 mask = count < AMX_DEPTH ? (1U << count) - 1 : ~0U;
        _mm512_mask_storeu_epi16(to + x, mask, take_rounded(from + x * step, count, step));
    }
}

INLINE void store_tile(bf16 *to, __m512i *row)
{
    turn(row);
    for (int64_t i = 0; i < LANES; i++) {
        _mm512_storeu_si512(to + i * AMX_DEPTH, row[i]);
    }
}

TARGET void v2v_amx_pack_pairs(bf16 *to, const float *from, int64_t plane, int64_t channels,
                               int64_t pixels)
{
    for (int64_t x = 0; x < pixels; x += AMX_DEPTH) {
        __m512i row[LANES];
        for (int64_t c = 0; c < LANES; c++) {
            row[c] = c < channels ? take_rounded(from + c * plane + x, pixels - x, 1)
                                  : _mm512_setzero_si512();
        }
        store_tile(to + x / AMX_DEPTH * AMX_TILE, row);
    }
}

TARGET void v2v_amx_pack_weights(bf16 *to, const struct amx_weights *from, int64_t outputs,
                                 int64_t channels)
{
    for (int64_t t = 0; t < from->taps; t++) {
        int64_t tap = from->reversed ? from->taps - 1 - t : t;
        for (int64_t first = 0; first < AMX_BLOCK; first += LANES) {
            __m512i row[LANES];
            for (int64_t o = 0; o < LANES; o++) {
                row[o] = first + o < outputs
                             ? take_rounded(from->base + (first + o) * from->out + tap, channels,
                                            from->in)
                             : _mm512_setzero_si512();
            }
            store_tile(to, row);
            to += AMX_TILE;
        }
    }
}

INLINE __m512 leaky(__m512 sum, __m512 bias, __m512 slope)
{
    __m512 value = _mm512_add_ps(sum, bias);
    __mmask16 below = _mm512_cmp_ps_mask(value, _mm512_setzero_ps(), _CMP_LT_OQ);
    return _mm512_mask_mul_ps(value, below, value, slope);
}

INLINE void unpack_half(float *data, int64_t plane, const float *sums,
                        const struct amx_result *result, int64_t first)
{
    __mmask16 mask = first_lanes(result->pixels);
    __m512 slope = _mm512_set1_ps(result->slope);
    __m512i row[LANES];
    for (int i = 0; i < LANES; i++) {
        row[i] = _mm512_loadu_si512(sums + (int64_t)i * LANES);
    }
    turn(row);
    for (int64_t i = 0; i < v2v_smaller(result->outputs - first, LANES); i++) {
        float bias = result->bias != NULL ? result->bias[first + i] : 0.0f;
        __m512 value = leaky(_mm512_castsi512_ps(row[i]), _mm512_set1_ps(bias), slope);
        _mm512_mask_storeu_ps(data + (first + i) * plane, mask, value);
    }
}

TARGET void v2v_amx_unpack(float *data, int64_t plane, const float *sums,
                           const struct amx_result *result)
{
    unpack_half(data, plane, sums, result, 0);
    unpack_half(data, plane, sums + AMX_SIDE * AMX_SIDE, result, LANES);
}

TARGET void v2v_amx_unpack_blocked(bf16 *data, const float *sums, const struct amx_result *result)
{
    __m512 slope = _mm512_set1_ps(result->slope), bias[2];
    for (int half = 0; half < 2; half++) {
        __mmask16 mask = first_lanes(result->outputs - half * LANES);
        bias[half] = result->bias != NULL ? _mm512_maskz_loadu_ps(mask, result->bias + half * LANES)
                                          : _mm512_setzero_ps();
    }
    for (int64_t x = 0; x < v2v_smaller(result->pixels, LANES); x++) {
        __m512 low = _mm512_loadu_ps(sums + x * AMX_SIDE);
        __m512 high = _mm512_loadu_ps(sums + (AMX_SIDE + x) * AMX_SIDE);
        _mm512_storeu_si512(data + x * AMX_DEPTH,
                            rounded(leaky(low, bias[0], slope), leaky(high, bias[1], slope)));
    }
}
