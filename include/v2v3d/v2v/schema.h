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

/** Views of branch 0 (0,2,4,..) or 1 (1,3,5,..) of `views`. @kind Local.
 *  @param list [at least views] out. @return their number */
int64_t v2v_branch_views(int32_t *list, int64_t views, int branch);

#ifdef __cplusplus
}
#endif

#endif
