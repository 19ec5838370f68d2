/* Forward and backward of a U-Net. Layers compute image by image: a deep one sees its neighbours as
 * further channels, which lie where they are (nn/stack.h), so that nothing is copied; a layer that
 * makes a skip writes it where it is joined. */
#include "nn/unet_state.h"

#include "v2v3d/base/status.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/bulk.h"

#include <string.h>

/* Does the layer convolve three images as one? */
static int is_deep_layer(const struct v2v_plain_unet *unet, int i)
{
    return unet->spec.is_deep && unet->layer[i].kernel == 3;
}

/* The image, or the three images, that make image d of the layer's output. */
static const float *input_of(const struct v2v_plain_unet *unet, int i, int64_t d)
{
    return v2v_stack_at(&unet->stack[unet->wire[i].from], d - is_deep_layer(unet, i), 0);
}

static void run(struct v2v_plain_unet *unet, int i, float *out)
{
    const struct v2v_layer *layer = &unet->layer[i];
    const struct v2v_stack *from = &unet->stack[unet->wire[i].from];
    const int to = unet->wire[i].to;
    v2v_watchdog_beat("a layer of the U-Net");
    v2v_stack_clear_ends(from);
    for (int64_t d = 0; d < from->depth; d++) {
        float *image = to < 0 ? out + d * layer->out * v2v_stack_pixels(from)
                              : v2v_stack_at(&unet->stack[to], d, 0);
        v2v_conv_forward(layer->conv, image, input_of(unet, i, d));
    }
}

void v2v_plain_unet_forward(struct v2v_plain_unet *unet, float *out, const float *in)
{
    const struct v2v_stack *enters = &unet->stack[v2v_unet_stack(0, ENTERS)];
    v2v_bulk_copy(v2v_stack_at(enters, 0, 0), in,
                  enters->depth * enters->channels * v2v_stack_pixels(enters));
    for (int i = 0; i < unet->layers; i++) {
        run(unet, i, out);
        const int to = unet->wire[i].to, level = to / KINDS;
        if (to >= 0 && to % KINDS == JOINED) {
            v2v_stack_pool(&unet->stack[v2v_unet_stack(level + 1, ENTERS)], unet->which[level],
                           &unet->stack[to]);
        } else if (to >= 0 && to % KINDS == LEAVES && level > 0) {
            v2v_stack_repeat(&unet->stack[v2v_unet_stack(level - 1, JOINED)],
                             unet->spec.width << (level - 1), &unet->stack[to]);
        }
    }
}

/* The gradients of images d-1, d, d+1, in scratch, to theirs; image d+1 has none before, nor has
 * the first. */
static void share(const struct v2v_plain_unet *unet, const struct v2v_stack *gradient, int64_t d)
{
    const int64_t pixels = v2v_stack_pixels(gradient), channels = gradient->channels;
    const int64_t first = d > 0 ? -1 : 0, last = d + 1 < gradient->depth ? 1 : 0;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t k = first; k <= last; k++) {
        for (int64_t c = 0; c < channels; c++) {
            float *to = v2v_stack_at(gradient, d + k, c);
            const float *from = unet->scratch + ((k + 1) * channels + c) * pixels;
            if (k > 0 || d == 0) { /* k = 0 of the first */
                memcpy(to, from, (size_t)pixels * sizeof *to);
            } else {
                v2v_stack_add(to, from, pixels);
            }
        }
    }
}

/* All gradients are those before the activation that made an image: pools and repeats keep signs,
 * so that a layer finds in its input what that activation did. */
static void run_back(struct v2v_plain_unet *unet, int i, const struct v2v_parameters *parameters,
                     const float *dout)
{
    const struct v2v_layer *layer = &unet->layer[i];
    const struct v2v_stack *din = i > 0 ? &unet->gradient[unet->wire[i].from] : NULL;
    const int64_t depth = unet->stack[unet->wire[i].from].depth;
    const int to = unet->wire[i].to, is_deep = is_deep_layer(unet, i);
    v2v_watchdog_beat("the gradient of a layer of the U-Net");
    for (int64_t d = 0; d < depth; d++) {
        const struct v2v_gradients wanted = {
            .din = din == NULL ? NULL
                   : is_deep   ? unet->scratch
                               : v2v_stack_at(din, d, 0),
            .dweight = v2v_parameter(parameters->fields, parameters->gradients, layer->weight),
            .dbias = v2v_parameter(parameters->fields, parameters->gradients, layer->bias),
            .sets = d == 0,
            .in_slope = layer->in_slope};
        const int64_t pixels = v2v_stack_pixels(&unet->stack[unet->wire[i].from]);
        const float *image =
            to < 0 ? dout + d * layer->out * pixels : v2v_stack_at(&unet->gradient[to], d, 0);
        v2v_conv_backward(layer->conv, &wanted, input_of(unet, i, d), image);
        if (din != NULL && is_deep) {
            share(unet, din, d);
        }
    }
    v2v_parameters_ready(parameters, layer->weight, layer->bias);
}

void v2v_plain_unet_backward(struct v2v_plain_unet *unet, const struct v2v_parameters *parameters,
                             const float *dout)
{
    V2V_ASSERT(unet->training);
    for (int i = unet->layers - 1; i >= 0; i--) {
        run_back(unet, i, parameters, dout);
        const int from = unet->wire[i].from, level = from / KINDS;
        if (from % KINDS == JOINED) {
            v2v_stack_repeat_backward(&unet->gradient[v2v_unet_stack(level + 1, LEAVES)],
                                      &unet->gradient[from], unet->spec.width << level,
                                      unet->scratch);
        } else if (from % KINDS == ENTERS && level > 0) {
            v2v_stack_pool_backward(&unet->gradient[v2v_unet_stack(level - 1, JOINED)],
                                    &unet->gradient[from], unet->which[level - 1]);
        }
    }
}
