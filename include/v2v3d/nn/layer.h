/** A convolution layer of a network: its place in the table of parameters and its primitive, which
 *  a network's forward pass runs (op/conv.h). Images are [batch,channels,y,x], or blocked
 *  (op/blocked.h). */
#ifndef V2V3D_NN_LAYER_H
#define V2V3D_NN_LAYER_H

#include "v2v3d/op/conv.h"
#include "v2v3d/tensor/fields.h"

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_layer {
    int64_t weight, bias; /**< places in the table of fields */
    int64_t in, out;      /**< channels */
    int kernel, stride;
    float in_slope;        /**< negative slope of the activation before it, 0: none of its own */
    float slope;           /**< of the activation after it, 1: none */
    int is_last;           /**< 1: its output is the network's */
    int upsample;          /**< 1: the input is repeated 2 x 2 before it */
    int in_form, out_form; /**< enum v2v_form of its images, for the next plan */
    struct v2v_conv *conv; /**< NULL until planned */
};

/** Values and gradients of all parameters, in the order of the table. */
struct v2v_parameters {
    const struct v2v_fields *fields;
    float *weights, *gradients;
    void (*ready)(void *context, int64_t first, int64_t count); /**< may be NULL */
    void *context;
};

/** Tell who watches that the gradients of these fields are final. @kind Local. */
void v2v_parameters_ready(const struct v2v_parameters *parameters, int64_t first_field,
                          int64_t last_field);

/** Add PREFIX.NAME.weight [out,in,k,k] and PREFIX.NAME.bias [out] to the table. `layer` has its
 *  sizes already. @kind Local. @return as v2v_fields_add, or V2V_E_INPUT (a name
 *  too long) */
enum v2v_status v2v_layer_declare(struct v2v_layer *layer, struct v2v_fields *fields,
                                  const char *prefix, const char *name) V2V_MUST_CHECK;

/** What a plan does for backward passes: nothing; what they need; or keeping what they would
 *  transform again, too. */
enum v2v_training { V2V_TRAINING_OFF, V2V_TRAINING_LEAN, V2V_TRAINING_KEEPS };

/** (Re-)create the primitive for inputs of [batch,in,height,width].
 *  @kind Local. @param training enum v2v_training @return as v2v_conv_create */
enum v2v_status v2v_layer_plan(struct v2v_layer *layer, int64_t batch, int64_t height,
                               int64_t width, const struct v2v_conv_method *method,
                               int training) V2V_MUST_CHECK;

/** Could its images be blocked, whatever their size? @kind Local. */
int v2v_layer_takes_blocked(const struct v2v_layer *layer, const struct v2v_conv_method *method,
                            int training);

/** @kind Local; also of one that was never planned. */
void v2v_layer_fini(struct v2v_layer *layer);

/** The values of its parameters changed. A layer that is not planned has nothing to renew.
 *  @kind Local. */
void v2v_layer_weights_changed(struct v2v_layer *layer, const struct v2v_parameters *parameters);

/** Add to the gradients of the parameters, from the layer's input and the gradient before its
 *  activation. @kind Local. @param in [batch,in,height,width] of the plan
 *  @param dout [batch,out,y,x] of its output */
void v2v_layer_backward_weights(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                                const float *in, const float *dout);

/** Set them (`parameters` NULL: leave them), and the gradient of the input before the activation
 *  that made it. @kind Local. @param din as `in`, out @param in, dout as of backward_weights */
void v2v_layer_backward(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                        float *din, const float *in, const float *dout);

/** The value or gradient array of a field. @kind Local. */
static inline float *v2v_parameter(const struct v2v_fields *fields, float *arena, int64_t index)
{
    return arena + fields->item[index].offset;
}

#ifdef __cplusplus
}
#endif

#endif
