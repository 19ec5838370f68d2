#include "v2v/padded.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/bulk.h"

#include <string.h>

enum v2v_status v2v_padded_init(struct v2v_padded *padded, int64_t views, int64_t features,
                                int64_t height, int64_t width, int64_t ring)
{
    enum v2v_status rc = V2V_OK;
    *padded = (struct v2v_padded){
        .views = views, .features = features, .height = height, .width = width, .ring = ring};
    V2V_TRY(V2V_ALLOC(padded->data, "model.features",
                      v2v_mem_product(views * features, height + 2 * ring, width + 2 * ring)));
done:
    return rc;
}

void v2v_padded_fini(struct v2v_padded *padded)
{
    v2v_mem_free(padded->data);
    *padded = (struct v2v_padded){0};
}

int64_t v2v_padded_offset(const struct v2v_padded *padded, int64_t view, int64_t feature)
{
    int64_t pitch = v2v_padded_pitch(padded), size = (padded->height + 2 * padded->ring) * pitch;
    return (view * padded->features + feature) * size + padded->ring * pitch + padded->ring;
}

static float *row_at(const struct v2v_padded *padded, int64_t view, int64_t feature, int64_t y)
{
    return padded->data + v2v_padded_offset(padded, view, feature) + y * v2v_padded_pitch(padded);
}

void v2v_padded_put_rows(struct v2v_padded *padded, int64_t view, const float *features,
                         int64_t height, int64_t y, int64_t count)
{
    int64_t width = padded->width;
    V2V_ASSERT(y >= -padded->ring && y + count <= padded->height + padded->ring);
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < padded->features * count; row++) {
        int64_t c = row / count, i = row % count;
        memcpy(row_at(padded, view, c, y + i), features + (c * height + i) * width,
               (size_t)width * sizeof *features);
    }
}

void v2v_padded_get_rows(const struct v2v_padded *padded, int64_t view, float *features, int64_t y,
                         int64_t count)
{
    int64_t width = padded->width;
    V2V_ASSERT(y >= -padded->ring && y + count <= padded->height + padded->ring);
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < padded->features * count; row++) {
        memcpy(features + row * width, row_at(padded, view, row / count, y + row % count),
               (size_t)width * sizeof *features);
    }
}

void v2v_padded_clear(struct v2v_padded *padded)
{
    int64_t floats = padded->views * padded->features * (padded->height + 2 * padded->ring) *
                     v2v_padded_pitch(padded);
    v2v_bulk_clear(padded->data, floats);
}
