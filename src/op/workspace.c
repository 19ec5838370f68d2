#include "v2v3d/op/workspace.h"

#include "v2v3d/base/memory.h"

enum v2v_status v2v_workspace_reserve(struct v2v_workspace *workspace, int64_t floats)
{
    enum v2v_status rc = V2V_OK;
    if (workspace->data != NULL && floats <= workspace->floats) {
        return V2V_OK;
    }
    v2v_workspace_fini(workspace);
    V2V_TRY(V2V_ALLOC(workspace->data, "op.workspace", floats));
    workspace->floats = floats;
done:
    return rc;
}

void v2v_workspace_fini(struct v2v_workspace *workspace)
{
    v2v_mem_free(workspace->data);
    *workspace = (struct v2v_workspace){0};
}
