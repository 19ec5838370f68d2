#ifndef V2V3D_OP_ACTIVATION_H
#define V2V3D_OP_ACTIVATION_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** out = x > 0 ? x : slope * x; out may be in. @kind Local. */
void v2v_leaky_forward(float *out, const float *in, int64_t count, float slope);

/** din = dout * (y > 0 ? 1 : slope), y the activation's input or output (slope > 0: same sign); din
 *  may be dout. @kind Local. */
void v2v_leaky_backward(float *din, const float *dout, const float *y, int64_t count, float slope);

#ifdef __cplusplus
}
#endif

#endif
