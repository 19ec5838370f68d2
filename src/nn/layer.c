#include "v2v3d/nn/layer.h"

#include "v2v3d/base/text.h"

void v2v_parameters_ready(const struct v2v_parameters *parameters, int64_t first_field,
                          int64_t last_field)
{
    const struct v2v_fields *fields = parameters->fields;
    int64_t first = fields->item[first_field].offset;
    int64_t end = last_field + 1 < fields->count ? fields->item[last_field + 1].offset /* padding */
                                                 : fields->total;
    if (parameters->ready != NULL) {
        parameters->ready(parameters->context, first, end - first);
    }
}

enum v2v_status v2v_layer_declare(struct v2v_layer *layer, struct v2v_fields *fields,
                                  const char *prefix, const char *name)
{
    enum v2v_status rc = V2V_OK;
    char text[V2V_FIELDS_NAME_BYTES];
    int64_t shape[4] = {layer->out, layer->in, layer->kernel, layer->kernel};
    V2V_TRY(v2v_text_format(text, sizeof text, "%s.%s.weight", prefix, name));
    V2V_TRY(v2v_fields_add(fields, &layer->weight, text, 4, shape));
    fields->item[layer->weight].starts_small = layer->is_last;
    V2V_TRY(v2v_text_format(text, sizeof text, "%s.%s.bias", prefix, name));
    V2V_TRY(v2v_fields_add(fields, &layer->bias, text, 1, shape));
done:
    return rc;
}

static struct v2v_conv_spec spec_of(const struct v2v_layer *layer, int64_t batch, int64_t height,
                                    int64_t width, const struct v2v_conv_method *method,
                                    int training)
{
    struct v2v_conv_spec spec = {.batch = batch,
                                 .in = layer->in,
                                 .out = layer->out,
                                 .height = height,
                                 .width = width,
                                 .kernel = layer->kernel,
                                 .stride = layer->stride,
                                 .slope = layer->slope,
                                 .upsample = layer->upsample,
                                 .method = *method,
                                 .training = training != V2V_TRAINING_OFF,
                                 .in_form = layer->in_form,
                                 .out_form = layer->out_form};
    spec.method.keeps = training == V2V_TRAINING_KEEPS;
    return spec;
}

int v2v_layer_takes_blocked(const struct v2v_layer *layer, const struct v2v_conv_method *method,
                            int training)
{
    struct v2v_conv_spec spec = spec_of(layer, 1, 1, 1, method, training);
    return v2v_conv_takes_blocked(&spec);
}

enum v2v_status v2v_layer_plan(struct v2v_layer *layer, int64_t batch, int64_t height,
                               int64_t width, const struct v2v_conv_method *method, int training)
{
    struct v2v_conv_spec spec = spec_of(layer, batch, height, width, method, training);
    v2v_conv_destroy(&layer->conv);
    return v2v_conv_create(&layer->conv, &spec);
}

void v2v_layer_fini(struct v2v_layer *layer)
{
    v2v_conv_destroy(&layer->conv);
}

void v2v_layer_weights_changed(struct v2v_layer *layer, const struct v2v_parameters *parameters)
{
    if (layer->conv == NULL) {
        return; /* not planned yet: planning takes the weights */
    }
    v2v_conv_set_weights(layer->conv,
                         v2v_parameter(parameters->fields, parameters->weights, layer->weight),
                         v2v_parameter(parameters->fields, parameters->weights, layer->bias));
}

void v2v_layer_backward_weights(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                                const float *in, const float *dout)
{
    v2v_conv_backward_weights(
        layer->conv, v2v_parameter(parameters->fields, parameters->gradients, layer->weight),
        v2v_parameter(parameters->fields, parameters->gradients, layer->bias), in, dout);
}

void v2v_layer_backward(struct v2v_layer *layer, const struct v2v_parameters *parameters,
                        float *din, const float *in, const float *dout)
{
    struct v2v_gradients to = {.din = din, .in_slope = layer->in_slope, .sets = 1};
    if (parameters != NULL) {
        to.dweight = v2v_parameter(parameters->fields, parameters->gradients, layer->weight);
        to.dbias = v2v_parameter(parameters->fields, parameters->gradients, layer->bias);
    }
    v2v_conv_backward(layer->conv, &to, in, dout);
}
