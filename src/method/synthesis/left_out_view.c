#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/cameras.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/op/workspace.h"
#include "v2v3d/tensor/bulk.h"

#include <math.h>

/* View v, and what the others show of planes before it: a plane sweep (Collins, A space-sweep
 * approach to true multi-image matching, CVPR 1996). Where a plane is, the others agree. */

struct left_out_view {
    struct v2v_cameras cameras;
    struct v2v_workspace frame; /* [v,y,x] */
};

static enum v2v_status create(struct v2v_examples *examples)
{
    enum v2v_status rc = V2V_OK;
    struct left_out_view *self = NULL;
    const struct v2v_synthesis_settings *settings = &examples->config->synthesis;
    V2V_TRY(V2V_ALLOC(self, "left_out_view", 1));
    examples->self = self;
    examples->inputs = 2 * settings->planes;
    examples->outputs = 1;
    if (examples->psf->views < 2) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "a view of other views takes 2 or more, not %lld",
                         (long long)examples->psf->views));
    }
    V2V_TRY(v2v_cameras_init(&self->cameras, settings, examples->psf->views));
done:
    return rc;
}

static void destroy(struct v2v_examples *examples)
{
    struct left_out_view *self = examples->self;
    if (self != NULL) {
        v2v_cameras_fini(&self->cameras);
        v2v_workspace_fini(&self->frame);
        v2v_mem_free(self);
    }
}

/* Pixels of a row that are made at a time. */
enum { RUN = 64 };

/* What is beyond a view's frame is its edge, and counts where no view shows the place. */
static const float beyond = 0x1p-10f;

struct run {
    float weight[RUN], mean[RUN], squares[RUN]; /* of what was taken in */
    int64_t y, x, count;                        /* its first pixel, and how many */
};

struct swept {
    const struct v2v_cameras *cameras;
    const float *frame; /* [v,y,x] */
    int64_t v, height, width;
};

static int is_within(int64_t x, int64_t count)
{
    return x >= 0 && x < count;
}

/* View u, moved by (off_y, off_x), bilinear. Weighted mean and squares about it, one view after the
 * other (West, CACM 22, 532 (1979)): where views agree, nothing is left by rounding. */
static void take_in(struct run *run, const struct swept *swept, int64_t u, double off_y,
                    double off_x)
{
    const int64_t height = swept->height, width = swept->width;
    const int64_t y = run->y + (int64_t)floor(off_y), x = run->x + (int64_t)floor(off_x);
    const float part_y = (float)(off_y - floor(off_y)), part_x = (float)(off_x - floor(off_x));
    const float *view = swept->frame + u * height * width;
    const float *above = view + v2v_within(y, 0, height - 1) * width;
    const float *below = view + v2v_within(y + 1, 0, height - 1) * width;
    const int is_row = is_within(y, height) && is_within(y + (part_y > 0), height);
    for (int64_t i = 0; i < run->count; i++) {
        const int is_seen =
            is_row && is_within(x + i, width) && is_within(x + i + (part_x > 0), width);
        const int64_t l = v2v_within(x + i, 0, width - 1), r = v2v_within(x + i + 1, 0, width - 1);
        const float high = above[l] + part_x * (above[r] - above[l]);
        const float low = below[l] + part_x * (below[r] - below[l]);
        const float value = high + part_y * (low - high), weight = is_seen ? 1.0f : beyond;
        const float off = value - run->mean[i];
        run->weight[i] += weight;
        run->mean[i] += weight / run->weight[i] * off;
        run->squares[i] += weight * off * (value - run->mean[i]);
    }
}

/* Mean and standard deviation of the others, at one disparity. */
static void sweep(float *mean, float *deviation, const struct swept *swept, double disparity)
{
    const double *own = swept->cameras->at[swept->v];
    for (int64_t at = 0; at < swept->height * swept->width;) {
        struct run run = {.y = at / swept->width, .x = at % swept->width};
        run.count = v2v_smaller(RUN, swept->width - run.x);
        for (int64_t u = 0; u < swept->cameras->views; u++) {
            const double *other = swept->cameras->at[u];
            if (u != swept->v) {
                take_in(&run, swept, u, disparity * (own[0] - other[0]),
                        disparity * (own[1] - other[1]));
            }
        }
        for (int64_t i = 0; i < run.count; i++) {
            mean[at + i] = run.mean[i];
            deviation[at + i] = sqrtf(run.squares[i] / run.weight[i]);
        }
        at += run.count;
    }
}

static void inputs_of_view(const struct v2v_examples *examples, float *images, const float *frames,
                           int64_t v, int64_t height, int64_t width)
{
    const struct left_out_view *self = examples->self;
    const struct v2v_synthesis_settings *settings = &examples->config->synthesis;
    const int64_t planes = settings->planes, pixels = height * width;
    const struct swept swept = {&self->cameras, frames, v, height, width};
    const double step = (settings->farthest - settings->nearest) / (double)(planes - 1);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < planes; i++) {
        sweep(images + 2 * i * pixels, images + (2 * i + 1) * pixels, &swept,
              settings->nearest + (double)i * step);
    }
}

static enum v2v_status make(struct v2v_examples *examples, float *images,
                            const struct v2v_example_source *source, int64_t t, int64_t number)
{
    enum v2v_status rc = V2V_OK;
    struct left_out_view *self = examples->self;
    const struct v2v_recording_info *info = v2v_recording_info(source->recording);
    const int64_t pixels = info->height * info->width, samples = info->views * pixels;
    V2V_TRY(v2v_workspace_reserve(&self->frame, samples));
    float *frame = self->frame.data;
    V2V_TRY(v2v_scaling_read_dark(&source->scaling, source->recording, frame, NULL, t));
    inputs_of_view(examples, images, frame, number, info->height, info->width);
    v2v_bulk_copy(images + examples->inputs * pixels, frame + number * pixels, pixels);
done:
    return rc;
}

const struct v2v_examples_ops v2v_examples_left_out_view = {
    .name = "views left out",
    .mirroring = V2V_MIRROR_IMAGES, /* as of cameras that are mirrored, too */
    .is_of_view = 1,
    .needs_cameras = 1,
    .create = create,
    .destroy = destroy,
    .make = make,
    .inputs_of_view = inputs_of_view,
};
