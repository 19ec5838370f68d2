#include "v2v/align_gather.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <string.h>

struct v2v_align_gather {
    struct v2v_conv_spec spec;
    struct v2v_plane *plane; /* [in] */
    int64_t pitch;
    struct v2v_conv *conv;
    int form; /* enum v2v_form: of what is gathered */
};

/* The pixels of the frame that a plane has: rows [y0,y1), columns [x0,x1). */
static struct v2v_plane inside(const struct v2v_align_gather *gather, int64_t channel)
{
    struct v2v_plane plane = gather->plane[channel];
    plane.y0 = v2v_within(plane.y0, 0, gather->spec.height);
    plane.y1 = v2v_within(plane.y1, 0, gather->spec.height);
    plane.x0 = v2v_within(plane.x0, 0, gather->spec.width);
    plane.x1 = v2v_within(plane.x1, 0, gather->spec.width);
    return plane;
}

/* Has every plane all columns of the frame? */
static int rows_are_whole(const struct v2v_align_gather *gather)
{
    for (int64_t i = 0; i < gather->spec.in; i++) {
        struct v2v_plane plane = inside(gather, i);
        if (plane.x0 > 0 || plane.x1 < gather->spec.width) {
            return 0;
        }
    }
    return 1;
}

enum v2v_status v2v_align_gather_create(struct v2v_align_gather **gather,
                                        const struct v2v_conv_spec *spec,
                                        const struct v2v_plane *plane, int64_t pitch)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_align_gather *self = NULL;
    V2V_ASSERT(spec->batch == 1 && spec->stride == 1 && !spec->upsample);
    V2V_TRY(V2V_ALLOC(self, "align_gather", 1));
    self->spec = *spec;
    self->pitch = pitch;
    V2V_TRY(V2V_ALLOC(self->plane, "align_gather.planes", spec->in));
    memcpy(self->plane, plane, (size_t)spec->in * sizeof *plane);
    struct v2v_conv_spec inner = *spec;
    inner.method.workspace = NULL; /* the shared one holds its input */
    int64_t floats = v2v_mem_product(spec->in, spec->height, spec->width);
    if (v2v_conv_takes_blocked(spec) && rows_are_whole(self)) {
        inner.in_form = self->form = V2V_FORM_BLOCKED;
        floats = v2v_blocked_floats(spec->in, spec->height, spec->width);
    }
    V2V_TRY(v2v_workspace_reserve(spec->method.workspace, floats));
    V2V_TRY(v2v_conv_create(&self->conv, &inner));
done:
    if (rc != V2V_OK) {
        v2v_align_gather_destroy(&self);
    }
    *gather = self;
    return rc;
}

void v2v_align_gather_destroy(struct v2v_align_gather **gather)
{
    if (*gather == NULL) {
        return;
    }
    v2v_conv_destroy(&(*gather)->conv);
    v2v_mem_free((*gather)->plane);
    v2v_mem_free(*gather);
    *gather = NULL;
}

void v2v_align_gather_set_weights(struct v2v_align_gather *gather, const float *weight,
                                  const float *bias)
{
    v2v_conv_set_weights(gather->conv, weight, bias);
}

static float *channel_of(const struct v2v_align_gather *gather, int64_t channel)
{
    return gather->spec.method.workspace->data + channel * gather->spec.height * gather->spec.width;
}

/* The plain array, filled from the planes. */
static const float *take(const struct v2v_align_gather *gather, const float *base)
{
    int64_t width = gather->spec.width;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < gather->spec.in; i++) {
        struct v2v_plane plane = inside(gather, i);
        float *to = channel_of(gather, i);
        const float *from = base + plane.offset;
        memset(to, 0, (size_t)(gather->spec.height * width) * sizeof *to);
        for (int64_t y = plane.y0; y < plane.y1; y++) {
            memcpy(to + y * width + plane.x0, from + y * gather->pitch + plane.x0,
                   (size_t)(plane.x1 - plane.x0) * sizeof *to);
        }
    }
    return channel_of(gather, 0);
}

/* The same, blocked. */
static const float *take_blocked(const struct v2v_align_gather *gather, const float *base)
{
    struct v2v_blocked image = {.data = gather->spec.method.workspace->data,
                                .channels = gather->spec.in,
                                .height = gather->spec.height,
                                .width = gather->spec.width};
    int64_t count = v2v_blocked_count(image.channels);
#pragma omp parallel for schedule(static)
    for (int64_t place = 0; place < count * image.height; place++) {
        int64_t first = place / image.height * V2V_BLOCKED_CHANNELS, y = place % image.height;
        const float *row[V2V_BLOCKED_CHANNELS] = {NULL};
        for (int i = 0; i < V2V_BLOCKED_CHANNELS && first + i < image.channels; i++) {
            const struct v2v_plane *plane = &gather->plane[first + i];
            if (y >= plane->y0 && y < plane->y1) {
                row[i] = base + plane->offset + y * gather->pitch;
            }
        }
        v2v_blocked_set(&image, place / image.height, y, 0, row, image.width);
    }
    return image.data;
}

static void add_channel(const struct v2v_align_gather *gather, int64_t channel, float *base)
{
    struct v2v_plane plane = inside(gather, channel);
    const float *from = channel_of(gather, channel);
    float *to = base + plane.offset;
    for (int64_t y = plane.y0; y < plane.y1; y++) {
        for (int64_t x = plane.x0; x < plane.x1; x++) {
            to[y * gather->pitch + x] += from[y * gather->spec.width + x];
        }
    }
}

/* The adjoint of take; planes that share memory are one thread's. */
static void give(const struct v2v_align_gather *gather, float *base)
{
    const struct v2v_plane *plane = gather->plane;
    int64_t count = gather->spec.in;
#pragma omp parallel for schedule(dynamic)
    for (int64_t first = 0; first < count; first++) {
        if (first > 0 && plane[first].owner == plane[first - 1].owner) {
            continue;
        }
        for (int64_t i = first; i < count && plane[i].owner == plane[first].owner; i++) {
            add_channel(gather, i, base);
        }
    }
}

void v2v_align_gather_forward(struct v2v_align_gather *gather, float *out, const float *base)
{
    v2v_conv_forward(gather->conv, out,
                     gather->form == V2V_FORM_BLOCKED ? take_blocked(gather, base)
                                                      : take(gather, base));
}

void v2v_align_gather_backward(struct v2v_align_gather *gather, float *dweight, float *dbase,
                               const float *base, const float *dout)
{
    v2v_conv_backward_weights(gather->conv, dweight, NULL, take(gather, base), dout);
    v2v_conv_backward_data(gather->conv, channel_of(gather, 0), dout);
    give(gather, dbase);
}
