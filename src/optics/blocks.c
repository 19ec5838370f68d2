#include "v2v3d/optics/blocks.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/taps.h"

#include <string.h>

enum { SIDE = 3, PLACES = SIDE * SIDE };

/* The taps of one view on a grid that has room for a block's reach on every side. */
struct cover {
    int64_t radius, side;
    uint8_t *open;  /* [side,side]: a tap that no block has taken */
    int32_t *taken; /* [side,side]: block * 9 + place of a tap */
};

static int64_t cell(const struct cover *cover, int64_t y, int64_t x)
{
    return (y + cover->radius) * cover->side + x + cover->radius;
}

static int gain(const struct cover *cover, int64_t y, int64_t x)
{
    int open = 0;
    for (int k = -1; k <= 1; k++) {
        for (int l = -1; l <= 1; l++) {
            open += cover->open[cell(cover, y + k, x + l)];
        }
    }
    return open;
}

/* The first position that takes most open taps; 0: none is open. */
static int best_block(const struct cover *cover, struct v2v_block *best)
{
    int64_t reach = cover->radius - 1;
    int most = 0;
    for (int64_t y = -reach; y <= reach; y++) {
        for (int64_t x = -reach; x <= reach; x++) {
            int taps = gain(cover, y, x);
            if (taps > most) {
                most = taps;
                best->y = (int32_t)y;
                best->x = (int32_t)x;
            }
        }
    }
    return most;
}

static void take_block(struct cover *cover, const struct v2v_block *block, int64_t index)
{
    for (int place = 0; place < PLACES; place++) {
        int64_t at = cell(cover, block->y + place / SIDE - 1, block->x + place % SIDE - 1);
        if (cover->open[at]) {
            cover->open[at] = 0;
            cover->taken[at] = (int32_t)(index * PLACES + place);
        }
    }
}

/* Greedy: exact for taps on a grid of blocks, a few blocks too many on diagonals. */
static void cover_view(struct v2v_blocks *blocks, struct cover *cover, const struct v2v_taps *taps,
                       int32_t view)
{
    struct v2v_block block = {.view = view};
    memset(cover->open, 0, (size_t)(cover->side * cover->side));
    for (int64_t t = 0; t < taps->count; t++) {
        if (taps->tap[t].view == view) {
            cover->open[cell(cover, taps->tap[t].y, taps->tap[t].x)] = 1;
        }
    }
    while (best_block(cover, &block) > 0) {
        take_block(cover, &block, blocks->count);
        blocks->block[blocks->count++] = block;
    }
    int64_t places = blocks->slices * PLACES;
    for (int64_t place = view * places; place < (view + 1) * places; place++) {
        const struct v2v_tap *tap = &taps->tap[taps->of[place]];
        blocks->of[place] = cover->taken[cell(cover, tap->y, tap->x)];
    }
}

static enum v2v_status cover_taps(struct v2v_blocks *blocks, const struct v2v_shifts *shifts,
                                  const int32_t *views)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_taps taps = {0};
    struct cover cover = {.radius = v2v_shifts_reach(shifts) + 3};
    cover.side = 2 * cover.radius + 1;
    V2V_TRY(v2v_taps_create(&taps, shifts, views, blocks->views, V2V_TAPS_ALL, V2V_TAPS_ALL, 1));
    V2V_TRY(V2V_ALLOC(cover.open, "blocks.scratch", cover.side * cover.side));
    V2V_TRY(V2V_ALLOC(cover.taken, "blocks.scratch", cover.side * cover.side));
    for (int64_t i = 0; i < blocks->views; i++) {
        cover_view(blocks, &cover, &taps, (int32_t)i);
        blocks->first[i + 1] = blocks->count;
    }
done:
    v2v_mem_free(cover.open);
    v2v_mem_free(cover.taken);
    v2v_taps_fini(&taps);
    return rc;
}

static void one_for_each_slice(struct v2v_blocks *blocks, const struct v2v_shifts *shifts,
                               const int32_t *views)
{
    for (int64_t i = 0; i < blocks->views; i++) {
        for (int64_t z = 0; z < blocks->slices; z++) {
            int64_t at = views[i] * blocks->slices + z;
            blocks->block[blocks->count++] =
                (struct v2v_block){(int32_t)i, shifts->dy[at], shifts->dx[at]};
        }
        blocks->first[i + 1] = blocks->count;
    }
    for (int64_t place = 0; place < blocks->count * PLACES; place++) {
        blocks->of[place] = (int32_t)place;
    }
}

enum v2v_status v2v_blocks_create(struct v2v_blocks *blocks, const struct v2v_shifts *shifts,
                                  const int32_t *views, int64_t count, int merged)
{
    enum v2v_status rc = V2V_OK;
    int64_t places = v2v_mem_product(count, shifts->slices, PLACES);
    *blocks = (struct v2v_blocks){.views = count, .slices = shifts->slices};
    /* a block takes at least one tap, and there are no more taps than places */
    V2V_TRY(V2V_ALLOC(blocks->block, "blocks", places));
    V2V_TRY(V2V_ALLOC(blocks->first, "blocks", count + 1));
    V2V_TRY(V2V_ALLOC(blocks->of, "blocks", places));
    if (merged) {
        V2V_TRY(cover_taps(blocks, shifts, views));
    } else {
        one_for_each_slice(blocks, shifts, views);
    }
done:
    if (rc != V2V_OK) {
        v2v_blocks_fini(blocks);
    }
    return rc;
}

void v2v_blocks_fini(struct v2v_blocks *blocks)
{
    v2v_mem_free(blocks->block);
    v2v_mem_free(blocks->first);
    v2v_mem_free(blocks->of);
    *blocks = (struct v2v_blocks){0};
}
