/** Images that one convolution in bf16 hands to the next without reordering: 32 channels of a
 *  pixel side by side, [(channels + 31) / 32][y][x][32], with zeros for channels that are not
 *  there; in memory that is counted in floats. */
#ifndef V2V3D_OP_BLOCKED_H
#define V2V3D_OP_BLOCKED_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_BLOCKED_CHANNELS = 32 };

/** How an image lies in memory: as [channel,y,x] in float32, or blocked. */
enum v2v_form { V2V_FORM_PLAIN, V2V_FORM_BLOCKED };

struct v2v_blocked {
    float *data; /**< borrowed, aligned to 64 bytes */
    int64_t channels, height, width;
};

/** Floats that hold such an image. @kind Local. */
int64_t v2v_blocked_floats(int64_t channels, int64_t height, int64_t width);

/** Blocks of channels. @kind Local. */
int64_t v2v_blocked_count(int64_t channels);

/** Pixels (y, x .. x + pixels - 1) of a block from 32 rows in float32, rounded to the nearest, ties
 *  to even; NULL: a channel of zeros. @kind Local; needs AVX512-BF16, which v2v_conv_takes_blocked
 *  has asked for. */
void v2v_blocked_set(const struct v2v_blocked *image, int64_t block, int64_t y, int64_t x,
                     const float *const row[V2V_BLOCKED_CHANNELS], int64_t pixels);

#ifdef __cplusplus
}
#endif

#endif
