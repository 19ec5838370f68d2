/** The network of slices, made by itself, for the tests of method. */
#ifndef TEST_SMALL_DEPTH_NET_H
#define TEST_SMALL_DEPTH_NET_H

#include "support.h"

#include "method/depth_net.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"

struct small_depth_net {
    struct v2v_config config;
    struct v2v_network network;
};

/** With weights by He's rule, planned for training. */
static inline void small_depth_net_init(struct small_depth_net *net, int64_t slices, int64_t height,
                                        int64_t width)
{
    const struct v2v_network_ops *ops = &v2v_network_depth_net;
    struct v2v_network *network = &net->network;
    v2v_config_defaults(&net->config);
    const struct v2v_network_spec spec = {.config = &net->config,
                                          .views = V2V_FEATURES * slices,
                                          .slices = slices,
                                          .outputs = V2V_NETWORK_ALL};
    const struct v2v_network_plan plan = {.height = height, .width = width, .training = 1};
    *network = (struct v2v_network){
        .ops = ops, .views = spec.views, .slices = slices, .held = spec.outputs & 1};
    assert_ok(ops->declare(&network->schema, &spec));
    assert_ok(ops->create(network, &spec));
    assert_ok(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HE, 7));
    assert_ok(ops->plan(network, &plan));
}

static inline void small_depth_net_fini(struct small_depth_net *net)
{
    net->network.ops->destroy(&net->network);
    v2v_schema_fini(&net->network.schema);
}

#endif
