/** The trainable networks that there are.
 *
 *  Purpose: one row a network (src/method/networks.c); training, checkpoints, weight files and
 *  reconstruction find it by its name, in model.method or in a weight file.
 *  Invariants: no other room knows what kinds of networks there are.
 *
 *  Example (compiled by tests/unit/method): see nn/network.h.
 */
#ifndef V2V3D_METHOD_NETWORKS_H
#define V2V3D_METHOD_NETWORKS_H

#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/network.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How many there are, and one of them, 0 .. count-1. @kind Local. */
int64_t v2v_network_count(void);
const struct v2v_network_ops *v2v_network_at(int64_t index);

/** By name. @kind Local. @return V2V_OK | V2V_E_CONFIG (names the nearest one) */
enum v2v_status v2v_network_find(const struct v2v_network_ops **ops,
                                 const char *name) V2V_MUST_CHECK;

/** Weights and gradients are undefined: v2v_rule_weights or a file sets them, then weights_changed.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG (no such method, or what the method
 *  does not offer) | V2V_E_INPUT (PSFs of fewer views than the method takes) */
enum v2v_status v2v_network_create(struct v2v_network **network, const char *name,
                                   const struct v2v_network_spec *spec) V2V_MUST_CHECK;
void v2v_network_destroy(struct v2v_network **network);

/** Names, shapes and groups of the parameters of spec's outputs, without a network.
 *  @kind Local. @return as above */
enum v2v_status v2v_network_schema(struct v2v_schema *schema, const char *name,
                                   const struct v2v_network_spec *spec) V2V_MUST_CHECK;
void v2v_schema_fini(struct v2v_schema *schema);

/** What a weight file is to say of a network of `views` and `slices` after `step` steps.
 *  @kind Local. @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_network_describe(struct v2v_weights_info *info, const struct v2v_config *config,
                                     int64_t views, int64_t slices, int64_t step) V2V_MUST_CHECK;

/** Which network a weight file is of. @kind Local. @param path for messages @return V2V_OK |
 *  V2V_E_INPUT (one that there is not) */
enum v2v_status v2v_network_of_weights(const struct v2v_network_ops **ops,
                                       const struct v2v_weights_info *info,
                                       const char *path) V2V_MUST_CHECK;

/** The network of a weight file becomes that of the configuration.
 *  @kind Local. @param path for messages @return V2V_OK | V2V_E_INPUT (a method that there is not,
 *  a setting out of its range) */
enum v2v_status v2v_network_adopt(struct v2v_config *config, const struct v2v_weights_info *info,
                                  const char *path) V2V_MUST_CHECK;

/** Outputs that a rank of the grid holds, as bits; an idle rank counts as the last one.
 *  @kind Local. */
unsigned v2v_network_outputs_of(const struct v2v_network_ops *ops, const struct v2v_grid *grid);

#ifdef __cplusplus
}
#endif

#endif
