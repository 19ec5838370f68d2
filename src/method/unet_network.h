/** What networks that are a U-Net and nothing else share: all but the sizes of it. */
#ifndef V2V3D_METHOD_UNET_NETWORK_H
#define V2V3D_METHOD_UNET_NETWORK_H

#include "v2v3d/nn/network.h"
#include "v2v3d/nn/unet.h"

/** The parameters, under that prefix, as one group. @kind Local. @return as ops->declare */
enum v2v_status v2v_unet_network_declare(struct v2v_schema *schema,
                                         const struct v2v_plain_unet_spec *unet,
                                         const char *prefix) V2V_MUST_CHECK;

/** forward takes [depth,in,y,x] as the network's inputs and makes [depth,out,y,x] as its slices.
 *  @kind Local. @return as ops->create */
enum v2v_status v2v_unet_network_create(struct v2v_network *network,
                                        const struct v2v_network_spec *spec,
                                        const struct v2v_plain_unet_spec *unet,
                                        int64_t depth) V2V_MUST_CHECK;

/** @kind Local. */
void v2v_unet_network_describe_work(struct v2v_grid_work *work,
                                    const struct v2v_plain_unet_spec *unet, int64_t depth,
                                    int64_t height, int64_t width);

/** Width of the first level and number of levels of arrays that nobody has checked, as
 *  v2v_unet_network_declare names them; 0: there are none. @kind Local. */
int64_t v2v_unet_network_width(const struct v2v_arrays *arrays, const char *prefix);
int64_t v2v_unet_network_levels(const struct v2v_arrays *arrays, const char *prefix);

/** As the tables of functions have them. */
void v2v_unet_network_destroy(struct v2v_network *network);
enum v2v_status v2v_unet_network_plan(struct v2v_network *network,
                                      const struct v2v_network_plan *plan) V2V_MUST_CHECK;
struct v2v_part v2v_unet_network_rows_of(const struct v2v_network *network, int rank);
void v2v_unet_network_weights_changed(struct v2v_network *network);
void v2v_unet_network_forward(struct v2v_network *network, float *const *volume,
                              const float *views);
void v2v_unet_network_watch(struct v2v_network *network,
                            void (*ready)(void *context, int64_t first, int64_t count),
                            void *context);
void v2v_unet_network_backward(struct v2v_network *network, const float *const *dvolume);

/** What the tables of functions of all these networks have in common. */
#define V2V_UNET_NETWORK_OPS                                                                       \
    .split = "none", .outputs = 1, .destroy = v2v_unet_network_destroy,                            \
    .plan = v2v_unet_network_plan, .rows_of = v2v_unet_network_rows_of,                            \
    .weights_changed = v2v_unet_network_weights_changed, .forward = v2v_unet_network_forward,      \
    .watch = v2v_unet_network_watch, .backward = v2v_unet_network_backward

#endif
