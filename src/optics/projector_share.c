#include "optics/projector_plan.h"
#include <string.h>

void v2v_projector_gather_views(struct v2v_projector *projector, float *whole, const float *rows,
                                int64_t count)
{
    const int size = v2v_comm_size(projector->comm);
    const int64_t pixels = projector->height * projector->width;
    const int64_t mine = projector->share.view_rows.count * projector->width;
    int64_t *counts = projector->counts, *offsets = counts + size;
    for (int r = 0; r < size; r++) {
        const struct v2v_part part = v2v_par_part(projector->height, size, r);
        counts[r] = part.count * projector->width;
        offsets[r] = part.first * projector->width;
    }
    for (int64_t i = 0; i < count; i++) {
        v2v_par_allgather_f32(projector->comm, whole + i * pixels, rows + i * mine, counts,
                              offsets);
    }
}

void v2v_projector_cut_views(const struct v2v_projector *projector, float *rows, const float *whole,
                             int64_t count)
{
    const int64_t pixels = projector->height * projector->width;
    const int64_t first = projector->share.view_rows.first * projector->width;
    const int64_t mine = projector->share.view_rows.count * projector->width;
    for (int64_t i = 0; i < count && mine > 0; i++) {
        memcpy(rows + i * mine, whole + i * pixels + first, (size_t)mine * sizeof *rows);
    }
}

struct v2v_part v2v_projector_slices(const struct v2v_projector *projector)
{
    return v2v_slicing_own(projector->slicing);
}

static int is_held_by_slices(const struct v2v_projector *projector)
{
    return projector->split == V2V_SPLIT_SLICES || v2v_comm_size(projector->comm) == 1;
}

static void copy_share(const struct v2v_projector *projector, float *to, const float *from)
{
    const int64_t count = projector->layout.slices * projector->height * projector->width;
    if (to != from && count > 0) {
        memcpy(to, from, (size_t)count * sizeof *to);
    }
}

void v2v_projector_from_slices(struct v2v_projector *projector, float *volume, const float *slices)
{
    if (is_held_by_slices(projector)) {
        copy_share(projector, volume, slices);
    } else {
        v2v_slicing_to_rows(projector->slicing, volume, slices);
    }
}

void v2v_projector_to_slices(struct v2v_projector *projector, float *slices, const float *volume)
{
    if (is_held_by_slices(projector)) {
        copy_share(projector, slices, volume);
    } else {
        v2v_slicing_to_slices(projector->slicing, slices, volume);
    }
}
