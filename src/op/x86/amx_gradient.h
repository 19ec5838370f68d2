/* The gradient of a convolution's weights by the tile unit: a product over pixels, the rows of the
 * left side being an input's pixels at a tap, those of the right side the gradients of outputs. */
#ifndef OP_AMX_GRADIENT_H
#define OP_AMX_GRADIENT_H

#include "v2v3d/op/conv.h"

struct amx_gradient;

/* For the threads that OpenMP has now. */
enum v2v_status amx_gradient_create(struct amx_gradient **gradient,
                                    const struct v2v_conv_spec *spec) V2V_MUST_CHECK;
void amx_gradient_destroy(struct amx_gradient *gradient);

/* Floats of scratch that it needs. */
int64_t amx_gradient_floats(const struct amx_gradient *gradient);

/* dweight [out,in,k,k] += , in a fixed order whatever the threads. scratch: 64-byte aligned. */
void amx_gradient_add(const struct amx_gradient *gradient, float *scratch, float *dweight,
                      const float *in, const float *dout);

#endif
