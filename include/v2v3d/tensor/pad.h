#ifndef V2V3D_TENSOR_PAD_H
#define V2V3D_TENSOR_PAD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The smallest multiple of `grid` that is >= n. @kind Local. */
int64_t v2v_pad_size(int64_t n, int64_t grid);

/** Extend planes [planes,height,width] to [planes,padded_height,padded_width] on the lower and
 * right side by reflection without repeating the edge (a frame smaller than what is missing
 * reflects to and fro). @kind Local; out must not overlap in. */
void v2v_pad_reflect(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                     int64_t padded_height, int64_t padded_width);

#ifdef __cplusplus
}
#endif

#endif
