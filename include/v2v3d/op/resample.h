#ifndef V2V3D_OP_RESAMPLE_H
#define V2V3D_OP_RESAMPLE_H

#include "v2v3d/op/lines.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Pooling and upsampling of `planes` images [planes,y,x] (planes = batch * channels); sizes are
 * the input's. Odd rows and columns that fill no window take no part in pooling (their gradient is
 * 0). All @kind Local, deterministic; gradients of data are overwritten. */

/** Maximum over 2 x 2; `which` [planes,y/2,x/2] keeps the place 0..3 of the first maximum (NULL:
 * not kept). */
void v2v_maxpool2_forward(float *out, uint8_t *which, const float *in, int64_t planes,
                          int64_t height, int64_t width);
void v2v_maxpool2_backward(float *din, const float *dout, const uint8_t *which, int64_t planes,
                           int64_t height, int64_t width);

/** Mean over factor x factor. */
void v2v_avgpool_forward(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                         int factor);
void v2v_avgpool_backward(float *din, const float *dout, int64_t planes, int64_t height,
                          int64_t width, int factor);

/** Rows [first, first + rows) of the mean of all channels, [channel,y/factor,x/factor], to the bits
 *  of the above. By one thread alone. */
void v2v_avgpool_lines(float *out, const struct v2v_lines *in, int factor, int64_t first,
                       int64_t rows);

/** Each pixel repeated 2 x 2, and its adjoint. */
void v2v_nearest2_forward(float *out, const float *in, int64_t planes, int64_t height,
                          int64_t width);
void v2v_nearest2_backward(float *din, const float *dout, int64_t planes, int64_t height,
                           int64_t width);

/** Bilinear with align-corners, source = i * (n_in-1)/(n_out-1), to factor times the size (a side
 * of one pixel repeats it), and its adjoint. */
void v2v_bilinear_forward(float *out, const float *in, int64_t planes, int64_t height,
                          int64_t width, int factor);
/** Rows [first, first + rows) of the upsampled channels of in [channel,y/factor,x/factor], to the
 * same bits. By one thread alone. */
void v2v_bilinear_lines(const struct v2v_lines *out, const float *in, int factor, int64_t first,
                        int64_t rows);
void v2v_bilinear_backward(float *din, const float *dout, int64_t planes, int64_t height,
                           int64_t width, int factor);

#ifdef __cplusplus
}
#endif

#endif
