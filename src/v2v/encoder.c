#include "v2v/encoder_state.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/slots.h"

#include <string.h>

#define LEAKY 0.01f
#define PREFIX "feat_extract"

static const struct {
    const char *first, *second, *skip; /* skip NULL: the identity */
    int in, out;
} block_table[BLOCKS] = {
    {"layer1.0.conv.0", "layer1.0.conv.2", NULL, 4, 4},
    {"layer1.1.conv.0", "layer1.1.conv.2", NULL, 4, 4},
    {"layer2.0.conv.0", "layer2.0.conv.2", "layer2.0.downsample.conv", 4, 8},
    {"layer2.1.conv.0", "layer2.1.conv.2", NULL, 8, 8},
    {"layer3.0.conv.0", "layer3.0.conv.2", "layer3.0.downsample.conv", 8, 16},
    {"layer3.1.conv.0", "layer3.1.conv.2", NULL, 16, 16},
};
static const char *const level_name[LEVELS] = {"branch1.1.conv", "branch2.1.conv",
                                               "branch3.1.conv"};

static enum v2v_status declare_all(struct v2v_encoder *encoder, struct v2v_fields *fields)
{
    enum v2v_status rc = V2V_OK;
    encoder->entry =
        (struct v2v_layer){.in = 1, .out = 4, .kernel = 3, .stride = 1, .slope = LEAKY};
    encoder->fuse = (struct v2v_layer){
        .in = CONCATENATED, .out = DEEP, .kernel = 3, .stride = 1, .slope = LEAKY};
    encoder->last = (struct v2v_layer){
        .in = DEEP, .out = encoder->features, .kernel = 1, .stride = 1, .slope = LEAKY};
    V2V_TRY(v2v_layer_declare(&encoder->entry, fields, PREFIX, "conv1.0"));
    for (int b = 0; b < BLOCKS; b++) {
        struct block *block = &encoder->block[b];
        int in = block_table[b].in, out = block_table[b].out;
        block->first =
            (struct v2v_layer){.in = in, .out = out, .kernel = 3, .stride = 1, .slope = LEAKY};
        block->second =
            (struct v2v_layer){.in = out, .out = out, .kernel = 3, .stride = 1, .slope = 1.0f};
        block->skip =
            (struct v2v_layer){.in = in, .out = out, .kernel = 1, .stride = 1, .slope = 1.0f};
        block->has_skip = block_table[b].skip != NULL;
        V2V_TRY(v2v_layer_declare(&block->first, fields, PREFIX, block_table[b].first));
        V2V_TRY(v2v_layer_declare(&block->second, fields, PREFIX, block_table[b].second));
        if (block->has_skip) {
            V2V_TRY(v2v_layer_declare(&block->skip, fields, PREFIX, block_table[b].skip));
        }
    }
    for (int k = 0; k < LEVELS; k++) {
        struct level *level = &encoder->level[k];
        level->factor = 2 << k;
        level->conv = (struct v2v_layer){
            .in = DEEP, .out = LEVEL_FEATURES, .kernel = 1, .stride = 1, .slope = LEAKY};
        V2V_TRY(v2v_layer_declare(&level->conv, fields, PREFIX, level_name[k]));
    }
    V2V_TRY(v2v_layer_declare(&encoder->fuse, fields, PREFIX, "lastconv.0.conv"));
    V2V_TRY(v2v_layer_declare(&encoder->last, fields, PREFIX, "lastconv.2"));
done:
    return rc;
}

enum v2v_status v2v_encoder_create(struct v2v_encoder **encoder, struct v2v_fields *fields,
                                   int64_t features)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(*encoder, "encoder", 1));
    (*encoder)->features = features;
    V2V_TRY(declare_all(*encoder, fields));
done:
    if (rc != V2V_OK) {
        v2v_encoder_destroy(encoder);
    }
    return rc;
}

/* Only where the parameters lie and the table of layers are taken over: nothing is planned yet. */
enum v2v_status v2v_encoder_twin(struct v2v_encoder **twin, const struct v2v_encoder *encoder)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(encoder->batch == 0);
    V2V_TRY(V2V_ALLOC(*twin, "encoder", 1));
    **twin = *encoder;
done:
    return rc;
}

/* Steps of the computation: the entry, the blocks, the pyramid, the two last layers; or in one
 * step, in lines. Training keeps everything. */
enum { ENTRY, BLOCK, PYRAMID = BLOCK + BLOCKS, FUSE, LAST, END, STREAM };

/* A buffer of `channels` images whose sides are smaller by `factor`. */
static struct v2v_slot needed(const struct v2v_encoder *encoder, float **memory, int64_t channels,
                              int factor, int first, int last)
{
    int64_t pixels = (encoder->height / factor) * (encoder->width / factor);
    return (struct v2v_slot){.memory = memory,
                             .floats = v2v_mem_product(encoder->batch, channels, pixels),
                             .first = encoder->training ? ENTRY : first,
                             .last = encoder->training ? END : last};
}

static int64_t list_slots(struct v2v_slot *slot, struct v2v_encoder *encoder)
{
    int64_t n = 0;
    slot[n++] = needed(encoder, &encoder->entered, 4, 1, ENTRY, BLOCK);
    for (int b = 0; b < BLOCKS; b++) {
        struct block *block = &encoder->block[b];
        int out = block_table[b].out, step = BLOCK + b;
        slot[n++] = needed(encoder, &block->middle, out, 1, step, step);
        slot[n++] = needed(encoder, &block->out, out, 1, step, step + 1);
    }
    for (int k = 0; k < LEVELS; k++) {
        struct level *level = &encoder->level[k];
        slot[n++] = needed(encoder, &level->pooled, DEEP, level->factor, PYRAMID, PYRAMID);
        slot[n++] = needed(encoder, &level->small, LEVEL_FEATURES, level->factor, PYRAMID, PYRAMID);
    }
    slot[n++] = needed(encoder, &encoder->concatenated, CONCATENATED, 1, PYRAMID, FUSE);
    slot[n++] = needed(encoder, &encoder->fused, DEEP, 1, FUSE, LAST);
    slot[n++] = needed(encoder, &encoder->output, encoder->features, 1, LAST, END);
    slot[n++] = needed(encoder, &encoder->scratch, DEEP, 1, BLOCK, BLOCK + BLOCKS - 1);
    for (int k = 0; k < LEVELS && v2v_encoder_may_stream(encoder); k++) {
        struct stream *stream = &encoder->stream;
        int factor = encoder->level[k].factor;
        slot[n++] = needed(encoder, &stream->pooled[k], DEEP, factor, STREAM, STREAM);
        slot[n++] = needed(encoder, &stream->small[k], LEVEL_FEATURES, factor, STREAM, STREAM);
    }
    if (v2v_encoder_may_stream(encoder)) {
        struct stream *stream = &encoder->stream;
        slot[n++] = needed(encoder, &stream->output, encoder->features, 1, STREAM, STREAM);
        slot[n] = needed(encoder, &stream->joined, 0, 1, STREAM, STREAM);
        slot[n++].floats = v2v_encoder_stream_floats(encoder);
    }
    for (int k = 0; k < GRADIENTS && encoder->training; k++) {
        int64_t channels = k == 0 ? CONCATENATED : DEEP;
        slot[n++] = needed(encoder, &encoder->gradient[k], channels, 1, ENTRY, END);
    }
    return n;
}

enum { MAX_SLOTS = 1 + 2 * BLOCKS + 4 * LEVELS + 6 + GRADIENTS };

/* Every layer with the factor by which its input's sides are smaller. */
struct planned {
    struct v2v_layer *layer;
    int factor;
};

static int64_t list_layers(struct planned *list, struct v2v_encoder *encoder)
{
    int64_t n = 0;
    list[n++] = (struct planned){&encoder->entry, 1};
    for (int b = 0; b < BLOCKS; b++) {
        list[n++] = (struct planned){&encoder->block[b].first, 1};
        list[n++] = (struct planned){&encoder->block[b].second, 1};
        if (encoder->block[b].has_skip) {
            list[n++] = (struct planned){&encoder->block[b].skip, 1};
        }
    }
    for (int k = 0; k < LEVELS; k++) {
        list[n++] = (struct planned){&encoder->level[k].conv, encoder->level[k].factor};
    }
    list[n++] = (struct planned){&encoder->fuse, 1};
    list[n++] = (struct planned){&encoder->last, 1};
    return n;
}

enum { MAX_LAYERS = 3 + 3 * BLOCKS + LEVELS };

void v2v_encoder_destroy(struct v2v_encoder **encoder)
{
    if (*encoder == NULL) {
        return;
    }
    struct planned list[MAX_LAYERS];
    int64_t count = list_layers(list, *encoder);
    for (int64_t i = 0; i < count; i++) {
        v2v_layer_fini(list[i].layer);
    }
    v2v_encoder_stream_fini(*encoder);
    v2v_mem_free(*encoder);
    *encoder = NULL;
}

int64_t v2v_encoder_workspace(struct v2v_encoder *encoder, int64_t batch, int64_t height,
                              int64_t width, int training)
{
    struct v2v_slot slot[MAX_SLOTS];
    encoder->batch = batch;
    encoder->height = height;
    encoder->width = width;
    encoder->training = training;
    return v2v_slots_pack(slot, list_slots(slot, encoder));
}

enum v2v_status v2v_encoder_plan(struct v2v_encoder *encoder, float *workspace,
                                 const struct v2v_conv_method *method)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slot slot[MAX_SLOTS];
    struct planned list[MAX_LAYERS];
    int64_t slots = list_slots(slot, encoder);
    (void)v2v_slots_pack(slot, slots);
    v2v_slots_place(slot, slots, workspace);
    int64_t layers = list_layers(list, encoder);
    for (int64_t i = 0; i < layers; i++) {
        V2V_TRY(v2v_layer_plan(list[i].layer, encoder->batch, encoder->height / list[i].factor,
                               encoder->width / list[i].factor, method, encoder->training));
    }
    V2V_TRY(v2v_encoder_stream_plan(encoder));
done:
    return rc;
}

void v2v_encoder_weights_changed(struct v2v_encoder *encoder,
                                 const struct v2v_parameters *parameters)
{
    struct planned list[MAX_LAYERS];
    int64_t count = list_layers(list, encoder);
    for (int64_t i = 0; i < count; i++) {
        v2v_layer_weights_changed(list[i].layer, parameters);
    }
}

static void add(float *sum, const float *x, int64_t count)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        sum[i] += x[i];
    }
}

/* Copy `channels` planes of every image between arrays with different channel counts. */
static void copy_channels(float *to, int64_t to_channels, const float *from, int64_t from_channels,
                          int64_t channels, int64_t batch, int64_t pixels)
{
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < batch; i++) {
        memcpy(to + i * to_channels * pixels, from + i * from_channels * pixels,
               (size_t)(channels * pixels) * sizeof *to);
    }
}

static void block_forward(struct block *block, const float *in, float *scratch, int64_t count)
{
    v2v_watchdog_beat("a block of the encoder");
    v2v_conv_forward(block->first.conv, block->middle, in);
    v2v_conv_forward(block->second.conv, block->out, block->middle);
    if (block->has_skip) {
        v2v_conv_forward(block->skip.conv, scratch, in);
        add(block->out, scratch, count);
    } else {
        add(block->out, in, count);
    }
}

const float *v2v_encoder_forward(struct v2v_encoder *encoder, const float *views)
{
    int64_t height = encoder->height, width = encoder->width, batch = encoder->batch;
    int64_t pixels = height * width;
    v2v_watchdog_beat("encoding views");
    if (v2v_encoder_streams(encoder)) {
        return v2v_encoder_stream_forward(encoder, views);
    }
    v2v_conv_forward(encoder->entry.conv, encoder->entered, views);
    const float *x = encoder->entered;
    for (int b = 0; b < BLOCKS; b++) {
        block_forward(&encoder->block[b], x, encoder->scratch, batch * block_table[b].out * pixels);
        x = encoder->block[b].out;
    }
    copy_channels(encoder->concatenated, CONCATENATED, x, DEEP, DEEP, batch, pixels);
    for (int k = 0; k < LEVELS; k++) {
        struct level *level = &encoder->level[k];
        int64_t y = height / level->factor, w = width / level->factor;
        v2v_watchdog_beat("a level of the encoder");
        v2v_avgpool_forward(level->pooled, x, batch * DEEP, height, width, level->factor);
        v2v_conv_forward(level->conv.conv, level->small, level->pooled);
        for (int64_t i = 0; i < batch; i++) {
            float *place =
                encoder->concatenated + (i * CONCATENATED + DEEP + k * LEVEL_FEATURES) * pixels;
            v2v_bilinear_forward(place, level->small + i * LEVEL_FEATURES * y * w, LEVEL_FEATURES,
                                 y, w, level->factor);
        }
    }
    v2v_conv_forward(encoder->fuse.conv, encoder->fused, encoder->concatenated);
    v2v_conv_forward(encoder->last.conv, encoder->output, encoder->fused);
    return encoder->output;
}

/* gradient: of the block's output on entry, of its input on return. */
static void block_backward(struct block *block, const struct v2v_parameters *parameters,
                           float *gradient, float *inner, float *scratch, const float *in,
                           int64_t batch_pixels)
{
    int64_t in_count = block->first.in * batch_pixels, out_count = block->first.out * batch_pixels;
    v2v_watchdog_beat("the gradient of a block of the encoder");
    v2v_layer_backward_weights(&block->second, parameters, block->middle, gradient);
    v2v_conv_backward_data(block->second.conv, inner, gradient);
    v2v_leaky_backward(inner, inner, block->middle, out_count, LEAKY);
    v2v_layer_backward_weights(&block->first, parameters, in, inner);
    v2v_conv_backward_data(block->first.conv, scratch, inner);
    if (block->has_skip) {
        v2v_layer_backward_weights(&block->skip, parameters, in, gradient);
        v2v_conv_backward_data(block->skip.conv, inner, gradient);
        memcpy(gradient, inner, (size_t)in_count * sizeof *gradient);
    }
    add(gradient, scratch, in_count);
}

/* Gradient of the concatenation -> gradient of the deepest features, through all levels. */
static void levels_backward(struct v2v_encoder *encoder, const struct v2v_parameters *parameters,
                            float *gradient, const float *dconcatenated, float *scratch)
{
    int64_t height = encoder->height, width = encoder->width, batch = encoder->batch;
    int64_t pixels = height * width;
    copy_channels(gradient, DEEP, dconcatenated, CONCATENATED, DEEP, batch, pixels);
    for (int k = 0; k < LEVELS; k++) {
        struct level *level = &encoder->level[k];
        int64_t y = height / level->factor, x = width / level->factor;
        v2v_watchdog_beat("the gradient of a level of the encoder");
        float *dsmall = encoder->scratch; /* [batch,4,y,x], at most a quarter of 16 channels */
        float *dpooled = encoder->fused;  /* no longer needed: [batch,16,y,x] */
        for (int64_t i = 0; i < batch; i++) {
            v2v_bilinear_backward(dsmall + i * LEVEL_FEATURES * y * x,
                                  dconcatenated +
                                      (i * CONCATENATED + DEEP + k * LEVEL_FEATURES) * pixels,
                                  LEVEL_FEATURES, y, x, level->factor);
        }
        v2v_leaky_backward(dsmall, dsmall, level->small, batch * LEVEL_FEATURES * y * x, LEAKY);
        v2v_layer_backward_weights(&level->conv, parameters, level->pooled, dsmall);
        v2v_conv_backward_data(level->conv.conv, dpooled, dsmall);
        v2v_avgpool_backward(scratch, dpooled, batch * DEEP, height, width, level->factor);
        add(gradient, scratch, batch * DEEP * pixels);
    }
}

void v2v_encoder_backward(struct v2v_encoder *encoder, const struct v2v_parameters *parameters,
                          float *dfeatures, const float *views)
{
    int64_t batch_pixels = encoder->batch * encoder->height * encoder->width;
    float *dconcatenated = encoder->gradient[0];
    float *gradient = encoder->gradient[1], *inner = encoder->gradient[2];
    v2v_leaky_backward(dfeatures, dfeatures, encoder->output, encoder->features * batch_pixels,
                       LEAKY);
    v2v_layer_backward_weights(&encoder->last, parameters, encoder->fused, dfeatures);
    v2v_conv_backward_data(encoder->last.conv, gradient, dfeatures);
    v2v_leaky_backward(gradient, gradient, encoder->fused, DEEP * batch_pixels, LEAKY);
    v2v_layer_backward_weights(&encoder->fuse, parameters, encoder->concatenated, gradient);
    v2v_conv_backward_data(encoder->fuse.conv, dconcatenated, gradient);
    levels_backward(encoder, parameters, gradient, dconcatenated, inner);
    for (int b = BLOCKS - 1; b >= 0; b--) {
        const float *in = b > 0 ? encoder->block[b - 1].out : encoder->entered;
        block_backward(&encoder->block[b], parameters, gradient, inner, encoder->scratch, in,
                       batch_pixels);
    }
    v2v_leaky_backward(gradient, gradient, encoder->entered, 4 * batch_pixels, LEAKY);
    v2v_layer_backward_weights(&encoder->entry, parameters, views, gradient);
}
