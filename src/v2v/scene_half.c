#include "v2v/scene_half.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <string.h>

enum { TILE = V2V_TILE };

/* Tiles of the frame, of an even number of rows and columns, become a quarter as many. */
enum v2v_status v2v_scene_half_init(struct v2v_scene_half *half, const struct v2v_tiles *frame)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiles *lists[] = {&half->mixed, &half->even, &half->read};
    *half = (struct v2v_scene_half){0};
    V2V_ASSERT(frame->rows % 2 == 0 && frame->columns % 2 == 0);
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        V2V_TRY(v2v_tiles_init(lists[i], frame->rows / 2 * TILE, frame->columns / 2 * TILE));
    }
    V2V_TRY(V2V_ALLOC(half->mask, "scene", frame->rows * frame->columns));
done:
    return rc;
}

void v2v_scene_half_fini(struct v2v_scene_half *half)
{
    v2v_tiles_fini(&half->mixed);
    v2v_tiles_fini(&half->even);
    v2v_tiles_fini(&half->read);
    v2v_mem_free(half->mask);
    *half = (struct v2v_scene_half){0};
}

/* Mark tiles [y0,y1) x [x0,x1) of half the sides, where there are such. */
static void mark(struct v2v_scene_half *half, int64_t y0, int64_t y1, int64_t x0, int64_t x1)
{
    int64_t rows = half->read.rows, columns = half->read.columns;
    x1 = v2v_smaller(x1, columns);
    for (int64_t y = y0; y < v2v_smaller(y1, rows); y++) {
        memset(half->mask + y * columns + x0, 1, (size_t)(x1 - x0));
    }
}

/* Mark what has to do with tiles [x0,x1) of the frame's row y. Tile i of the frame reads pixels
 * 2 i - 1 .. 2 i + 2 of half the sides; and tile i of half the sides sees what became of tiles
 * 2 i - 1 .. 2 i + 2 of the frame. Either way it is tiles (i - 1) / 2 .. (i + 1) / 2. */
static void mark_run(struct v2v_scene_half *half, int64_t y, int64_t x0, int64_t x1)
{
    mark(half, (y - 1) / 2, (y + 1) / 2 + 1, (x0 - 1) / 2, x1 / 2 + 1);
}

static void clear(struct v2v_scene_half *half)
{
    memset(half->mask, 0, (size_t)(half->read.rows * half->read.columns));
}

static void list_read(struct v2v_scene_half *half, const struct v2v_tiles *computed)
{
    clear(half);
    for (int64_t r = 0; r < computed->first[computed->rows]; r++) {
        const struct v2v_tile_run *run = &computed->run[r];
        mark_run(half, run->row, run->first, run->first + run->count);
    }
    v2v_tiles_set(&half->read, half->mask);
}

/* Mark what sees tiles of row y that are not among `dark`: those between its runs. */
static void mark_lit(struct v2v_scene_half *half, const struct v2v_tiles *dark, int64_t y)
{
    int64_t lit = 0;
    for (int64_t r = dark->first[y]; r < dark->first[y + 1]; r++) {
        const struct v2v_tile_run *run = &dark->run[r];
        if (lit < run->first) {
            mark_run(half, y, lit, run->first);
        }
        lit = run->first + run->count;
    }
    if (lit < dark->columns) {
        mark_run(half, y, lit, dark->columns);
    }
}

/* What lies at an edge sees the zeros beyond it. */
static void list_mixed(struct v2v_scene_half *half, const struct v2v_tiles *dark)
{
    int64_t rows = half->mixed.rows, columns = half->mixed.columns;
    clear(half);
    for (int64_t y = 0; y < dark->rows; y++) {
        mark_lit(half, dark, y);
    }
    mark(half, 0, 1, 0, columns);
    mark(half, rows - 1, rows, 0, columns);
    mark(half, 0, rows, 0, 1);
    mark(half, 0, rows, columns - 1, columns);
    half->mask[half->row * columns + half->column] = 1;
    v2v_tiles_set(&half->mixed, half->mask);
    for (int64_t i = 0; i < rows * columns; i++) {
        half->mask[i] = !half->mask[i];
    }
    v2v_tiles_set(&half->even, half->mask);
}

/* Three tiles or more into the square, even where it begins at an odd one: the tile sees nothing
 * outside. */
void v2v_scene_half_set(struct v2v_scene_half *half, const struct v2v_tiles *computed,
                        const struct v2v_tiles *dark, int64_t row, int64_t column)
{
    half->row = (row + 3) / 2;
    half->column = (column + 3) / 2;
    list_read(half, computed);
    list_mixed(half, dark);
}

void v2v_scene_half_level(const struct v2v_scene_half *half, float *images, int64_t channels)
{
    int64_t rows = half->even.rows, width = half->even.columns * TILE;
    struct v2v_tiles_image image = {.data = images,
                                    .channels = channels,
                                    .rows_held = rows * TILE,
                                    .width = width,
                                    .last = rows,
                                    .size = TILE};
    v2v_tiles_fill(&half->even, &image, images + (half->row * width + half->column) * TILE,
                   rows * TILE * width);
}
