/** Convolution of few channels: the kernels, one set for each instruction set.
 *
 *  A strip is a thread's own copy of some rows of all channels, with the zeros of the padding and
 * of the tail written out, so that a kernel never asks where the border is. A tile is 4 output
 *  channels by up to DIRECT_VECTORS vectors of x: its sums stay in registers over all input
 * channels and taps.
 */
#ifndef OP_DIRECT_KERNEL_H
#define OP_DIRECT_KERNEL_H

#include <stdint.h>

/** Output channels of a tile. */
enum { DIRECT_CHANNELS = 4 };

/** [channel][row][column]; column 0 of a row is image column -(kernel-1)/2 of what is convolved,
 *  image column 0 of dout. */
struct direct_strip {
    const float *data;
    int64_t channels;
    int64_t rows; /**< per channel, of the strip */
    int64_t pitch;
    int64_t first; /**< the first row that is read; behind the last one follows row 0 */
};

struct direct_target {
    float *data;
    int64_t channels, plane; /**< elements from channel to channel */
    int64_t rows, width;     /**< rows of the strip, pixels of the image's rows */
    int64_t pitch;
    int64_t held, first; /**< rows per channel, and the first that is written, as of a strip */
};

/** Row `y` from `first` on, of a ring of `held` rows. */
static inline int64_t direct_row(int64_t first, int64_t y, int64_t held)
{
    return first + y < held ? first + y : first + y - held;
}

struct direct_kernel {
    int64_t lanes; /**< floats of a vector */
    /** target = leaky(strip * weights + bias); weights [channels/4][in][k][k][4], bias filled up to
     *  a multiple of 4 */
    void (*convolve)(const struct direct_target *target, const struct direct_strip *strip,
                     const float *weights, const float *bias, int kernel, float slope);
    /** sums[channels/4][in][k][4][k][lanes] += what each tap sees, lane by lane; pixels beyond the
     *  width are zero in dout */
    void (*correlate)(float *sums, const struct direct_strip *strip,
                      const struct direct_strip *dout, int64_t width, int kernel);
};

/** The convolution with products in bf16, added up in float32, on the tile unit; for those who ask
 *  v2v_amx_usable before. */
struct direct_tiles {
    /** Does it take these channels, and is it faster by them? */
    int (*takes)(int64_t in, int64_t out, int kernel);
    int64_t (*floats)(int64_t in); /**< of packed weights */
    /** weight [out,in,k,k] */
    void (*pack)(float *packed, const float *weight, int64_t in, int64_t out);
    /** target = leaky(strip * weights + bias); bias [out] */
    void (*convolve)(const struct direct_target *target, const struct direct_strip *strip,
                     const float *packed, const float *bias, float slope);
};

extern const struct direct_tiles v2v_direct_tiles;
extern const struct direct_kernel v2v_direct_avx512;
extern const struct direct_kernel v2v_direct_avx2;
extern const struct direct_kernel v2v_direct_any;

#endif
