#include "method/deepcad.h"

#include "method/unet_network.h"
#include "v2v3d/method/examples.h"

/* Frames of one view are a stack [t,y,x] of one channel; the network knows no optics. */
static const char prefix[] = "deepcad";
static const char *const keys[] = {"deepcad.width", "deepcad.levels", "deepcad.frames", NULL};

static struct v2v_plain_unet_spec unet_of(const struct v2v_config *config)
{
    return (struct v2v_plain_unet_spec){.in = 1,
                                        .out = 1,
                                        .width = config->deepcad.width,
                                        .levels = (int)config->deepcad.levels,
                                        .is_deep = 1};
}

static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    return v2v_unet_network_declare(schema, &unet, prefix);
}

/* The same convolutions serve any number of frames, and of views. */
static void sizes_of(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays)
{
    *sizes = (struct v2v_network_sizes){
        .setting = {{"deepcad.width", v2v_unet_network_width(arrays, prefix)},
                    {"deepcad.levels", v2v_unet_network_levels(arrays, prefix)}}};
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    const int64_t frames = spec->config->deepcad.frames, unit = v2v_plain_unet_unit(&unet);
    if (frames % unit != 0) {
        return V2V_FAIL(V2V_E_CONFIG,
                        "deepcad.frames: %lld is no multiple of %lld, which %d levels take",
                        (long long)frames, (long long)unit, unet.levels);
    }
    return v2v_unet_network_create(network, spec, &unet, frames);
}

static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    v2v_unet_network_describe_work(work, &unet, spec->config->deepcad.frames, height, width);
}

const struct v2v_network_ops v2v_network_deepcad = {
    V2V_UNET_NETWORK_OPS,
    .name = "deepcad",
    .keys = keys,
    .crop = 64,
    .examples = &v2v_examples_odd_even,
    .traits = V2V_TRAIT_VIEWS | V2V_TRAIT_ANY,
    .declare = declare,
    .sizes_of = sizes_of,
    .create = create,
    .describe_work = describe_work,
};
