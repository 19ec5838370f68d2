/* Products of bf16 matrices, added up in float32, by the tile unit of the processor (AMX): a tile
 * is 16 rows of 64 bytes, 32 numbers in bf16 or 16 sums. Every thread that multiplies begins and
 * ends its use of the tiles. All calls are local to a thread. */
#ifndef OP_AMX_H
#define OP_AMX_H

#include <stdint.h>

typedef uint16_t bf16;

/* AMX_DEPTH: products that one step adds to a sum. AMX_BLOCK: channels that are multiplied
 * together, two tiles of outputs. AMX_SUMS: floats of two tiles by two. */
enum {
    AMX_SIDE = 16,
    AMX_DEPTH = 32,
    AMX_TILE = AMX_SIDE * AMX_DEPTH,
    AMX_BLOCK = 2 * AMX_SIDE,
    AMX_SUMS = AMX_BLOCK * AMX_BLOCK
};

/* What a tile's register holds, as the processor reads it. */
struct amx_shapes {
    uint8_t palette, start, reserved[14];
    uint16_t row_bytes[16];
    uint8_t rows[16];
};

/* The compiler does not know what memory tiles and their shapes are read from, and written to. */
static inline void v2v_amx_settle(void)
{
    __asm__ volatile("" ::: "memory");
}

/* All of them whole tiles. */
void v2v_amx_begin(void);
void v2v_amx_end(void);

/* ---- packing: float32 is rounded to the nearest bf16, ties to even ---- */

/* Rows of 32 channels (NULL: of zeros): pixel x becomes 32 neighbouring numbers at
 * to + x * step * 32. */
void v2v_amx_pack_pixels(bf16 *to, const float *const row[AMX_DEPTH], int64_t pixels, int64_t step);

/* to[x] = from[x * step] */
void v2v_amx_pack_row(bf16 *to, const float *from, int64_t pixels, int64_t step);

/* A row of up to 16 channels for the right side of a product over pixels: a tile for every 32
 * pixels, [pair of pixels][channel][2]; zeros behind the last pixel and for channels that are not
 * there. */
void v2v_amx_pack_pairs(bf16 *to, const float *from, int64_t plane, int64_t channels,
                        int64_t pixels);

/* Where the weight of output o, channel c and tap t is: base[o * out + c * in + t], the taps in
 * reversed order where that is asked for. */
struct amx_weights {
    const float *base;
    int64_t out, in;
    int taps, reversed;
};

/* Up to 32 outputs by 32 channels: [tap][half of the outputs][pair of channels][output][2]. */
void v2v_amx_pack_weights(bf16 *to, const struct amx_weights *from, int64_t outputs,
                          int64_t channels);

/* ---- products: sums [half][half][16][16] ---- */

/* What a product reads, in numbers: from one pixel to the next, from a block of channels to the
 * next, and to every tap. */
struct amx_walk {
    int64_t pixel, block;
    int64_t tap[9];
    int taps;
};

/* sums [half of the pixels][half of the outputs][pixel][output], from zero where `fresh`, plus
 * blocks * taps steps. values: of two runs of 16 pixels; weights as packed, [block]. */
void v2v_amx_multiply(float *sums, const bf16 *const values[2], const bf16 *weights,
                      const struct amx_walk *walk, int64_t blocks, int fresh);

/* The same by AVX-512's instructions for bf16, without v2v_amx_begin. */
void v2v_dot_multiply(float *sums, const bf16 *const values[2], const bf16 *weights,
                      const struct amx_walk *walk, int64_t blocks, int fresh);

/* Rows of what a product over pixels reads: of the left side 32 channels, `channel` numbers apart;
 * of the right side two halves of 16, as packed. A row has `steps` of 32 pixels. */
struct amx_rows {
    const bf16 *left, *right[2];
    int64_t channel;             /* of the left side */
    int64_t left_row, right_row; /* numbers from a row to the next */
    int64_t rows, steps;
};

/* sums [half of the left][half of the right][16][16] += */
void v2v_amx_correlate(float *sums, const struct amx_rows *rows);

/* ---- unpacking ---- */

/* What becomes of the sums of 16 pixels and 32 outputs, as many as there are: leaky(sum + bias). */
struct amx_result {
    const float *bias; /* of the first output; NULL: none */
    float slope;
    int64_t pixels, outputs;
};

/* to data + output * plane + pixel, in float32; or to data + pixel * 32 + output. sums: [half of
 * the outputs][pixel][output] */
void v2v_amx_unpack(float *data, int64_t plane, const float *sums, const struct amx_result *result);
void v2v_amx_unpack_blocked(bf16 *data, const float *sums, const struct amx_result *result);

#endif
