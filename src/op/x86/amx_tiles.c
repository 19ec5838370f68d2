#include "op/x86/amx.h"

#include <immintrin.h>

#define TARGET __attribute__((target("amx-tile,amx-bf16")))

static const struct amx_shapes whole_tiles = {
    .palette = 1,
    .row_bytes = {64, 64, 64, 64, 64, 64, 64, 64},
    .rows = {AMX_SIDE, AMX_SIDE, AMX_SIDE, AMX_SIDE, AMX_SIDE, AMX_SIDE, AMX_SIDE, AMX_SIDE},
};

TARGET void v2v_amx_begin(void)
{
    _tile_loadconfig(&whole_tiles);
}

TARGET void v2v_amx_end(void)
{
    _tile_release();
}

#define SUM_BYTES (AMX_SIDE * (int64_t)sizeof(float))
#define HALF ((int64_t)AMX_SIDE * AMX_SIDE)

TARGET static inline __attribute__((always_inline)) void load_sums(const float *sums)
{
    _tile_loadd(0, sums, SUM_BYTES);
    _tile_loadd(1, sums + HALF, SUM_BYTES);
    _tile_loadd(2, sums + 2 * HALF, SUM_BYTES);
    _tile_loadd(3, sums + 3 * HALF, SUM_BYTES);
}

TARGET static inline __attribute__((always_inline)) void store_sums(float *sums)
{
    _tile_stored(0, sums, SUM_BYTES);
    _tile_stored(1, sums + HALF, SUM_BYTES);
    _tile_stored(2, sums + 2 * HALF, SUM_BYTES);
    _tile_stored(3, sums + 3 * HALF, SUM_BYTES);
    v2v_amx_settle();
}

TARGET static inline __attribute__((always_inline)) void step(const bf16 *left0, const bf16 *left1,
                                                              int64_t left_bytes,
                                                              const bf16 *right0,
                                                              const bf16 *right1)
{
    _tile_loadd(4, left0, left_bytes);
    _tile_stream_loadd(6, right0, AMX_DEPTH * sizeof(bf16));
    _tile_stream_loadd(7, right1, AMX_DEPTH * sizeof(bf16));
    _tile_dpbf16ps(0, 4, 6);
    _tile_loadd(5, left1, left_bytes);
    _tile_dpbf16ps(1, 4, 7);
    _tile_dpbf16ps(2, 5, 6);
    _tile_dpbf16ps(3, 5, 7);
}

TARGET void v2v_amx_multiply(float *sums, const bf16 *const values[2], const bf16 *weights,
                             const struct amx_walk *walk, int64_t blocks, int fresh)
{
    int64_t pixel_bytes = walk->pixel * (int64_t)sizeof(bf16);
    v2v_amx_settle();
    if (fresh) {
        _tile_zero(0);
        _tile_zero(1);
        _tile_zero(2);
        _tile_zero(3);
    } else {
        load_sums(sums);
    }
    for (int64_t b = 0; b < blocks; b++) {
        const bf16 *value0 = values[0] + b * walk->block, *value1 = values[1] + b * walk->block;
        for (int t = 0; t < walk->taps; t++) {
            step(value0 + walk->tap[t], value1 + walk->tap[t], pixel_bytes, weights,
                 weights + AMX_TILE);
            weights += 2 * (int64_t)AMX_TILE;
        }
    }
    store_sums(sums);
}

TARGET void v2v_amx_correlate(float *sums, const struct amx_rows *rows)
{
    int64_t channel_bytes = rows->channel * (int64_t)sizeof(bf16);
    v2v_amx_settle();
    load_sums(sums);
    for (int64_t y = 0; y < rows->rows; y++) {
        const bf16 *left = rows->left + y * rows->left_row;
        const bf16 *right0 = rows->right[0] + y * rows->right_row;
        const bf16 *right1 = rows->right[1] + y * rows->right_row;
        for (int64_t s = 0; s < rows->steps; s++) {
            step(left, left + AMX_SIDE * rows->channel, channel_bytes, right0, right1);
            left += AMX_DEPTH;
            right0 += AMX_TILE;
            right1 += AMX_TILE;
        }
    }
    store_sums(sums);
}
