/* A convolution layer of the network: its place in the table of parameters and its primitive. */
#ifndef V2V3D_NN_LAYER_H
#define V2V3D_NN_LAYER_H

#include "v2v3d/op/conv.h"
#include "v2v3d/tensor/fields.h"

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_layer {
    int64_t weight, bias; /* places in the table of fields */
    int64_t in, out;
    int kernel, stride;
    float in_slope;        /* negative slope of the activation before it, 0: none of its own */
    float slope;           /* of the activation after it, 1: none */
    int is_last;           /* 1: its output is the network's */
    int upsample;          /* 1: the input is repeated 2 x 2 before it */
    int in_form, out_form; /* enum v2v_form of its images, for the next plan */
    struct v2v_conv *conv; /* NULL until planned */
};

/* Values and gradients of all parameters, in the order of the table. */
struct v2v_parameters {
    const struct v2v_fields *fields;
    float *weights, *gradients;
    void (*ready)(void *context, int64_t first, int64_t count); /* may be NULL */
    void *context;
};

/* Tell who watches that the gradients of these fields are final. */
void v2v_parameters_ready(const struct v2v_parameters *parameters, int64_t first_field,
                          int64_t last_field);

/* Add NAME.weight [out,in,k,k] and NAME.bias [out] to the table. `layer` has its sizes already. */
enum v2v_status v2v_layer_declare(struct v2v_layer *layer, struct v2v_fields *fields,
                                  const char *prefix, const char *name) V2V_MUST_CHECK;

/* What a plan does for backward passes: nothing; what they need; or keeping what they would
 * transform again, too. */
enum v2v_training { V2V_TRAINING_OFF, V2V_TRAINING_LEAN, V2V_TRAINING_KEEPS };

/* (Re-)create the primitive for inputs of [batch,in,height,width]. */
enum v2v_status v2v_layer_plan(struct v2v_layer *layer, int64_t batch, int64_t height,
                               int64_t width, const struct v2v_conv_method *method,
                               int training) V2V_MUST_CHECK;

/* Could its images be blocked, whatever their size? */
int v2v_layer_takes_blocked(const struct v2v_layer *layer, const struct v2v_conv_method *method,
                            int training);

void v2v_layer_fini(struct v2v_layer *layer);

/* The values of its parameters changed. A layer that is not planned has nothing to renew. */
void v2v_layer_weights_changed(struct v2v_layer *layer, const struct v2v_parameters *parameters);

/* Add to the gradients of the parameters, from the layer's input and the gradient before its
 * activation. */
void v2v_layer_backward_weights(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                                const float *in, const float *dout);

/* Set them (`parameters` NULL: leave them), and the gradient of the input before the activation
 * that made it. */
void v2v_layer_backward(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                        float *din, const float *in, const float *dout);

/* The value or gradient array of a field. */
static inline float *v2v_parameter(const struct v2v_fields *fields, float *arena, int64_t index)
{
    return arena + fields->item[index].offset;
}

#ifdef __cplusplus
}
#endif

#endif
