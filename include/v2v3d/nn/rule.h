#ifndef V2V3D_NN_RULE_H
#define V2V3D_NN_RULE_H

#include "v2v3d/base/status.h"
#include "v2v3d/tensor/fields.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Initial weights (enum v2v_rule), field by field, by name, from the seed: V2V_RULE_HASH is
 *  REFERENCE.md 9; V2V_RULE_KAIMING PyTorch's default for convolutions (kaiming-uniform, a = sqrt
 * 5; bias uniform in +-1/sqrt(fan_in)); V2V_RULE_HE keeps the signal's size from layer to layer,
 * with biases 0 and a small last layer: what short training wants.
 *  @kind Local. @return V2V_OK | V2V_E_INTERNAL (a bias without its weight) */
enum v2v_status v2v_rule_weights(const struct v2v_fields *fields, float *weights, int rule,
                                 int64_t seed) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
