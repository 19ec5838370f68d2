#include "v2v3d/op/tiles.h"
#include "v2v3d/base/bounds.h"

#include "v2v3d/base/memory.h"

#include <string.h>

enum v2v_status v2v_tiles_init(struct v2v_tiles *tiles, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    *tiles = (struct v2v_tiles){.rows = v2v_parts(height, V2V_TILE),
                                .columns = v2v_parts(width, V2V_TILE)};
    tiles->count = tiles->rows * tiles->columns;
    V2V_TRY(V2V_ALLOC(tiles->first, "tiles", tiles->rows + 1));
    V2V_TRY(
        V2V_ALLOC(tiles->run, "tiles", v2v_mem_product(tiles->rows, (tiles->columns + 1) / 2, 1)));
    V2V_TRY(V2V_ALLOC(tiles->before, "tiles", tiles->rows + 1));
    V2V_TRY(V2V_ALLOC(tiles->number, "tiles", tiles->count));
    for (int64_t row = 0; row < tiles->rows; row++) {
        tiles->run[row] = (struct v2v_tile_run){.row = row, .count = tiles->columns};
        tiles->first[row + 1] = row + 1;
        tiles->before[row + 1] = (row + 1) * tiles->columns;
    }
    for (int64_t i = 0; i < tiles->count; i++) {
        tiles->number[i] = (int32_t)i;
    }
done:
    return rc;
}

void v2v_tiles_fini(struct v2v_tiles *tiles)
{
    v2v_mem_free(tiles->run);
    v2v_mem_free(tiles->first);
    v2v_mem_free(tiles->before);
    v2v_mem_free(tiles->number);
    *tiles = (struct v2v_tiles){0};
}

void v2v_tiles_set(struct v2v_tiles *tiles, const uint8_t *mask)
{
    int64_t runs = 0;
    tiles->count = 0;
    for (int64_t row = 0; row < tiles->rows; row++) {
        const uint8_t *marked = mask + row * tiles->columns;
        int32_t *number = tiles->number + row * tiles->columns;
        for (int64_t x = 0; x < tiles->columns; x++) {
            number[x] = marked[x] ? (int32_t)tiles->count : -1;
            if (!marked[x]) {
                continue;
            }
            if (x == 0 || !marked[x - 1]) {
                tiles->run[runs++] = (struct v2v_tile_run){.row = row, .first = x};
            }
            tiles->run[runs - 1].count++;
            tiles->count++;
        }
        tiles->first[row + 1] = runs;
        tiles->before[row + 1] = tiles->count;
    }
}

void v2v_tiles_fill(const struct v2v_tiles *tiles, const struct v2v_tiles_image *image,
                    const float *value, int64_t step)
{
    int64_t size = image->size, width = image->width;
    const struct v2v_tile_run *end = tiles->run + tiles->first[image->last];
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < image->channels; c++) {
        float *channel = image->data + c * image->rows_held * width, level = value[c * step];
        for (const struct v2v_tile_run *run = tiles->run + tiles->first[image->first]; run < end;
             run++) {
            int64_t row = (run->row - image->begin) * size, x0 = run->first * size;
            int64_t x1 = v2v_smaller(x0 + run->count * size, width);
            for (int64_t y = row; y < v2v_smaller(row + size, image->rows_held); y++) {
                for (int64_t x = x0; x < x1; x++) {
                    channel[y * width + x] = level;
                }
            }
        }
    }
}

enum { TILE = V2V_TILE, PIXELS = TILE * TILE };

/* A line as a run sees it: of the tiles there, in a row of tiles, or where they are not listed the
 * run's own line that is nearest to it. */
struct sight {
    int64_t row, line, own_line;
};

/* The pixel beside the run, in column `x` of tiles. */
static float beside(const struct v2v_tiles *tiles, const float *channel,
                    const struct v2v_tile_run *run, const struct sight *sight, int64_t x)
{
    if (x < 0 || x >= tiles->columns) {
        return 0.0f;
    }
    int is_left = x < run->first;
    int64_t pixel = is_left ? TILE - 1 : 0;
    int64_t there = tiles->number[sight->row * tiles->columns + x];
    const int32_t *own = &tiles->number[run->row * tiles->columns + x];
    if (there >= 0) {
        return channel[there * PIXELS + sight->line * TILE + pixel];
    }
    if (own[0] >= 0) {
        return channel[own[0] * PIXELS + sight->own_line * TILE + pixel];
    }
    int64_t last = own[is_left ? 1 : -1]; /* the run's */
    return channel[last * PIXELS + sight->own_line * TILE + TILE - 1 - pixel];
}

void v2v_tiles_line(float *line, const struct v2v_tiles *tiles, const float *channel,
                    const struct v2v_tile_run *run, int64_t i)
{
    const struct sight sight = {.row = run->row + (i == 0 ? -1 : i > TILE),
                                .line = (i + TILE - 1) % TILE,
                                .own_line = v2v_within(i - 1, 0, TILE - 1)};
    int64_t count = run->count;
    if (sight.row < 0 || sight.row >= tiles->rows) {
        memset(line, 0, (size_t)(TILE * count + 2) * sizeof *line);
        return;
    }
    const int32_t *number = tiles->number + sight.row * tiles->columns + run->first;
    const float *own = channel + tiles->number[run->row * tiles->columns + run->first] * PIXELS;
    for (int64_t t = 0; t < count; t++) {
        const float *from = number[t] >= 0 ? channel + number[t] * PIXELS + sight.line * TILE
                                           : own + t * PIXELS + sight.own_line * TILE;
        memcpy(line + 1 + t * TILE, from, TILE * sizeof *line);
    }
    line[0] = beside(tiles, channel, run, &sight, run->first - 1);
    line[TILE * count + 1] = beside(tiles, channel, run, &sight, run->first + count);
}
