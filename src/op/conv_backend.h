/** What computes a convolution: one table of functions a backend. Inside room op; the tests and the
 *  bench name a backend through v2v_conv_create_with. */
#ifndef OP_CONV_BACKEND_H
#define OP_CONV_BACKEND_H

#include "v2v3d/op/conv.h"

/** As in conv.h, with the backend's own state; where one computes less than all, the activation of
 *  the input and dbias are the interface's work. */
struct v2v_conv_backend {
    const char *name;
    enum v2v_status (*create)(void **state, const struct v2v_conv_spec *spec);
    void (*destroy)(void *state);
    void (*set_weights)(void *state, const float *weight, const float *bias);
    void (*forward)(void *state, float *out, const float *in);
    void (*backward_data)(void *state, float *din, const float *dout);
    void (*backward_weights)(void *state, float *dweight, const float *in, const float *dout);
    /** All at once for a backend that upsamples itself; NULL: nothing would be saved. */
    void (*backward)(void *state, const struct v2v_gradients *to, const float *in,
                     const float *dout);
    /** A part of the output; NULL: it knows no tiles. */
    void (*forward_tiles)(void *state, float *out, const float *in, const struct v2v_tiles *tiles);
    /** Some rows of one image; NULL: it knows no lines. Threads may call it together. */
    void (*forward_lines)(const void *state, const struct v2v_lines *out,
                          const struct v2v_lines *in, int64_t first, int64_t rows);
};

extern const struct v2v_conv_backend v2v_conv_onednn;
extern const struct v2v_conv_backend v2v_conv_bf16; /**< by oneDNN */
extern const struct v2v_conv_backend v2v_conv_amx;  /**< bf16 by our own kernel */
extern const struct v2v_conv_backend v2v_conv_openblas;
extern const struct v2v_conv_backend v2v_conv_direct;
extern const struct v2v_conv_backend v2v_conv_winograd;

/** The backend that v2v_conv_create takes. @kind Local. */
const struct v2v_conv_backend *v2v_conv_choose(const struct v2v_conv_spec *spec);

/** v2v_conv_create with the backend given. @kind Local. */
enum v2v_status v2v_conv_create_with(struct v2v_conv **conv, const struct v2v_conv_spec *spec,
                                     const struct v2v_conv_backend *backend) V2V_MUST_CHECK;

/** Weights of the data gradient seen as a convolution of stride 1: [in,out,k,k], rotated by 180
 *  degrees. @kind Local. */
void v2v_conv_flip_weights(float *flipped, const float *weight, const struct v2v_conv_spec *spec);

static inline int64_t conv_out_height(const struct v2v_conv_spec *spec)
{
    return (spec->height - 1) / spec->stride + 1;
}

static inline int64_t conv_out_width(const struct v2v_conv_spec *spec)
{
    return (spec->width - 1) / spec->stride + 1;
}

#endif
