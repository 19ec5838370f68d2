/* The feature encoder of REFERENCE.md 4, the same for every view. */
#ifndef V2V3D_V2V_ENCODER_H
#define V2V3D_V2V_ENCODER_H

#include "v2v3d/nn/layer.h"

struct v2v_encoder;

/* Declare the parameters (prefix "feat_extract"). */
enum v2v_status v2v_encoder_create(struct v2v_encoder **encoder, struct v2v_fields *fields,
                                   int64_t features) V2V_MUST_CHECK;
/* Another workspace for the same parameters. */
enum v2v_status v2v_encoder_twin(struct v2v_encoder **twin,
                                 const struct v2v_encoder *encoder) V2V_MUST_CHECK;
void v2v_encoder_destroy(struct v2v_encoder **encoder);

/* Floats of workspace for `batch` views of [height,width] at once; then primitives, with that much
 * memory, borrowed. What the encoder leaves there, its features too, others may overwrite without
 * training. */
int64_t v2v_encoder_workspace(struct v2v_encoder *encoder, int64_t batch, int64_t height,
                              int64_t width, int training);
enum v2v_status v2v_encoder_plan(struct v2v_encoder *encoder, float *workspace,
                                 const struct v2v_conv_method *method) V2V_MUST_CHECK;
void v2v_encoder_weights_changed(struct v2v_encoder *encoder,
                                 const struct v2v_parameters *parameters);

/* Features [batch,features,y,x] of views [batch,y,x]; they live in the encoder until the next call.
 */
const float *v2v_encoder_forward(struct v2v_encoder *encoder, const float *views);

/* Add the gradients of the parameters; `dfeatures` is used up. `views` as in the last forward. */
void v2v_encoder_backward(struct v2v_encoder *encoder, const struct v2v_parameters *parameters,
                          float *dfeatures, const float *views);

#endif
