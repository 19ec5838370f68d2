/** Plain-loop twins of room op in double precision. Each gives beside the result the sum of the
 *  moduli of its terms: a float32 sum of n terms in any order errs by at most n * 2^-24 times that.
 */
#ifndef V2V_TEST_TWIN_CONV_H
#define V2V_TEST_TWIN_CONV_H

#include "v2v3d/op/conv.h"
#include <stdint.h>

struct twin {
    double *value;
    double *moduli; /**< NULL: not wanted */
};

/** Without the activation. */
void twin_conv_forward(struct twin out, const struct v2v_conv_spec *spec, const float *in,
                       const float *weight, const float *bias);
void twin_conv_backward_data(struct twin din, const struct v2v_conv_spec *spec, const float *dout,
                             const float *weight);
void twin_conv_backward_weights(struct twin dweight, const struct v2v_conv_spec *spec,
                                const float *in, const float *dout);

/** Bilinear, align-corners, one plane. */
void twin_bilinear(double *out, const float *in, int64_t height, int64_t width, int factor);

#endif
