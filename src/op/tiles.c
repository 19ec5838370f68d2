#include "v2v3d/op/tiles.h"
#include "v2v3d/base/bounds.h"

#include "v2v3d/base/memory.h"

static int64_t tiles_of(int64_t pixels)
{
    return (pixels + V2V_TILE - 1) / V2V_TILE;
}

enum v2v_status v2v_tiles_init(struct v2v_tiles *tiles, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    *tiles = (struct v2v_tiles){.rows = tiles_of(height), .columns = tiles_of(width)};
    tiles->count = tiles->rows * tiles->columns;
    V2V_TRY(V2V_ALLOC(tiles->first, "tiles", tiles->rows + 1));
    V2V_TRY(
        V2V_ALLOC(tiles->run, "tiles", v2v_mem_product(tiles->rows, (tiles->columns + 1) / 2, 1)));
    for (int64_t row = 0; row < tiles->rows; row++) {
        tiles->run[row] = (struct v2v_tile_run){.row = row, .count = tiles->columns};
        tiles->first[row + 1] = row + 1;
    }
done:
    return rc;
}

void v2v_tiles_fini(struct v2v_tiles *tiles)
{
    v2v_mem_free(tiles->run);
    v2v_mem_free(tiles->first);
    *tiles = (struct v2v_tiles){0};
}

void v2v_tiles_set(struct v2v_tiles *tiles, const uint8_t *mask)
{
    int64_t runs = 0;
    tiles->count = 0;
    for (int64_t row = 0; row < tiles->rows; row++) {
        const uint8_t *marked = mask + row * tiles->columns;
        for (int64_t x = 0; x < tiles->columns; x++) {
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
    }
}

void v2v_tiles_fill(const struct v2v_tiles *tiles, const struct v2v_tiles_image *image, int64_t y0,
                    int64_t y1, const float *value, int64_t step)
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
            for (int64_t y = row + y0; y < v2v_smaller(row + y1, image->rows_held); y++) {
                for (int64_t x = x0; x < x1; x++) {
                    channel[y * width + x] = level;
                }
            }
        }
    }
}
