/* Winograd minimal filtering behind the interface of a backend: plain images, one after the
 * other. */
#include "op/conv_backend.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/winograd.h"

#include <string.h>

struct state {
    int64_t batch, in_floats, out_floats; /* of an image */
    int64_t out, out_height, out_width;
    struct v2v_winograd *winograd;
};

static void destroy(void *opaque)
{
    struct state *state = opaque;
    if (state != NULL) {
        v2v_winograd_destroy(&state->winograd);
        v2v_mem_free(state);
    }
}

static enum v2v_status create(void **opaque, const struct v2v_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_plane *plane = NULL;
    struct state *state = NULL;
    int half = spec->upsample;
    int64_t pixels = conv_out_height(spec) * conv_out_width(spec),
            in_pixels = (spec->height >> half) * (spec->width >> half);
    V2V_ASSERT(spec->kernel == 3 && spec->method.workspace != NULL);
    V2V_TRY(V2V_ALLOC(state, "conv", 1));
    V2V_TRY(V2V_ALLOC(plane, "conv", spec->in));
    for (int64_t i = 0; i < spec->in; i++) {
        plane[i] = (struct v2v_plane){
            .offset = i * in_pixels, .y1 = spec->height, .x1 = spec->width, .owner = i};
    }
    struct v2v_winograd_spec filter = {.in = spec->in,
                                       .out = spec->out,
                                       .height = spec->height,
                                       .width = spec->width,
                                       .plane = plane,
                                       .pitch = spec->width >> half,
                                       .half = half,
                                       .stride2 = spec->stride == 2,
                                       .slope = spec->slope,
                                       .training = spec->training,
                                       .keeps = spec->method.keeps && spec->batch == 1,
                                       .sets = 1,
                                       .workspace = spec->method.workspace,
                                       .pool = spec->method.pool};
    state->batch = spec->batch;
    state->in_floats = spec->in * in_pixels;
    state->out_floats = spec->out * pixels;
    state->out = spec->out;
    state->out_height = conv_out_height(spec);
    state->out_width = conv_out_width(spec);
    V2V_TRY(v2v_winograd_create(&state->winograd, &filter));
    *opaque = state;
    state = NULL;
done:
    v2v_mem_free(plane);
    destroy(state);
    return rc;
}

static void set_weights(void *opaque, const float *weight, const float *bias)
{
    struct state *state = opaque;
    v2v_winograd_set_weights(state->winograd, weight, bias);
}

static void forward(void *opaque, float *out, const float *in)
{
    struct state *state = opaque;
    for (int64_t n = 0; n < state->batch; n++) {
        v2v_winograd_forward(state->winograd, out + n * state->out_floats,
                             in + n * state->in_floats);
    }
}

static void forward_tiles(void *opaque, float *out, const float *in, const struct v2v_tiles *tiles)
{
    struct state *state = opaque;
    struct v2v_winograd_part part = {.run = tiles->run, .runs = tiles->first[tiles->rows]};
    v2v_winograd_forward_part(state->winograd, out, in, &part);
}

/* Of several images: their sum is one addition. */
static void give_bias_gradient(const struct state *state, const struct v2v_gradients *to,
                               const float *dout)
{
    if (to->sets) {
        memset(to->dbias, 0, (size_t)state->out * sizeof *to->dbias);
    }
    v2v_bias_gradient(to->dbias, dout, state->batch, state->out, state->out_height,
                      state->out_width);
}

static void backward(void *opaque, const struct v2v_gradients *to, const float *in,
                     const float *dout)
{
    struct state *state = opaque;
    if (state->batch > 1 && to->dbias != NULL) {
        give_bias_gradient(state, to, dout);
    }
    for (int64_t n = 0; n < state->batch; n++) {
        struct v2v_gradients image = *to;
        image.dbias = state->batch > 1 ? NULL : to->dbias;
        image.sets = to->sets && n == 0;
        image.din = to->din != NULL ? to->din + n * state->in_floats : NULL;
        v2v_winograd_backward(state->winograd, &image,
                              in != NULL ? in + n * state->in_floats : NULL,
                              dout + n * state->out_floats);
    }
}

static void backward_data(void *opaque, float *din, const float *dout)
{
    struct v2v_gradients to = {.din = din};
    backward(opaque, &to, NULL, dout);
}

static void backward_weights(void *opaque, float *dweight, const float *in, const float *dout)
{
    struct v2v_gradients to = {.dweight = dweight};
    backward(opaque, &to, in, dout);
}

const struct v2v_conv_backend v2v_conv_winograd = {.name = "Winograd",
                                                   .create = create,
                                                   .destroy = destroy,
                                                   .set_weights = set_weights,
                                                   .forward = forward,
                                                   .backward_data = backward_data,
                                                   .backward_weights = backward_weights,
                                                   .backward = backward,
                                                   .forward_tiles = forward_tiles};
