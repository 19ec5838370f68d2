/** Weights of any network, out of files of this program and of others. */
#ifndef V2V3D_METHOD_WEIGHTS_H
#define V2V3D_METHOD_WEIGHTS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/network.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_weights {
    struct v2v_weights_info info;
    struct v2v_schema schema;
    float *arena; /**< [schema.fields.total] */
    char *config; /**< of the training, where the file carries it; NULL: it doesn't */
    int is_ours;  /**< bool: the file says what network it is of; else its names and shapes did */
};

/** What a file does not say that is none of this program's, and its shapes don't tell. */
struct v2v_weights_hints {
    const struct v2v_config *config; /**< settings of the network */
    int64_t views, slices;           /**< 0: not known */
};

/** Read safetensors or HDF5 (io/arrays.h). Files of this program say what they are; of others the
 *  method is the one whose arrays have these names, with or without a prefix that all names have in
 *  common ("module."), and what the method can tell by shapes it tells. Every array must be there
 *  in its shape, finite, and no other.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (array, what it is and what it should be) |
 *  V2V_E_USAGE (views or slices that nothing tells) | V2V_E_MEMORY; _fini after both */
enum v2v_status v2v_weights_read(struct v2v_weights *weights, const char *path,
                                 const struct v2v_weights_hints *hints) V2V_MUST_CHECK;

/** The network whose names the arrays of a file have, below a prefix or not; NULL: none.
 *  @kind Local. */
const char *v2v_weights_method(const char *path, const struct v2v_config *config);

/** Write safetensors, or HDF5. @kind Local (one rank). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY */
enum v2v_status v2v_weights_write(const struct v2v_weights *weights, const char *path,
                                  int is_safetensors) V2V_MUST_CHECK;

/** @kind Local; accepts a zeroed one. */
void v2v_weights_fini(struct v2v_weights *weights);

#ifdef __cplusplus
}
#endif

#endif
