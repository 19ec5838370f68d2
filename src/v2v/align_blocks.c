#include "v2v/align_blocks.h"

#include "v2v/align_gather.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/nn/layer.h"
#include "v2v3d/op/tile_conv.h"
#include "v2v3d/op/winograd.h"
#include "v2v3d/optics/blocks.h"
#include "v2v3d/tensor/bulk.h"

#include <string.h>

enum { PLACES = 9 };

/* Channels of the convolution: [view][feature][block of the view]. */
struct v2v_align_blocks {
    struct v2v_align_conv_spec spec;
    int32_t *views; /* [view_count], owned */
    struct v2v_blocks blocks;
    int64_t channels;
    struct v2v_piece
        weight;      /* [out,channels,3,3]: of the blocks; their gradient too with winograd */
    float *gradient; /* of the blocks with gather, which borrows the weights; training */
    struct v2v_winograd *winograd;
    struct v2v_align_gather *gather; /* in bf16, in winograd's place .. */
    struct v2v_tile_conv *tile_conv; /* .. or of listed tiles alone */
};

enum v2v_status v2v_align_blocks_create(struct v2v_align_blocks **blocks,
                                        const struct v2v_shifts *shifts,
                                        const struct v2v_align_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_align_blocks *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "align_blocks", 1));
    self->spec = *spec;
    V2V_TRY(V2V_ALLOC(self->views, "align_blocks.views", spec->view_count));
    memcpy(self->views, spec->views, (size_t)spec->view_count * sizeof *self->views);
    V2V_TRY(v2v_blocks_create(&self->blocks, shifts, self->views, spec->view_count,
                              !spec->every_slice));
    self->channels = self->blocks.count * spec->features;
done:
    if (rc != V2V_OK) {
        v2v_align_blocks_destroy(&self);
    }
    *blocks = self;
    return rc;
}

void v2v_align_blocks_destroy(struct v2v_align_blocks **blocks)
{
    if (*blocks == NULL) {
        return;
    }
    v2v_winograd_destroy(&(*blocks)->winograd);
    v2v_align_gather_destroy(&(*blocks)->gather);
    v2v_tile_conv_destroy(&(*blocks)->tile_conv);
    v2v_blocks_fini(&(*blocks)->blocks);
    v2v_pool_give(&(*blocks)->weight);
    v2v_mem_free((*blocks)->gradient);
    v2v_mem_free((*blocks)->views);
    v2v_mem_free(*blocks);
    *blocks = NULL;
}

/* First channel of a view's feature. */
static int64_t first_channel(const struct v2v_align_blocks *self, int64_t i, int64_t feature)
{
    const int64_t *first = self->blocks.first;
    return first[i] * self->spec.features + feature * (first[i + 1] - first[i]);
}

/* Plane of a block: pixel (y,x) is the feature at (y + block.y, x + block.x). */
static struct v2v_plane plane_of(const struct v2v_align_blocks *self, const struct v2v_padded *like,
                                 int64_t i, int64_t feature, int64_t b)
{
    const struct v2v_block *block = &self->blocks.block[b];
    int64_t pitch = v2v_padded_pitch(like), ring = like->ring;
    struct v2v_plane plane = {.offset = v2v_padded_offset(like, self->views[i], feature) +
                                        block->y * pitch + block->x,
                              .y1 = like->height,
                              .x1 = like->width,
                              .owner = i * self->spec.features + feature};
    if (!self->spec.every_slice) {
        plane.y0 = -ring - block->y;
        plane.y1 = like->height + ring - block->y;
        plane.x0 = -ring - block->x;
        plane.x1 = like->width + ring - block->x;
    }
    return plane;
}

static enum v2v_status plan_winograd(struct v2v_align_blocks *self, const struct v2v_plane *plane,
                                     const struct v2v_align_conv_plan *plan)
{
    const struct v2v_padded *like = plan->like;
    struct v2v_winograd_spec filter = {.in = self->channels,
                                       .out = self->spec.out,
                                       .height = like->height,
                                       .out_rows = plan->out_rows,
                                       .width = like->width,
                                       .plane = plane,
                                       .pitch = v2v_padded_pitch(like),
                                       .slope = self->spec.slope,
                                       .training = plan->training != V2V_TRAINING_OFF,
                                       .keeps = plan->training == V2V_TRAINING_KEEPS,
                                       .workspace = self->spec.method.workspace,
                                       .pool = self->spec.method.pool};
    v2v_winograd_destroy(&self->winograd);
    return v2v_winograd_create(&self->winograd, &filter);
}

static struct v2v_conv_spec conv_spec(const struct v2v_align_blocks *self, int64_t height,
                                      int64_t width)
{
    return (struct v2v_conv_spec){.batch = 1,
                                  .in = self->channels,
                                  .out = self->spec.out,
                                  .height = height,
                                  .width = width,
                                  .kernel = 3,
                                  .stride = 1,
                                  .slope = self->spec.slope,
                                  .method = self->spec.method};
}

int v2v_align_blocks_takes_blocked(const struct v2v_align_blocks *self)
{
    struct v2v_conv_spec conv = conv_spec(self, 1, 1);
    return v2v_conv_takes_blocked(&conv);
}

static enum v2v_status plan_gather(struct v2v_align_blocks *self, const struct v2v_plane *plane,
                                   const struct v2v_align_conv_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_conv_spec conv = conv_spec(self, plan->like->height, plan->like->width);
    conv.training = plan->training != V2V_TRAINING_OFF;
    conv.out_form = plan->out_form;
    V2V_TRY(v2v_align_gather_create(&self->gather, &conv, plane, v2v_padded_pitch(plan->like)));
    if (conv.training && self->gradient == NULL) {
        V2V_TRY(V2V_ALLOC(self->gradient, "align_blocks.weights",
                          v2v_mem_product(conv.out, conv.in, PLACES)));
    }
done:
    return rc;
}

static enum v2v_status plan_listed(struct v2v_align_blocks *self, const struct v2v_plane *plane,
                                   const struct v2v_align_conv_plan *plan)
{
    const struct v2v_padded *like = plan->like;
    const struct v2v_tile_conv_spec spec = {.in = self->channels,
                                            .out = self->spec.out,
                                            .height = like->height,
                                            .width = like->width,
                                            .plane = plane,
                                            .pitch = v2v_padded_pitch(like),
                                            .out_pixels = plan->out_rows * like->width,
                                            .slope = self->spec.slope,
                                            .workspace = self->spec.method.workspace,
                                            .pool = self->spec.method.pool};
    return v2v_tile_conv_create(&self->tile_conv, &spec);
}

static int gathers(const struct v2v_align_blocks *self)
{
    return self->spec.method.precision != V2V_PRECISION_F32;
}

enum v2v_status v2v_align_blocks_plan(struct v2v_align_blocks *self,
                                      const struct v2v_align_conv_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_padded *like = plan->like;
    struct v2v_plane *plane = NULL;
    V2V_TRY(v2v_pool_take(&self->weight, self->spec.method.pool, "align_blocks.weights",
                          v2v_mem_product(self->spec.out, self->channels, PLACES)));
    V2V_TRY(V2V_ALLOC(plane, "align_blocks.planes", self->channels));
    for (int64_t i = 0; i < self->spec.view_count; i++) {
        for (int64_t c = 0; c < self->spec.features; c++) {
            struct v2v_plane *to = plane + first_channel(self, i, c);
            for (int64_t b = self->blocks.first[i]; b < self->blocks.first[i + 1]; b++) {
                *to++ = plane_of(self, like, i, c, b);
            }
        }
    }
    v2v_align_gather_destroy(&self->gather);
    v2v_tile_conv_destroy(&self->tile_conv);
    if (plan->is_listed) {
        V2V_TRY(plan_listed(self, plane, plan));
    } else if (gathers(self)) {
        V2V_ASSERT(plan->out_rows == like->height);
        V2V_TRY(plan_gather(self, plane, plan));
    } else {
        V2V_TRY(plan_winograd(self, plane, plan));
    }
done:
    v2v_mem_free(plane);
    return rc;
}

/* Full weights [view,feature,z,3,3] of one output -> the blocks' weights, or the blocks' gradient
 * added to that of the full weights: one is the adjoint of the other. */
enum direction { FULL_TO_BLOCKS, BLOCKS_TO_FULL };

static void add_output(const struct v2v_align_blocks *self, enum direction direction, float *merged,
                       float *full)
{
    int64_t places = self->blocks.slices * PLACES;
    for (int64_t i = 0; i < self->spec.view_count; i++) {
        const int32_t *of = self->blocks.of + i * places;
        for (int64_t c = 0; c < self->spec.features; c++) {
            float *w = full + (i * self->spec.features + c) * places;
            float *m = merged + (first_channel(self, i, c) - self->blocks.first[i]) * PLACES;
            if (direction == FULL_TO_BLOCKS) {
                for (int64_t place = 0; place < places; place++) {
                    m[of[place]] += w[place];
                }
            } else {
                for (int64_t place = 0; place < places; place++) {
                    w[place] += m[of[place]];
                }
            }
        }
    }
}

void v2v_align_blocks_set_weights(struct v2v_align_blocks *self, const float *weight,
                                  const float *bias)
{
    int64_t row = self->channels * PLACES;
    int64_t full = self->spec.view_count * self->spec.features * self->blocks.slices * PLACES;
    float *merged = v2v_piece_data(&self->weight);
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < self->spec.out; o++) {
        memset(merged + o * row, 0, (size_t)row * sizeof *merged);
        add_output(self, FULL_TO_BLOCKS, merged + o * row, (float *)(uintptr_t)(weight + o * full));
    }
    if (self->tile_conv != NULL) {
        v2v_tile_conv_set_weights(self->tile_conv, merged, bias);
    } else if (gathers(self)) {
        v2v_align_gather_set_weights(self->gather, merged, bias);
    } else {
        v2v_winograd_set_weights(self->winograd, merged, bias);
    }
}

void v2v_align_blocks_forward(struct v2v_align_blocks *self, float *out,
                              const struct v2v_padded *features,
                              const struct v2v_winograd_part *part)
{
    if (self->tile_conv != NULL) {
        v2v_tile_conv_forward(self->tile_conv, out, features->data, part);
    } else if (gathers(self)) {
        V2V_ASSERT(part == NULL);
        v2v_align_gather_forward(self->gather, out, features->data);
    } else if (part == NULL) {
        v2v_winograd_forward(self->winograd, out, features->data);
    } else {
        v2v_winograd_forward_part(self->winograd, out, features->data, part);
    }
}

/* [out,channels,3,3]: the gradient of the blocks' weights. */
static const float *blocks_gradient(struct v2v_align_blocks *self, struct v2v_padded *dfeatures,
                                    const struct v2v_padded *features, const float *dout)
{
    if (gathers(self)) {
        v2v_bulk_clear(self->gradient, self->spec.out * self->channels * PLACES);
        v2v_align_gather_backward(self->gather, self->gradient, dfeatures->data, features->data,
                                  dout);
        return self->gradient;
    }
    struct v2v_gradients to = {
        .din = dfeatures->data, .dweight = v2v_piece_data(&self->weight), .sets = 1};
    v2v_winograd_backward(self->winograd, &to, features->data, dout);
    return to.dweight;
}

void v2v_align_blocks_backward(struct v2v_align_blocks *self, float *dweight,
                               struct v2v_padded *dfeatures, const struct v2v_padded *features,
                               const float *dout, int sets)
{
    int64_t row = self->channels * PLACES;
    int64_t full = self->spec.view_count * self->spec.features * self->blocks.slices * PLACES;
    const float *gradient = blocks_gradient(self, dfeatures, features, dout);
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < self->spec.out; o++) {
        if (sets) {
            memset(dweight + o * full, 0, (size_t)full * sizeof *dweight);
        }
        add_output(self, BLOCKS_TO_FULL, (float *)(uintptr_t)(gradient + o * row),
                   dweight + o * full);
    }
}
