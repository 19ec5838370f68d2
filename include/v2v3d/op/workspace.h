#ifndef V2V3D_OP_WORKSPACE_H
#define V2V3D_OP_WORKSPACE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Memory that operators use one after the other, as large as the largest asks for. Nothing in it
 *  outlives a call; its place changes when it grows: operators take `data` anew at every call. */
struct v2v_workspace {
    float *data;
    int64_t floats;
};

/** Grow to at least so many floats; the contents are lost.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_workspace_reserve(struct v2v_workspace *workspace,
                                      int64_t floats) V2V_MUST_CHECK;
void v2v_workspace_fini(struct v2v_workspace *workspace);

#ifdef __cplusplus
}
#endif

#endif
