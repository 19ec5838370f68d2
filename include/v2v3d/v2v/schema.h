#ifndef V2V3D_V2V_SCHEMA_H
#define V2V3D_V2V_SCHEMA_H

#include "v2v3d/base/status.h"
#include "v2v3d/tensor/fields.h"
#include "v2v3d/v2v/model.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The table of all parameters of the branches in `spec`, without a model: names and shapes of
 *  REFERENCE.md 4, encoder first. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_model_schema(struct v2v_fields *fields,
                                 const struct v2v_model_spec *spec) V2V_MUST_CHECK;

/** Views that branch 0 or 1 sees, as spec->split says: 0,2,4,.. and 1,3,5,..; as many drawn by
 *  spec->split_seed, and the others; or all, twice. @kind Local.
 *  @param list [spec->views] out, ascending. @return their number */
int64_t v2v_branch_views(int32_t *list, const struct v2v_model_spec *spec, int branch);

#ifdef __cplusplus
}
#endif

#endif
