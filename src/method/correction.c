#include "method/correction.h"

#include "method/depth_net.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <string.h>

/* Of a tile's side, two thirds of which count: for 39 slices its layers hold 240 MB. */
enum { SIDE = 96, HALO = DEPTH_NET_HALO };

/* Tiles along one axis. */
struct axis {
    int64_t whole, even; /* pixels; of an odd side the network sees the last but one once more */
    int64_t tile;        /* even */
    int64_t tiles;
};

struct v2v_correction {
    struct v2v_network *network; /* borrowed */
    struct axis y, x;
    float *features; /* [feature,z,tile] */
    float *volume;   /* [z,tile] */
};

static struct axis axis_of(int64_t whole)
{
    const int64_t even = whole + whole % 2, tile = v2v_smaller(SIDE, even);
    const int64_t tiles = tile == even ? 1 : v2v_parts(even - 2 * HALO, tile - 2 * HALO);
    return (struct axis){whole, even, tile, tiles};
}

/* The first pixel of a tile: even. */
static int64_t start_of(const struct axis *axis, int64_t tile)
{
    return v2v_smaller(tile * (axis->tile - 2 * HALO), axis->even - axis->tile);
}

/* The pixels of the frame that a tile gives. */
static struct v2v_part given_by(const struct axis *axis, int64_t tile)
{
    const int64_t first = tile > 0 ? start_of(axis, tile - 1) + axis->tile - HALO : 0;
    const int64_t inner = tile < axis->tiles - 1 ? HALO : 0;
    const int64_t end = start_of(axis, tile) + axis->tile - inner;
    return (struct v2v_part){first, v2v_smaller(end, axis->whole) - first};
}

/* The pixel of the frame that place `i` shows. */
static int64_t shown_at(const struct axis *axis, int64_t i)
{
    return i < axis->whole ? i : v2v_larger(axis->whole - 2, 0);
}

enum v2v_status v2v_correction_create(struct v2v_correction **correction,
                                      struct v2v_network *network, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_correction *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "correction", 1));
    *self = (struct v2v_correction){.network = network, .y = axis_of(height), .x = axis_of(width)};
    const struct v2v_network_plan plan = {.height = self->y.tile, .width = self->x.tile};
    const int64_t voxels = v2v_mem_product(network->slices, plan.height, plan.width);
    V2V_TRY(V2V_ALLOC(self->features, "correction.tile", v2v_mem_product(V2V_FEATURES, voxels, 1)));
    V2V_TRY(V2V_ALLOC(self->volume, "correction.tile", voxels));
    V2V_TRY(network->ops->plan(network, &plan));
done:
    if (rc != V2V_OK) {
        v2v_correction_destroy(&self);
    }
    *correction = self;
    return rc;
}

void v2v_correction_destroy(struct v2v_correction **correction)
{
    struct v2v_correction *self = *correction;
    *correction = NULL;
    if (self != NULL) {
        v2v_mem_free(self->features);
        v2v_mem_free(self->volume);
        v2v_mem_free(self);
    }
}

void v2v_correction_weights_changed(struct v2v_correction *correction)
{
    struct v2v_network *network = correction->network;
    network->ops->weights_changed(network);
}

int64_t v2v_correction_bytes(int64_t slices)
{
    struct v2v_grid_work work;
    const struct v2v_network_spec spec = {.slices = slices};
    v2v_network_depth_net.describe_work(&work, &spec, SIDE, SIDE);
    return work.bytes; /* those of its features and its volume counted in */
}

static void take(const struct v2v_correction *self, const float *features, int64_t top,
                 int64_t left)
{
    const struct axis *y = &self->y, *x = &self->x;
    const int64_t planes = V2V_FEATURES * self->network->slices;
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < planes * y->tile; row++) {
        const int64_t plane = row / y->tile, line = shown_at(y, top + row % y->tile);
        const float *from = features + (plane * y->whole + line) * x->whole;
        float *to = self->features + row * x->tile;
        const int64_t inside = v2v_smaller(x->tile, x->whole - left);
        memcpy(to, from + left, (size_t)inside * sizeof *to);
        for (int64_t i = inside; i < x->tile; i++) {
            to[i] = from[shown_at(x, left + i)];
        }
    }
}

static void give(const struct v2v_correction *self, float *volume, int64_t tile_y, int64_t tile_x)
{
    const struct axis *y = &self->y, *x = &self->x;
    const struct v2v_part rows = given_by(y, tile_y), columns = given_by(x, tile_x);
    const int64_t top = start_of(y, tile_y), left = start_of(x, tile_x);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < self->network->slices * rows.count; i++) {
        const int64_t z = i / rows.count, line = rows.first + i % rows.count;
        const float *from = self->volume + (z * y->tile + line - top) * x->tile;
        float *to = volume + (z * y->whole + line) * x->whole;
        for (int64_t c = columns.first; c < columns.first + columns.count; c++) {
            to[c] = from[c - left] < 0.0f ? 0.0f : from[c - left]; /* NaN stays */
        }
    }
}

void v2v_correction_run(struct v2v_correction *correction, float *volume, const float *features)
{
    struct v2v_correction *self = correction;
    struct v2v_network *network = self->network;
    for (int64_t tile_y = 0; tile_y < self->y.tiles; tile_y++) {
        for (int64_t tile_x = 0; tile_x < self->x.tiles; tile_x++) {
            v2v_watchdog_beat("a tile of the correction");
            take(self, features, start_of(&self->y, tile_y), start_of(&self->x, tile_x));
            network->ops->forward(network, &self->volume, self->features);
            give(self, volume, tile_y, tile_x);
        }
    }
}
