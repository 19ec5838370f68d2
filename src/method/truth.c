#include "v2v3d/base/memory.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/op/workspace.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/bulk.h"
#include "v2v3d/tensor/statistics.h"

/* Supervised learning: views, and the volume that they are of. The recording's gain is the
 * volume's, too; with model.homogeneous so is the frame's level. */

/* Volumes that show so many times the light of their views, or so much less, are in other units:
 * counts of a camera beside voxels of 0 to 1, say. What lies outside of frames, and noise, are
 * less. */
static const double other_units = 2.0;

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

/* What a view gets of a slice's light, in the mean of the views. */
static double share_of(const struct v2v_psf_file *psf, int64_t z)
{
    const int64_t taps = psf->height * psf->width;
    double share = 0.0;
    for (int64_t v = 0; v < psf->views; v++) {
        share += v2v_sum(psf->data + (v * psf->slices + z) * taps, taps) / (double)psf->views;
    }
    return share;
}

enum v2v_status v2v_examples_truth_units(struct v2v_example_source *source,
                                         const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(source->recording);
    const int64_t pixels = info->height * info->width, samples = info->views * pixels;
    const int64_t of_truth = v2v_volume_info(source->truth)->frames;
    struct v2v_scaling offset = source->scaling; /* with the shading of a calibration */
    double seen = 0.0, light = 0.0;              /* of a frame's pixels, but for what leaves them */
    float *views = NULL, *slice = NULL;
    offset.gain = source->units = 1.0;
    V2V_TRY(V2V_ALLOC(views, "truth.units", v2v_mem_product(info->views, pixels, 1)));
    V2V_TRY(V2V_ALLOC(slice, "truth.units", pixels));
    for (int64_t t = 0; t < info->frames; t++) {
        v2v_watchdog_beat("units of true volumes");
        V2V_TRY(v2v_recording_read(source->recording, views, t));
        v2v_scaling_apply(&offset, views, samples);
        seen += v2v_sum(views, samples) / (double)(info->views * info->frames);
    }
    for (int64_t z = 0; z < psf->slices; z++) {
        const double share = share_of(psf, z) / (double)of_truth;
        for (int64_t t = 0; t < of_truth; t++) {
            v2v_watchdog_beat("units of true volumes");
            V2V_TRY(v2v_volume_read(source->truth, slice, t, z, 1));
            light += share * v2v_sum(slice, pixels);
        }
    }
    const double ratio = light > 0.0 && seen > 0.0 ? seen / light : 1.0;
    source->units = ratio < other_units && ratio > 1.0 / other_units ? 1.0 : ratio;
done:
    v2v_mem_free(slice);
    v2v_mem_free(views);
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
    v2v_bulk_scale(images + samples, voxels,
                   (float)(source->scaling.gain * factor * source->units));
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
