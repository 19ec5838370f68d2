/* Alignment and the first 3 x 3 convolution of a U-Net in one: a convolution with sparse taps over
 * the feature planes (REFERENCE.md 8). The aligned features never exist. */
#ifndef V2V3D_NN_ALIGN_CONV_H
#define V2V3D_NN_ALIGN_CONV_H

#include "v2v3d/base/status.h"
#include "v2v3d/optics/shifts.h"
#include <stdint.h>

struct v2v_align_conv;

/* The features of all views with a ring of zeros wide enough for every tap. */
struct v2v_padded {
    int64_t views, features, height, width;
    int64_t ring;
    float *data; /* [view,feature,height+2*ring,width+2*ring] */
};

enum v2v_status v2v_padded_init(struct v2v_padded *padded, int64_t views, int64_t features,
                                int64_t height, int64_t width, int64_t ring) V2V_MUST_CHECK;
void v2v_padded_fini(struct v2v_padded *padded);

/* Copy one view's features [feature,y,x] in, and add what the ring's inside holds back to them. */
void v2v_padded_put(struct v2v_padded *padded, int64_t view, const float *features);
void v2v_padded_get(const struct v2v_padded *padded, int64_t view, float *features);

struct v2v_align_conv_spec {
    const int32_t *views; /* the branch's views, in network order */
    int64_t view_count;
    int64_t features, out;
    float slope; /* of the activation after it */
    int backend; /* of the matrix products */
};

enum v2v_status v2v_align_conv_create(struct v2v_align_conv **conv, const struct v2v_shifts *shifts,
                                      const struct v2v_align_conv_spec *spec) V2V_MUST_CHECK;
void v2v_align_conv_destroy(struct v2v_align_conv **conv);

/* Scratch for frames of [height,width]. */
enum v2v_status v2v_align_conv_plan(struct v2v_align_conv *conv, int64_t height, int64_t width,
                                    int training) V2V_MUST_CHECK;

/* Merge the full weights [out,(view,feature,z),3,3]; bias [out] is borrowed. */
void v2v_align_conv_set_weights(struct v2v_align_conv *conv, const float *weight,
                                const float *bias);

/* out[o,y,x] = leaky(bias + sum of taps). */
void v2v_align_conv_forward(struct v2v_align_conv *conv, float *out,
                            const struct v2v_padded *features);

/* dweight, dbias and dfeatures are added to; dout is the gradient before the activation. */
void v2v_align_conv_backward(struct v2v_align_conv *conv, float *dweight, float *dbias,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features,
                             const float *dout);

/* Multiply-adds of one output pixel in the middle of the frame. */
int64_t v2v_align_conv_work(const struct v2v_align_conv *conv);

#endif
