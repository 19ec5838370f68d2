#include "v2v3d/base/memory.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/op/workspace.h"
#include "v2v3d/tensor/bulk.h"

/* Supervised learning: views, and the volume that they are of. The recording's gain is the
 * volume's, too; with model.homogeneous so is the frame's level. */

struct truth {
    struct v2v_workspace image; /* [y,x], where every frame has a level of its own */
};

static enum v2v_status create(struct v2v_examples *examples)
{
    struct truth *self = NULL;
    const enum v2v_status rc = V2V_ALLOC(self, "truth", 1);
    examples->self = self;
    examples->inputs = examples->psf->views;
    examples->outputs = examples->psf->slices;
    return rc;
}

static void destroy(struct v2v_examples *examples)
{
    struct truth *self = examples->self;
    if (self != NULL) {
        v2v_workspace_fini(&self->image);
        v2v_mem_free(self);
    }
}

/* What brings the frame to its level; 1 without model.homogeneous. */
static enum v2v_status level(double *factor, const struct v2v_examples *examples, float *views,
                             const struct v2v_recording_info *info)
{
    enum v2v_status rc = V2V_OK;
    struct truth *self = examples->self;
    *factor = 1.0;
    if (examples->config->model.homogeneous) {
        V2V_TRY(v2v_workspace_reserve(&self->image, info->height * info->width));
        *factor =
            v2v_scaling_level(views, self->image.data, info->views, info->height, info->width);
    }
done:
    return rc;
}

static enum v2v_status make(struct v2v_examples *examples, float *images,
                            const struct v2v_example_source *source, int64_t t, int64_t number)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(source->recording);
    const int64_t samples = info->views * info->height * info->width;
    const int64_t voxels = examples->outputs * info->height * info->width;
    double factor = 1.0;
    (void)number;
    /* a volume of one frame is that of every frame: a still scene, recorded again and again */
    const int64_t of_volume = t % v2v_volume_info(source->truth)->frames;
    V2V_TRY(v2v_recording_read(source->recording, images, t));
    v2v_scaling_apply(&source->scaling, images, samples);
    V2V_TRY(level(&factor, examples, images, info));
    V2V_TRY(v2v_volume_read(source->truth, images + samples, of_volume, 0, examples->outputs));
    v2v_bulk_scale(images + samples, voxels, (float)(source->scaling.gain * factor));
done:
    return rc;
}

const struct v2v_examples_ops v2v_examples_truth = {
    .name = "true volumes",
    .mirroring = V2V_MIRROR_VIEWS,
    .needs_truth = 1,
    .create = create,
    .destroy = destroy,
    .make = make,
};
