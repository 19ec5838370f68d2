/* The direct kernel's convolution with products in bf16 on the tile unit. Of a run of pixels every
 * row becomes rows of pairs of channels, [row][pair][column][2], so that what a column of taps sees
 * is a tile without a copy: its rows are the pairs of three rows of pixels. Weights are the left
 * side, and sums come out as rows of pixels. */
#include "op/direct_kernel.h"
#include "op/x86/amx.h"
#include "op/x86/amx_lanes.h"

#include <string.h>

#define TARGET                                                                                     \
    __attribute__((target("arch=x86-64-v4,avx512bf16,amx-tile,amx-bf16,prefer-vector-width=512")))
#define INLINE TARGET static inline __attribute__((always_inline))

enum { KERNEL = 3 };

/* Input channels, and products a pixel and tap that pay for the way to the unit and back. */
enum { MOST_IN = 32, LEAST_PRODUCTS = 32 };

/* Pixels and rows at a time; columns that they see, in whole vectors. */
enum { TILES = 4, RUN = TILES * LANES, ROWS = 8, COLUMNS = RUN + LANES };

enum { MOST_PAIRS = MOST_IN / 2, PAIR_ROW = 2 * COLUMNS };

/* Pairs of channels that a column of taps sees, in parts of a tile's rows at most. A last part
 * begins earlier than it would, for all to have as many, with zero weights for what was there. */
struct parts {
    int64_t pairs, rows, count, each;
};

static struct parts parts_of(int64_t channels)
{
    struct parts parts = {.pairs = v2v_parts(channels, 2)};
    parts.rows = KERNEL * parts.pairs;
    parts.count = v2v_parts(parts.rows, AMX_SIDE);
    parts.each = v2v_parts(parts.rows, parts.count);
    return parts;
}

static int64_t first_of(const struct parts *parts, int64_t part)
{
    return v2v_smaller(part * parts->each, parts->rows - parts->each);
}

static int takes(int64_t in, int64_t out, int kernel)
{
    return kernel == KERNEL && in <= MOST_IN && out <= AMX_SIDE && in * out >= LEAST_PRODUCTS;
}

static int64_t floats(int64_t in)
{
    return parts_of(in).count * KERNEL * AMX_TILE / 2;
}

/* Weights of output o for part's rows, through the taps of column dx. */
static void pack_output(bf16 *to, const float *weight, int64_t in, const struct parts *parts,
                        int64_t part, int dx)
{
    float row[AMX_DEPTH] = {0};
    for (int64_t i = 0; i < parts->each; i++) {
        const int64_t place = first_of(parts, part) + i, pair = place % parts->pairs;
        for (int64_t c = 2 * pair; c < v2v_smaller(2 * pair + 2, in); c++) {
            const int64_t tap = place / parts->pairs * KERNEL + dx;
            row[2 * i + c % 2] =
                place >= part * parts->each ? weight[c * KERNEL * KERNEL + tap] : 0.0f;
        }
    }
    v2v_amx_pack_row(to, row, AMX_DEPTH, 1);
}

static void pack(float *packed, const float *weight, int64_t in, int64_t out)
{
    const struct parts parts = parts_of(in);
    bf16 *to = (bf16 *)packed;
    memset(packed, 0, (size_t)floats(in) * sizeof *packed);
    for (int64_t part = 0; part < parts.count; part++) {
        for (int dx = 0; dx < KERNEL; dx++, to += AMX_TILE) {
            for (int64_t o = 0; o < out; o++) {
                pack_output(to + o * AMX_DEPTH, weight + o * in * KERNEL * KERNEL, in, &parts, part,
                            dx);
            }
        }
    }
}

/* ---- what a run of pixels sees ---- */

/* Row y and those below it, from column x on; beyond the last one zeros. */
INLINE void pair_up(bf16 *lines, const struct direct_strip *strip, const struct parts *parts,
                    int64_t y, int64_t rows, int64_t x, int64_t columns)
{
    const int64_t plane = strip->rows * strip->pitch;
    for (int64_t r = 0; r < rows; r++) {
        const float *row =
            strip->data + direct_row(strip->first, y + r, strip->rows) * strip->pitch + x;
        for (int64_t p = 0; p < parts->pairs; p++, row += 2 * plane, lines += PAIR_ROW) {
            const int has_both = 2 * p + 1 < strip->channels;
            for (int64_t i = 0; i < COLUMNS; i += LANES) {
                const __mmask16 mask = first_lanes(columns - i);
                const __m512 even = _mm512_maskz_loadu_ps(mask, row + i);
                const __m512 odd = _mm512_maskz_loadu_ps(has_both ? mask : 0, row + plane + i);
                _mm512_storeu_si512(lines + 2 * i, interleaved(even, odd));
            }
        }
    }
}

/* ---- products ---- */

/* Tiles 0 to 3 are sums, 4 weights, 5 and 6 pairs of channels. */
INLINE void begin(const struct parts *parts, int64_t out)
{
    struct amx_shapes shapes = {.palette = 1};
    for (int i = 0; i < 7; i++) {
        shapes.row_bytes[i] = i == 4 ? (uint16_t)(4 * parts->each) : 64;
        shapes.rows[i] = (uint8_t)(i > 4 ? parts->each : out);
    }
    v2v_amx_settle();
    _tile_loadconfig(&shapes);
}

/* sums [tile][output][pixel] of the row whose taps begin at `lines` */
INLINE void multiply(float *sums, const bf16 *lines, const bf16 *weights, const struct parts *parts)
{
    enum { STRIDE = PAIR_ROW * sizeof(bf16), STEP = 2 * LANES };
    v2v_amx_settle();
    _tile_zero(0);
    _tile_zero(1);
    _tile_zero(2);
    _tile_zero(3);
    for (int64_t part = 0; part < parts->count; part++) {
        const bf16 *from = lines + first_of(parts, part) * PAIR_ROW;
        for (int dx = 0; dx < KERNEL; dx++, from += 2, weights += AMX_TILE) {
            _tile_loadd(4, weights, AMX_DEPTH * sizeof(bf16));
            _tile_loadd(5, from, STRIDE);
            _tile_dpbf16ps(0, 4, 5);
            _tile_loadd(6, from + STEP, STRIDE);
            _tile_dpbf16ps(1, 4, 6);
            _tile_loadd(5, from + 2 * STEP, STRIDE);
            _tile_dpbf16ps(2, 4, 5);
            _tile_loadd(6, from + 3 * STEP, STRIDE);
            _tile_dpbf16ps(3, 4, 6);
        }
    }
    _tile_stored(0, sums, LANES * sizeof(float));
    _tile_stored(1, sums + LANES * LANES, LANES * sizeof(float));
    _tile_stored(2, sums + 2 * LANES * LANES, LANES * sizeof(float));
    _tile_stored(3, sums + 3 * LANES * LANES, LANES * sizeof(float));
    v2v_amx_settle();
}

/* leaky(sums + bias) of pixels x .. of row y */
INLINE void give(const struct direct_target *target, const float *sums, const float *bias,
                 float slope, int64_t y, int64_t x)
{
    float *row = target->data + direct_row(target->first, y, target->held) * target->pitch + x;
    for (int64_t o = 0; o < target->channels; o++, row += target->plane, sums += LANES) {
        for (int64_t t = 0; t < TILES; t++) {
            const __m512 sum = _mm512_loadu_ps(sums + t * LANES * LANES) + bias[o];
            const __mmask16 negative = _mm512_cmp_ps_mask(sum, _mm512_setzero_ps(), _CMP_NGT_UQ);
            _mm512_mask_storeu_ps(row + t * LANES, first_lanes(target->width - x - t * LANES),
                                  _mm512_mask_mul_ps(sum, negative, sum, _mm512_set1_ps(slope)));
        }
    }
}

TARGET static void convolve(const struct direct_target *target, const struct direct_strip *strip,
                            const float *packed, const float *bias, float slope)
{
    const struct parts parts = parts_of(strip->channels);
    _Alignas(64) bf16 lines[(ROWS + KERNEL - 1) * MOST_PAIRS * PAIR_ROW];
    _Alignas(64) float sums[TILES * LANES * LANES];
    begin(&parts, target->channels);
    for (int64_t x = 0; x < target->width; x += RUN) {
        for (int64_t y = 0; y < target->rows; y += ROWS) {
            const int64_t rows = v2v_smaller(target->rows - y, ROWS);
            pair_up(lines, strip, &parts, y, rows + KERNEL - 1, x, target->width + KERNEL - 1 - x);
            for (int64_t r = 0; r < rows; r++) {
                multiply(sums, lines + r * parts.pairs * PAIR_ROW, (const bf16 *)packed, &parts);
                give(target, sums, bias, slope, y + r, x);
            }
        }
    }
    _tile_release();
}

const struct direct_tiles v2v_direct_tiles = {
    .takes = takes, .floats = floats, .pack = pack, .convolve = convolve};
