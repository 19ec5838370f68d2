#include "method/synthesis/network.h"

#include "method/unet_network.h"
#include "v2v3d/method/examples.h"

/* One flat U-Net; what it is given is made in left_out_view.c. */
static const char prefix[] = "synthesis";
static const char *const keys[] = {"synthesis.planes",
                                   "synthesis.nearest",
                                   "synthesis.farthest",
                                   "synthesis.cameras",
                                   "synthesis.width",
                                   "synthesis.levels",
                                   NULL};

static struct v2v_plain_unet_spec unet_of(const struct v2v_config *config)
{
    return (struct v2v_plain_unet_spec){.in = 2 * config->synthesis.planes,
                                        .out = 1,
                                        .width = config->synthesis.width,
                                        .levels = (int)config->synthesis.levels};
}

static enum v2v_status declare(struct v2v_schema *schema, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    return v2v_unet_network_declare(schema, &unet, prefix);
}

/* Of planes, files of other programs do not tell how far they are. */
static void sizes_of(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays)
{
    *sizes = (struct v2v_network_sizes){
        .setting = {{"synthesis.width", v2v_unet_network_width(arrays, prefix)},
                    {"synthesis.levels", v2v_unet_network_levels(arrays, prefix)}}};
}

static enum v2v_status create(struct v2v_network *network, const struct v2v_network_spec *spec)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    return v2v_unet_network_create(network, spec, &unet, 1);
}

static void describe_work(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width)
{
    const struct v2v_plain_unet_spec unet = unet_of(spec->config);
    v2v_unet_network_describe_work(work, &unet, 1, height, width);
}

const struct v2v_network_ops v2v_network_synthesis = {
    V2V_UNET_NETWORK_OPS,
    .name = "synthesis",
    .keys = keys,
    .crop = 128,
    .examples = &v2v_examples_left_out_view,
    .traits = V2V_TRAIT_VIEWS | V2V_TRAIT_ANY,
    .declare = declare,
    .sizes_of = sizes_of,
    .create = create,
    .describe_work = describe_work,
};
