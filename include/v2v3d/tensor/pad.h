#ifndef V2V3D_TENSOR_PAD_H
#define V2V3D_TENSOR_PAD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Extend planes [planes,height,width] to [planes,padded_height,padded_width] on the lower and
 * right side by reflection without repeating the edge (a frame smaller than what is missing
 * reflects to and fro). @kind Local; out must not overlap in. */
void v2v_pad_reflect(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                     int64_t padded_height, int64_t padded_width);

#ifdef __cplusplus
}
#endif

#endif
