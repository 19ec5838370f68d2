/* The body of a kernel set; included once by each direct_*.c, which defines
 *   LANES    floats of a vector
 *   TARGET   the instruction set, as a function attribute
 *   KERNEL   the name of the table
 * No include guard: it is a template. */
#include "op/direct_kernel.h"
#include <string.h>

typedef float vector __attribute__((vector_size(LANES * 4), aligned(4), may_alias));

typedef int32_t mask __attribute__((vector_size(LANES * 4), aligned(4), may_alias));

/** 16 sums with AVX-512's 32 registers, 8 with 16: more would spill, fewer would wait for the
 *  multiply-add's latency (4 cycles, 2 a cycle). */
enum { VECTORS = LANES == 16 ? 4 : 2 };

static inline __attribute__((always_inline)) void
convolve_tile(const struct direct_target *target, const struct direct_strip *strip,
              const float *weights, const float *bias, int kernel, float slope, int64_t y,
              int64_t x, int64_t channel, int vectors)
{
    vector sum[DIRECT_CHANNELS][VECTORS];
#pragma GCC unroll 4
    for (int o = 0; o < DIRECT_CHANNELS; o++) {
#pragma GCC unroll 4
        for (int j = 0; j < vectors; j++) {
            sum[o][j] = (vector){0} + bias[channel + o];
        }
    }
    const float *w = weights + channel * strip->channels * kernel * kernel;
    const float *line[3];
#pragma GCC unroll 3
    for (int k = 0; k < kernel; k++) {
        line[k] = strip->data + direct_row(strip->first, y + k, strip->rows) * strip->pitch + x;
    }
    for (int64_t i = 0; i < strip->channels; i++) {
#pragma GCC unroll 3
        for (int k = 0; k < kernel; k++) {
            const float *row = line[k];
            line[k] += strip->rows * strip->pitch;
#pragma GCC unroll 3
            for (int l = 0; l < kernel; l++, w += DIRECT_CHANNELS) {
#pragma GCC unroll 4
                for (int j = 0; j < vectors; j++) {
                    vector in = *(const vector *)(row + l + j * LANES);
#pragma GCC unroll 4
                    for (int o = 0; o < DIRECT_CHANNELS; o++) {
                        sum[o][j] += in * w[o];
                    }
                }
            }
        }
    }
    int64_t place = direct_row(target->first, y, target->held) * target->pitch + x;
    int64_t count = target->width - x < vectors * LANES ? target->width - x : vectors * LANES;
#pragma GCC unroll 4
    for (int o = 0; o < DIRECT_CHANNELS; o++) {
        float tail[VECTORS * LANES];
        float *to = target->data + (channel + o) * target->plane + place;
        int whole = channel + o < target->channels && count == vectors * LANES;
        float *row = whole ? to : tail;
#pragma GCC unroll 4
        for (int j = 0; j < vectors; j++) {
            mask positive = sum[o][j] > 0.0f;
            *(mask *)(row + j * LANES) =
                ((mask)sum[o][j] & positive) | ((mask)(slope * sum[o][j]) & ~positive);
        }
        if (!whole && channel + o < target->channels) {
            memcpy(to, tail, (size_t)count * sizeof *to);
        }
    }
}

static inline __attribute__((always_inline)) void convolve_rows(const struct direct_target *target,
                                                                const struct direct_strip *strip,
                                                                const float *weights,
                                                                const float *bias, int kernel,
                                                                float slope, int64_t x, int vectors)
{
    for (int64_t y = 0; y < target->rows; y++) {
        for (int64_t o = 0; o < target->channels; o += DIRECT_CHANNELS) {
            convolve_tile(target, strip, weights, bias, kernel, slope, y, x, o, vectors);
        }
    }
}

static inline __attribute__((always_inline)) void
convolve_strip(const struct direct_target *target, const struct direct_strip *strip,
               const float *weights, const float *bias, int kernel, float slope)
{
    int64_t x = 0;
    for (; target->width - x > (VECTORS - 1) * LANES; x += VECTORS * LANES) {
        convolve_rows(target, strip, weights, bias, kernel, slope, x, VECTORS);
    }
    for (; x < target->width; x += LANES) {
        convolve_rows(target, strip, weights, bias, kernel, slope, x, 1);
    }
}

TARGET static void convolve(const struct direct_target *target, const struct direct_strip *strip,
                            const float *weights, const float *bias, int kernel, float slope)
{
    if (kernel == 3) {
        convolve_strip(target, strip, weights, bias, 3, slope);
    } else {
        convolve_strip(target, strip, weights, bias, 1, slope);
    }
}

/** One input channel, one row of taps, 4 output channels. */
static inline __attribute__((always_inline)) void
correlate_taps(float *sums, const float *plane, int64_t pitch, const struct direct_strip *dout,
               int64_t channel, int64_t width, int kernel)
{
    vector sum[DIRECT_CHANNELS][3];
#pragma GCC unroll 4
    for (int o = 0; o < DIRECT_CHANNELS; o++) {
#pragma GCC unroll 3
        for (int l = 0; l < kernel; l++) {
            sum[o][l] = *(const vector *)(sums + (o * kernel + l) * LANES);
        }
    }
    for (int64_t y = 0; y < dout->rows; y++) {
        const float *row = plane + y * pitch;
        const float *from = dout->data + (channel * dout->rows + y) * dout->pitch;
        for (int64_t x = 0; x < width; x += LANES) {
            vector in[3];
#pragma GCC unroll 3
            for (int l = 0; l < kernel; l++) {
                in[l] = *(const vector *)(row + x + l);
            }
#pragma GCC unroll 4
            for (int o = 0; o < DIRECT_CHANNELS; o++) {
                vector d = *(const vector *)(from + o * dout->rows * dout->pitch + x);
#pragma GCC unroll 3
                for (int l = 0; l < kernel; l++) {
                    sum[o][l] += d * in[l];
                }
            }
        }
    }
#pragma GCC unroll 4
    for (int o = 0; o < DIRECT_CHANNELS; o++) {
#pragma GCC unroll 3
        for (int l = 0; l < kernel; l++) {
            *(vector *)(sums + (o * kernel + l) * LANES) = sum[o][l];
        }
    }
}

static inline __attribute__((always_inline)) void correlate_strip(float *sums,
                                                                  const struct direct_strip *strip,
                                                                  const struct direct_strip *dout,
                                                                  int64_t width, int kernel)
{
    for (int64_t o = 0; o < dout->channels; o += DIRECT_CHANNELS) {
        for (int64_t i = 0; i < strip->channels; i++) {
            for (int k = 0; k < kernel; k++, sums += DIRECT_CHANNELS * kernel * LANES) {
                const float *plane = strip->data + (i * strip->rows + k) * strip->pitch;
                correlate_taps(sums, plane, strip->pitch, dout, o, width, kernel);
            }
        }
    }
}

TARGET static void correlate(float *sums, const struct direct_strip *strip,
                             const struct direct_strip *dout, int64_t width, int kernel)
{
    if (kernel == 3) {
        correlate_strip(sums, strip, dout, width, 3);
    } else {
        correlate_strip(sums, strip, dout, width, 1);
    }
}

const struct direct_kernel KERNEL = {.lanes = LANES, .convolve = convolve, .correlate = correlate};
