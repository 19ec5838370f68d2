#include "v2v3d/base/memory.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/op/workspace.h"

#include <string.h>

/* What frames of a view show of those between them: of 2 n frames in a row, those at even places
 * (the first, the third, ..) go in, and the others should come out. Their noise is independent, so
 * that only what they share can be learnt. To denoise, n frames in a row go in: all of them come
 * out, each told by its neighbours and by itself (Li et al., Nature Methods 18, 1395 (2021)). */

struct odd_even {
    struct v2v_workspace frame; /* [v,y,x] */
};

static enum v2v_status create(struct v2v_examples *examples)
{
    struct odd_even *self = NULL;
    const enum v2v_status rc = V2V_ALLOC(self, "odd_even", 1);
    examples->self = self;
    examples->inputs = examples->outputs = examples->config->deepcad.frames;
    examples->frames = 2 * examples->outputs;
    return rc;
}

static void destroy(struct v2v_examples *examples)
{
    struct odd_even *self = examples->self;
    if (self != NULL) {
        v2v_workspace_fini(&self->frame);
        v2v_mem_free(self);
    }
}

/* From frame t on. */
static enum v2v_status make(struct v2v_examples *examples, float *images,
                            const struct v2v_example_source *source, int64_t t, int64_t v)
{
    enum v2v_status rc = V2V_OK;
    struct odd_even *self = examples->self;
    const struct v2v_recording_info *info = v2v_recording_info(source->recording);
    const int64_t pixels = info->height * info->width, n = examples->outputs;
    V2V_TRY(v2v_workspace_reserve(&self->frame, info->views * pixels));
    for (int64_t i = 0; i < examples->frames; i++) {
        const int64_t place = i / 2 + (i % 2) * n;
        V2V_TRY(v2v_scaling_read_dark(&source->scaling, source->recording, self->frame.data, NULL,
                                      t + i));
        memcpy(images + place * pixels, self->frame.data + v * pixels,
               (size_t)pixels * sizeof *images);
    }
done:
    return rc;
}

static void inputs_of_view(const struct v2v_examples *examples, float *images, const float *frames,
                           int64_t v, int64_t height, int64_t width)
{
    const int64_t pixels = height * width, views = examples->psf->views;
    for (int64_t i = 0; i < examples->inputs; i++) {
        memcpy(images + i * pixels, frames + (i * views + v) * pixels,
               (size_t)pixels * sizeof *images);
    }
}

const struct v2v_examples_ops v2v_examples_odd_even = {
    .name = "odd and even frames",
    .mirroring = V2V_MIRROR_IMAGES,
    .is_of_view = 1,
    .create = create,
    .destroy = destroy,
    .make = make,
    .inputs_of_view = inputs_of_view,
};
