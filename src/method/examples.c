#include "v2v3d/method/examples.h"

#include "v2v3d/base/memory.h"

enum v2v_status v2v_examples_create(struct v2v_examples **examples,
                                    const struct v2v_examples_ops *ops,
                                    const struct v2v_config *config, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_examples *made = NULL;
    *examples = NULL;
    V2V_TRY(V2V_ALLOC(made, "examples", 1));
    *made = (struct v2v_examples){.ops = ops, .config = config, .psf = psf, .frames = 1};
    V2V_TRY(ops->create(made));
    *examples = made;
    made = NULL;
done:
    v2v_examples_destroy(&made);
    return rc;
}

void v2v_examples_destroy(struct v2v_examples **examples)
{
    struct v2v_examples *old = *examples;
    *examples = NULL;
    if (old != NULL) {
        old->ops->destroy(old);
        v2v_mem_free(old);
    }
}
