/* Two ways share the frame: sparse taps, exact everywhere, and blocks by Winograd or in
 * bf16, several times faster. With merged blocks the one-pixel border ring is left to the taps. */
#include "v2v/align_conv.h"

#include "v2v/align_blocks.h"
#include "v2v/align_taps.h"
#include "v2v3d/base/memory.h"

#include <string.h>

struct v2v_align_conv {
    struct v2v_align_conv_spec spec;
    int64_t height, width;
    struct v2v_align_blocks *blocks; /* NULL: taps alone */
    struct v2v_align_taps *taps;     /* NULL: blocks alone */
};

static int takes_blocks(const struct v2v_conv_method *method)
{
    return method->winograd || method->precision != V2V_PRECISION_F32;
}

enum v2v_status v2v_align_conv_create(struct v2v_align_conv **conv, const struct v2v_shifts *shifts,
                                      const struct v2v_align_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_align_conv *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "align_conv", 1));
    self->spec = *spec;
    int blocks = takes_blocks(&spec->method);
    if (blocks) {
        V2V_TRY(v2v_align_blocks_create(&self->blocks, shifts, spec));
    }
    if (!blocks || !spec->every_slice) {
        V2V_TRY(v2v_align_taps_create(&self->taps, shifts, spec, blocks));
    }
done:
    if (rc != V2V_OK) {
        v2v_align_conv_destroy(&self);
    }
    *conv = self;
    return rc;
}

void v2v_align_conv_destroy(struct v2v_align_conv **conv)
{
    if (*conv == NULL) {
        return;
    }
    v2v_align_blocks_destroy(&(*conv)->blocks);
    v2v_align_taps_destroy(&(*conv)->taps);
    v2v_mem_free(*conv);
    *conv = NULL;
}

int v2v_align_conv_takes_blocked(const struct v2v_align_conv *conv)
{
    return conv->blocks != NULL && v2v_align_blocks_takes_blocked(conv->blocks);
}

enum v2v_status v2v_align_conv_plan(struct v2v_align_conv *conv,
                                    const struct v2v_align_conv_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    conv->height = plan->like->height;
    conv->width = plan->like->width;
    if (conv->blocks != NULL) {
        V2V_TRY(v2v_align_blocks_plan(conv->blocks, plan));
    }
    if (conv->taps != NULL) {
        V2V_TRY(v2v_align_taps_plan(conv->taps, plan));
    }
done:
    return rc;
}

void v2v_align_conv_set_weights(struct v2v_align_conv *conv, const float *weight, const float *bias)
{
    if (conv->height == 0) {
        return; /* not planned yet: planning takes the weights */
    }
    if (conv->blocks != NULL) {
        v2v_align_blocks_set_weights(conv->blocks, weight, bias);
    }
    if (conv->taps != NULL) {
        v2v_align_taps_set_weights(conv->taps, weight, bias);
    }
}

void v2v_align_conv_forward(struct v2v_align_conv *conv, float *out,
                            const struct v2v_padded *features, const struct v2v_winograd_part *part)
{
    if (conv->blocks != NULL) {
        v2v_align_blocks_forward(conv->blocks, out, features, part);
    }
    if (conv->taps != NULL) {
        v2v_align_taps_forward(conv->taps, out, features, part);
    }
}

static void clear_ring(const struct v2v_align_conv *conv, float *images)
{
    int64_t height = conv->height, width = conv->width;
#pragma omp parallel for schedule(static)
    for (int64_t o = 0; o < conv->spec.out; o++) {
        float *image = images + o * height * width;
        memset(image, 0, (size_t)width * sizeof *image);
        memset(image + (height - 1) * width, 0, (size_t)width * sizeof *image);
        for (int64_t y = 1; y < height - 1; y++) {
            image[y * width] = image[y * width + width - 1] = 0.0f;
        }
    }
}

void v2v_align_conv_backward(struct v2v_align_conv *conv, float *dweight, float *dbias,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features,
                             float *dout)
{
    memset(dbias, 0, (size_t)conv->spec.out * sizeof *dbias);
    v2v_bias_gradient(dbias, dout, 1, conv->spec.out, conv->height, conv->width);
    if (conv->taps != NULL) {
        v2v_align_taps_backward(conv->taps, dweight, dfeatures, features, dout);
    }
    if (conv->taps != NULL && conv->blocks != NULL) {
        clear_ring(conv, dout);
    }
    if (conv->blocks != NULL) {
        v2v_align_blocks_backward(conv->blocks, dweight, dfeatures, features, dout,
                                  conv->taps == NULL);
    }
}
