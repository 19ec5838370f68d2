/** What the network is made of: convolution, pooling, upsampling, activation, matrix product; each
 *  forward and backward.
 *
 *  Purpose: the only room that speaks oneDNN and BLAS. A network layer sees one interface whatever
 *  computes it.
 *  Invariants: arrays are float32 [n,c,y,x], but for the blocked bf16 images (op/blocked.h) that a
 *  specification asks for; gradients of weights are added to, or set where v2v_gradients says so,
 * those of data are overwritten; primitives, packed weights and scratch are made at creation,
 * nothing is allocated afterwards; the same thread count gives the same bits.
 *
 *  Example (compiled by tests/unit/op):
 *
 *      struct v2v_conv_spec spec = {.batch = 1, .in = 8, .out = 16, .height = 64, .width = 64,
 *                                   .kernel = 3, .stride = 1, .slope = 0.01f, .training = 1};
 *      V2V_TRY(v2v_conv_create(&conv, &spec));
 *      v2v_conv_set_weights(conv, weight, bias);
 *      v2v_conv_forward(conv, out, in);
 *  done:
 *      v2v_conv_destroy(&conv);
 */
#ifndef V2V3D_OP_CONV_H
#define V2V3D_OP_CONV_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/op/blocked.h"
#include "v2v3d/op/gradients.h"
#include "v2v3d/op/lines.h"
#include "v2v3d/op/pool.h"
#include "v2v3d/op/tiles.h"
#include "v2v3d/op/workspace.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What computes convolutions. */
struct v2v_conv_method {
    int backend;  /**< enum v2v_backend; layers of few channels take our own direct kernel whatever
                       the backend, where that is faster */
    int winograd; /**< 1: Winograd for 3 x 3 kernels where it is faster */
    struct v2v_workspace *workspace; /**< of all operators; winograd and the alignment need it */
    struct v2v_pool *pool; /**< of packed weights, which winograd and the alignment use; or NULL */
    int precision; /**< V2V_PRECISION_F32 or _BF16: 3 x 3 layers that are not too small for it round
                        images and weights to bf16 and add up in float32, whatever the backend;
                        needs v2v_op_bf16 */
    int keeps;     /**< 1: backward is always for the input of the forward pass before it; what that
                        made of one may be kept, for more memory */
};

/** Convolution with bias, zero padding (kernel-1)/2. */
struct v2v_conv_spec {
    int64_t batch, in, out;
    int64_t height, width; /**< convolved; the output has (height-1)/stride + 1 rows */
    int kernel;            /**< 1 or 3 */
    int stride;            /**< 1 or 2 */
    float slope;           /**< negative slope of the fused activation, 1: none */
    int training;          /**< backward will be called */
    int upsample;          /**< 1: the input has half the rows and columns, each pixel of it is
                                repeated 2 x 2 (stride 1, even sizes) */
    struct v2v_conv_method method;
    int in_form, out_form; /**< enum v2v_form: of images; blocked where v2v_conv_takes_blocked */
};

struct v2v_conv;

/** Plan for the threads that OpenMP has now (v2v_op_set_threads comes first).
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL (sizes that overflow; the library
 *          refused: its message; bf16 where v2v_op_bf16 has none) */
enum v2v_status v2v_conv_create(struct v2v_conv **conv,
                                const struct v2v_conv_spec *spec) V2V_MUST_CHECK;
void v2v_conv_destroy(struct v2v_conv **conv);

/** Can its images be blocked? One image of an inference in bf16 by the tile unit; what is upsampled
 *  comes plain. @kind Local. */
int v2v_conv_takes_blocked(const struct v2v_conv_spec *spec);

/** Pack weights for the primitives; once after every change. The arrays are borrowed until the next
 *  call. @kind Local. @param weight [out,in,k,k] @param bias [out] */
void v2v_conv_set_weights(struct v2v_conv *conv, const float *weight, const float *bias);

/** out = leaky(conv(in) + bias) with the negative slope of the specification.
 *  @kind Local. @param out [batch,out,oy,ox], @param in [batch,in,y,x], with upsample
 *  [batch,in,y/2,x/2]; or blocked, by the forms of the specification; no overlap */
void v2v_conv_forward(struct v2v_conv *conv, float *out, const float *in);

/** These tiles of the output alone, to the bits of all; the rest of it is left as it is, or
 * computed where the backend knows no tiles. One image, stride 1. @kind Local. */
void v2v_conv_forward_tiles(struct v2v_conv *conv, float *out, const float *in,
                            const struct v2v_tiles *tiles);

/** Does v2v_conv_forward_lines know this convolution? Those of few channels it does. */
int v2v_conv_takes_lines(const struct v2v_conv *conv);

/** Rows [first, first + rows) of the output of one image, to the bits of v2v_conv_forward; nothing
 *  else of `out` is written. Rows first - 1 to first + rows of `in` are read, of a 1 x 1 kernel
 * only those that are written. @kind Local; by one thread alone, others may call it at the same
 * time. */
void v2v_conv_forward_lines(const struct v2v_conv *conv, const struct v2v_lines *out,
                            const struct v2v_lines *in, int64_t first, int64_t rows);

/** din = adjoint of the convolution applied to dout (the gradient before the activation).
 *  @kind Local. */
void v2v_conv_backward_data(struct v2v_conv *conv, float *din, const float *dout);

/** dweight += , dbias += (NULL: not wanted). @kind Local. */
void v2v_conv_backward_weights(struct v2v_conv *conv, float *dweight, float *dbias, const float *in,
                               const float *dout);

/** All that is wanted, to the same bits; faster where it shares work. @param in the input of the
 *  forward pass, after its activation where there was one. @kind Local. */
void v2v_conv_backward(struct v2v_conv *conv, const struct v2v_gradients *to, const float *in,
                       const float *dout);

/** dbias [channels] += sums over batch and pixels of dout [batch,channels,rows,columns]: rows in
 *  float32, their sums in double precision, one addition each. @kind Local. */
void v2v_bias_gradient(float *dbias, const float *dout, int64_t batch, int64_t channels,
                       int64_t rows, int64_t columns);

#ifdef __cplusplus
}
#endif

#endif
