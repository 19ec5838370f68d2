#include "network/network_table.h"

#include <string.h>

#define BLOCK(name, in, out)                                                                       \
    {name ".conv.0", in, out, 3, 1, 1, 1, 0.01},                                                   \
    {                                                                                              \
        name ".conv.2", out, out, 3, 1, 1, 1, 1.0                                                  \
    }
#define WIDER(name, in, out)                                                                       \
    {                                                                                              \
        name ".downsample.conv", in, out, 1, 1, 1, 1, 1.0                                          \
    }

const struct v2v_net_layer v2v_net_encoder[] = {
    {"conv1.0", 1, 4, 3, 1, 1, 1, 0.01},
    BLOCK("layer1.0", 4, 4),
    BLOCK("layer1.1", 4, 4),
    BLOCK("layer2.0", 4, 8),
    WIDER("layer2.0", 4, 8),
    BLOCK("layer2.1", 8, 8),
    BLOCK("layer3.0", 8, 16),
    WIDER("layer3.0", 8, 16),
    BLOCK("layer3.1", 16, 16),
    {"branch1.1.conv", 16, 4, 1, 1, 2, 1, 0.01},
    {"branch2.1.conv", 16, 4, 1, 1, 4, 1, 0.01},
    {"branch3.1.conv", 16, 4, 1, 1, 8, 1, 0.01},
    {"lastconv.0.conv", 28, 16, 3, 1, 1, 1, 0.01},
    {"lastconv.2", 16, V2V_NET_FEATURES, 1, 1, 1, 1, 0.01},
    {0}};

const struct v2v_net_layer v2v_net_unet[] = {
    {"init_conv.0", V2V_NET_ALIGNED, 8, 3, 1, 1, 1, 0.01},
    {"init_conv.2", 8, 4, 3, 1, 1, 1, 0.01},
    {"init_conv.4", 4, 2, 3, 1, 1, 1, 0.01},
    {"init_conv.6", 2, 1, 3, 2, 1, 1, 0.01},
    {"encoder_1.conv.1", 1, 1, 3, 1, 2, 1, 1.0},
    {"encoder_2.conv.1", 1, 2, 3, 1, 4, 1, 1.0},
    {"encoder_3.conv.1", 2, 3, 3, 1, 8, 1, 1.0},
    {"encoder_4.conv.1", 3, 4, 3, 1, 16, 1, 1.0},
    {"upscale_2.upscale.1", 4, 4, 3, 1, 32, 2, 1.0},
    {"decoder_1.decoder.1.upscale.1", 7, 3, 3, 1, 16, 2, 1.0},
    {"decoder_2.decoder.1.upscale.1", 5, 2, 3, 1, 8, 2, 1.0},
    {"decoder_3.decoder.1.upscale.1", 3, 1, 3, 1, 4, 2, 1.0},
    {"decoder_4.decoder.1.upscale.1", 2, 1, 3, 1, 2, 2, 1.0},
    {"conv_final.0", 1, 2, 3, 1, 1, 1, 0.01},
    {"conv_final.2", 2, 1, 3, 1, 1, 1, 0.01},
    {"conv_final.4", 1, V2V_NET_SLICES, 3, 1, 1, 1, 0.01},
    {0}};

const struct v2v_net_layer *v2v_net_find(const struct v2v_net_layer *table, const char *name)
{
    while (table->name != NULL && strcmp(table->name, name) != 0) {
        table++;
    }
    V2V_ASSERT(table->name != NULL);
    return table;
}

int64_t v2v_net_channels(int entry, int in_unet, const struct v2v_model_spec *spec,
                         int64_t branch_views)
{
    switch (entry) {
    case V2V_NET_ALIGNED:
        return branch_views * spec->features * spec->slices;
    case V2V_NET_SLICES:
        return spec->slices;
    case V2V_NET_FEATURES:
        return spec->features;
    default:
        return in_unet ? entry * spec->width : entry;
    }
}
