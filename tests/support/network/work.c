#include "network/work.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/blocks.h"
#include "v2v3d/optics/taps.h"
#include "v2v3d/v2v/schema.h"

/* F(4x4,3x3): multiplications for a tile, with and without. */
static const double minimal_share = 36.0 / 144.0;

/* Pixels per frame pixel of the convolution's output. */
static double output_density(const struct v2v_net_layer *layer)
{
    double side = (double)layer->grow / (layer->shrink * layer->stride);
    return side * side;
}

static int is_in_unet(const struct v2v_net_layer *layer)
{
    const struct v2v_net_layer *end = v2v_net_unet;
    while (end->name != NULL) {
        end++;
    }
    return layer >= v2v_net_unet && layer < end;
}

double v2v_work_weights(const struct v2v_net_layer *layer, const struct v2v_model_spec *spec,
                        int64_t branch_views)
{
    int in_unet = is_in_unet(layer);
    return (double)layer->kernel * layer->kernel *
           (double)v2v_net_channels(layer->in, in_unet, spec, branch_views) *
           (double)v2v_net_channels(layer->out, in_unet, spec, branch_views);
}

double v2v_work_layer(const struct v2v_net_layer *layer, const struct v2v_model_spec *spec,
                      int64_t branch_views)
{
    return v2v_work_weights(layer, spec, branch_views) * output_density(layer);
}

/* `times` passes of a layer over frames of `pixels`, that share its weights. */
static void add_layer(struct v2v_work *work, const struct v2v_net_layer *layer,
                      const struct v2v_model_spec *spec, int64_t branch_views, double times,
                      double pixels)
{
    int in_unet = is_in_unet(layer);
    double share = spec->winograd && layer->kernel == 3 && layer->stride == 1 ? minimal_share : 1.0;
    double in = (double)v2v_net_channels(layer->in, in_unet, spec, branch_views) /
                ((double)layer->shrink * layer->shrink);
    double out =
        (double)v2v_net_channels(layer->out, in_unet, spec, branch_views) * output_density(layer);
    work->macs += share * times * pixels * v2v_work_layer(layer, spec, branch_views);
    work->bytes += (times * pixels * (in + out) + v2v_work_weights(layer, spec, branch_views)) *
                   (double)sizeof(float);
}

/* The first layer of a branch; `taps`: kernel positions a feature after merging. */
static enum v2v_status add_first(struct v2v_work *work, const struct v2v_model_spec *spec,
                                 const struct v2v_shifts *shifts, const int32_t *list,
                                 int64_t branch_views, double pixels)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_taps taps = {0};
    struct v2v_blocks blocks = {0};
    double out = (double)(8 * spec->width);
    V2V_TRY(v2v_taps_create(&taps, shifts, list, branch_views, V2V_TAPS_ALL, V2V_TAPS_ALL,
                            !spec->every_slice));
    V2V_TRY(v2v_blocks_create(&blocks, shifts, list, branch_views, !spec->every_slice));
    double positions = (double)taps.count;
    if (spec->winograd && (double)blocks.count * 9.0 * minimal_share < positions) {
        positions = (double)blocks.count * 9.0 * minimal_share;
    }
    double features = (double)spec->features;
    work->macs += pixels * positions * features * out;
    work->bytes +=
        (pixels * ((double)branch_views * features + out) + (double)taps.count * features * out) *
        (double)sizeof(float);
done:
    v2v_blocks_fini(&blocks);
    v2v_taps_fini(&taps);
    return rc;
}

enum v2v_status v2v_work_of_layer(struct v2v_work *work, const struct v2v_net_layer *layer,
                                  const struct v2v_model_spec *spec,
                                  const struct v2v_shifts *shifts, int branch, double pixels)
{
    enum v2v_status rc = V2V_OK;
    int32_t *list = NULL;
    *work = (struct v2v_work){0};
    V2V_TRY(V2V_ALLOC(list, "bench.views", spec->views));
    int64_t branch_views = v2v_branch_views(list, spec, branch);
    if (layer == v2v_net_unet) {
        V2V_TRY(add_first(work, spec, shifts, list, branch_views, pixels));
    } else {
        add_layer(work, layer, spec, branch_views, 1.0, pixels);
    }
done:
    v2v_mem_free(list);
    return rc;
}

enum v2v_status v2v_work_of(struct v2v_work *work, const struct v2v_model_spec *spec,
                            const struct v2v_shifts *shifts, int64_t height, int64_t width)
{
    enum { BRANCHES = 2 };
    enum v2v_status rc = V2V_OK;
    struct v2v_work one;
    double pixels = (double)height * (double)width;
    *work = (struct v2v_work){0};
    for (const struct v2v_net_layer *layer = v2v_net_encoder; layer->name != NULL; layer++) {
        add_layer(work, layer, spec, 0, (double)spec->views, pixels);
    }
    for (int b = 0; b < BRANCHES; b++) {
        for (const struct v2v_net_layer *layer = v2v_net_unet; layer->name != NULL; layer++) {
            V2V_TRY(v2v_work_of_layer(&one, layer, spec, shifts, b, pixels));
            work->macs += one.macs;
            work->bytes += one.bytes;
        }
    }
done:
    return rc;
}
