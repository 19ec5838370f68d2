#include "method/vcdnet.h"

#include "method/unet_network.h"
#include "v2v3d/method/examples.h"

/* Views are the channels that enter, depth slices those that leave. */
static const char prefix[] = "vcdnet";
static const char *const keys[] = {"vcdnet.width", "vcdnet.levels", "model.homogeneous", NULL};

static struct v2v_plain_unet_spec unet_of(const struct v2v_network_spec *spec)
{
    return (struct v2v_plain_unet_spec){.in = spec->views,
                                        .out = spec->slices,
                                        .width = spec->config->vcdnet.width,
                                        .levels = (int)spec->config->vcdnet.levels};
}

static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec);
    return v2v_unet_network_declare(schema, &unet, prefix);
}

static void sizes_of(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays)
{
    *sizes = (struct v2v_network_sizes){
        .setting = {{"vcdnet.width", v2v_unet_network_width(arrays, prefix)},
                    {"vcdnet.levels", v2v_unet_network_levels(arrays, prefix)}},
        .views = v2v_arrays_extent(arrays, "vcdnet.down0.0.weight", 1),
        .slices = v2v_arrays_extent(arrays, "vcdnet.last.weight", 0)};
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec);
    return v2v_unet_network_create(network, spec, &unet, 1);
}

static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec);
    v2v_unet_network_describe_work(work, &unet, 1, height, width);
}

const struct v2v_network_ops v2v_network_vcdnet = {
    V2V_UNET_NETWORK_OPS,
    .name = "vcdnet",
    .keys = keys,
    .crop = 64,
    .examples = &v2v_examples_truth,
    .declare = declare,
    .sizes_of = sizes_of,
    .create = create,
    .describe_work = describe_work,
};
