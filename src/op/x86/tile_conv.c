/* Convolutions of listed tiles in bf16. Some tiles at a time are one thread's: where the 6 x 6
 * pixels lie that each of them sees is found once, a plain input's are packed; then, block of
 * channels by block, their columns are laid side by side, so that what 16 outputs see through a tap
 * is a tile of the unit, and multiplied with all outputs' weights. */
#include "v2v3d/op/tile_conv.h"

#include "op/isa.h"
#include "op/x86/amx.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/blocked.h"

#include <immintrin.h>
#include <omp.h>
#include <string.h>

enum { TILE = V2V_TILE, PIXELS = TILE * TILE, SIDE = TILE + 2, SEEN = SIDE * SIDE, TAPS = 9 };

/* Tiles at a time, an even number: their sums and some blocks' weights stay in the second-level
 * cache, what two tiles see of those blocks in the first-level one. */
enum { GROUP = 32, PAIR = 2, BLOCKS = 2 };

/* What a tile sees of a block, three times: [tap's column][6][4][32]. */
enum { COLUMN = SIDE * TILE * AMX_DEPTH, LINED = TAPS / 3 * COLUMN };

enum { WEIGHTS = TAPS * 2 * AMX_TILE };

_Static_assert((int)PIXELS == (int)AMX_SIDE, "a tile of pixels is a side of the unit's tile");

struct v2v_tile_conv {
    struct v2v_tile_conv_spec spec;
    struct v2v_plane *plane;
    int threads, has_unit;
    int64_t blocks, outputs;     /* of 32 channels */
    int64_t packed_floats;       /* of a group's plain input */
    int64_t thread_floats;       /* that, what is lined up, and sums */
    int64_t columns, rows;       /* of tiles */
    int64_t out_rows, out_width; /* of a plain output */
    struct v2v_piece weights;    /* [block of outputs][block of channels], as packed */
    const float *bias;
};

int v2v_tile_conv_usable(void)
{
    return v2v_op_bf16() >= V2V_BF16_NATIVE;
}

enum v2v_status v2v_tile_conv_create(struct v2v_tile_conv **conv,
                                     const struct v2v_tile_conv_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tile_conv *self = NULL;
    V2V_ASSERT(v2v_tile_conv_usable() && spec->height % TILE == 0 && spec->width % TILE == 0);
    V2V_TRY(V2V_ALLOC(self, "tile_conv", 1));
    self->spec = *spec;
    self->threads = omp_get_max_threads();
    self->has_unit = v2v_amx_usable();
    self->rows = spec->height / TILE;
    self->columns = spec->width / TILE;
    self->out_rows = spec->height >> spec->stride2;
    self->out_width = spec->width >> spec->stride2;
    self->blocks = v2v_parts(spec->in, AMX_DEPTH);
    self->outputs = v2v_parts(spec->out, AMX_BLOCK);
    if (spec->plane != NULL) {
        V2V_TRY(V2V_ALLOC(self->plane, "tile_conv", spec->in));
        memcpy(self->plane, spec->plane, (size_t)spec->in * sizeof *self->plane);
        self->packed_floats = self->blocks * GROUP * SEEN * AMX_DEPTH / 2;
    }
    self->thread_floats =
        self->packed_floats + PAIR * BLOCKS * LINED / 2 + GROUP / PAIR * self->outputs * AMX_SUMS;
    V2V_TRY(v2v_pool_take(&self->weights, spec->pool, "conv.weights",
                          v2v_mem_product(self->outputs, self->blocks, WEIGHTS / 2)));
    V2V_TRY(v2v_workspace_reserve(spec->workspace, self->threads * self->thread_floats));
done:
    if (rc != V2V_OK) {
        v2v_tile_conv_destroy(&self);
    }
    *conv = self;
    return rc;
}

void v2v_tile_conv_destroy(struct v2v_tile_conv **conv)
{
    struct v2v_tile_conv *self = *conv;
    if (self != NULL) {
        v2v_mem_free(self->plane);
        v2v_pool_give(&self->weights);
        v2v_mem_free(self);
        *conv = NULL;
    }
}

void v2v_tile_conv_set_weights(struct v2v_tile_conv *self, const float *weight, const float *bias)
{
    const int64_t in = self->spec.in, out = self->spec.out;
    bf16 *weights = (bf16 *)v2v_piece_data(&self->weights);
    self->bias = bias;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t i = 0; i < self->outputs * self->blocks; i++) {
        const int64_t o = i / self->blocks * AMX_BLOCK, c = i % self->blocks * AMX_DEPTH;
        const struct amx_weights part = {
            .base = weight + (o * in + c) * TAPS, .out = in * TAPS, .in = TAPS, .taps = TAPS};
        v2v_amx_pack_weights(weights + i * WEIGHTS, &part, out - o, in - c);
    }
}

/* ---- what a group sees ---- */

struct place {
    int64_t row, column; /* of a tile */
};

/* Tiles of one thread, and where each of the pixels that they see lies: number `from` of the blocks
 * at `base`, which hold `pixels` each; -1: beyond the frame. */
struct group {
    int64_t count;
    struct place place[GROUP];
    int32_t from[GROUP][SEEN];
    const bf16 *base;
    int64_t pixels;
};

/* Tiles `first`, .. of a part, as far as there are any. */
static void list_places(struct group *group, const struct v2v_winograd_part *part, int64_t first)
{
    group->count = 0;
    for (int64_t r = 0; r < part->runs && group->count < GROUP; r++) {
        const struct v2v_tile_run *run = &part->run[r];
        for (int64_t t = first; t < run->count && group->count < GROUP; t++) {
            group->place[group->count++] = (struct place){run->row, run->first + t};
        }
        first = first > run->count ? first - run->count : 0;
    }
}

/* Pixel (y,x) of the frame about tile `own`, or the nearest one that the list has. */
static int64_t listed_pixel(const struct v2v_tiles *list, const struct place *own, int64_t y,
                            int64_t x)
{
    const int64_t row = v2v_parts(y + 1, TILE) - 1, column = v2v_parts(x + 1, TILE) - 1;
    if (row < 0 || row >= list->rows || column < 0 || column >= list->columns) {
        return -1;
    }
    const int64_t own_y = v2v_within(y - own->row * TILE, 0, TILE - 1);
    const int64_t own_x = v2v_within(x - own->column * TILE, 0, TILE - 1);
    int64_t number = list->number[row * list->columns + column];
    if (number >= 0) {
        return number * PIXELS + y % TILE * TILE + x % TILE;
    }
    number = list->number[own->row * list->columns + column];
    if (number >= 0 && column != own->column) {
        return number * PIXELS + own_y * TILE + x % TILE;
    }
    return (int64_t)list->number[own->row * list->columns + own->column] * PIXELS + own_y * TILE +
           own_x;
}

static void look_at_list(struct group *group, const struct v2v_winograd_part *part)
{
    for (int64_t t = 0; t < group->count; t++) {
        const struct place *place = &group->place[t];
        for (int64_t i = 0; i < SEEN; i++) {
            const int64_t pixel =
                listed_pixel(part->in_list, place, place->row * TILE - 1 + i / SIDE,
                             place->column * TILE - 1 + i % SIDE);
            group->from[t][i] = (int32_t)(pixel < 0 ? -1 : pixel + part->shift);
        }
    }
}

/* Six pixels of a plane's row y from x on. */
static void take_line(const struct v2v_tile_conv *self, float line[SIDE], const float *base,
                      const struct v2v_plane *plane, int64_t y, int64_t x)
{
    const int half = self->spec.half;
    const float *row = base + plane->offset + (y >> half) * self->spec.pitch;
    const int is_there = y >= plane->y0 && y < plane->y1;
    for (int64_t i = 0; i < SIDE; i++) {
        const int inside = is_there && x + i >= plane->x0 && x + i < plane->x1;
        line[i] = inside ? row[(x + i) >> half] : 0.0f;
    }
}

/* What a group sees of a plain input, packed. */
static void pack_planes(const struct v2v_tile_conv *self, bf16 *to, const float *base,
                        const struct group *group)
{
    float line[AMX_DEPTH][SIDE];
    for (int64_t b = 0; b < self->blocks; b++) {
        const int64_t channels = v2v_smaller(self->spec.in - b * AMX_DEPTH, AMX_DEPTH);
        const float *row[AMX_DEPTH] = {NULL};
        for (int64_t i = 0; i < channels; i++) {
            row[i] = line[i];
        }
        for (int64_t t = 0; t < group->count; t++) {
            const struct place *place = &group->place[t];
            for (int64_t y = 0; y < SIDE; y++) {
                for (int64_t i = 0; i < channels; i++) {
                    take_line(self, line[i], base, &self->plane[b * AMX_DEPTH + i],
                              place->row * TILE - 1 + y, place->column * TILE - 1);
                }
                v2v_amx_pack_pixels(to + ((b * GROUP + t) * SEEN + y * SIDE) * AMX_DEPTH, row, SIDE,
                                    1);
            }
        }
    }
}

static void look_at_packed(struct group *group)
{
    for (int64_t t = 0; t < group->count; t++) {
        for (int64_t i = 0; i < SEEN; i++) {
            group->from[t][i] = (int32_t)(t * SEEN + i);
        }
    }
}

/* ---- products ---- */

/* Of one tile and a block of channels: from a tap's first row on, 16 pixels follow each other. A
 * pixel is a vector, read once for the taps' columns that see it. */
__attribute__((target("arch=x86-64-v4,prefer-vector-width=512"))) static void
line_up(bf16 *to, const struct group *group, int64_t tile, int64_t block)
{
    static const bf16 zeros[AMX_DEPTH] = {0};
    const int32_t *from = group->from[tile];
    const bf16 *base = group->base + block * group->pixels * AMX_DEPTH;
    for (int64_t y = 0; y < SIDE; y++, to += TILE * AMX_DEPTH) {
#pragma GCC unroll 6
        for (int64_t x = 0; x < SIDE; x++) {
            const int32_t pixel = from[y * SIDE + x];
            const __m512i seen =
                _mm512_loadu_si512(pixel < 0 ? zeros : base + (int64_t)pixel * AMX_DEPTH);
#pragma GCC unroll 3
            for (int64_t column = 0; column < TAPS / 3; column++) {
                if (x >= column && x < column + TILE) {
                    _mm512_storeu_si512(to + column * COLUMN + (x - column) * AMX_DEPTH, seen);
                }
            }
        }
    }
}

/* What tiles `first` and the next see of a block of a list's channels: pixels that lie apart. */
static void ask_for(const struct group *group, int64_t first, int64_t block)
{
    const bf16 *base = group->base + block * group->pixels * AMX_DEPTH;
    for (int64_t t = first; t < v2v_smaller(first + PAIR, group->count); t++) {
        for (int64_t i = 0; i < SEEN; i++) {
            __builtin_prefetch(base + (int64_t)v2v_larger(group->from[t][i], 0) * AMX_DEPTH);
        }
    }
}

static void multiply(const struct v2v_tile_conv *self, float *sums, bf16 *lined,
                     const struct group *group)
{
    struct amx_walk walk = {.pixel = AMX_DEPTH, .block = LINED, .taps = TAPS};
    const bf16 *values[] = {lined, lined + BLOCKS * LINED};
    const bf16 *weights = (const bf16 *)v2v_piece_data(&self->weights);
    for (int t = 0; t < TAPS; t++) {
        walk.tap[t] = t % 3 * COLUMN + t / 3 * TILE * AMX_DEPTH;
    }
    for (int64_t b = 0; b < self->blocks; b += BLOCKS) {
        const int64_t blocks = v2v_smaller(BLOCKS, self->blocks - b);
        float *at = sums;
        for (int64_t t = 0; t < group->count; t += PAIR) {
            for (int64_t i = 0; i < PAIR * blocks; i++) { /* an odd tile is its own neighbour */
                line_up(lined + (i % PAIR * BLOCKS + i / PAIR) * LINED, group,
                        v2v_smaller(t + i % PAIR, group->count - 1), b + i / PAIR);
            }
            for (int64_t i = 0; self->plane == NULL && i < blocks; i++) {
                ask_for(group, t + PAIR, b + i);
            }
            for (int64_t o = 0; o < self->outputs; o++, at += AMX_SUMS) {
                (self->has_unit ? v2v_amx_multiply : v2v_dot_multiply)(
                    at, values, weights + (o * self->blocks + b) * WEIGHTS, &walk, blocks, b == 0);
            }
        }
    }
}

/* ---- output ---- */

/* The pixels of a plain image that a tile has, 32 outputs. */
static void give_plain(const struct v2v_tile_conv *self, float *out, const float *sums,
                       const struct amx_result *result, const struct place *place)
{
    float tile[AMX_BLOCK][PIXELS];
    const int step = 1 + self->spec.stride2;
    const int64_t width = self->out_width;
    v2v_amx_unpack(tile[0], PIXELS, sums, result);
    for (int64_t o = 0; o < v2v_smaller(result->outputs, AMX_BLOCK); o++) {
        float *to = out + (o * self->out_rows + place->row * TILE / step) * width +
                    place->column * TILE / step;
        for (int64_t y = 0; y < TILE; y += step) {
            for (int64_t x = 0; x < TILE; x += step) {
                to[y / step * width + x / step] = tile[o][y * TILE + x];
            }
        }
    }
}

static void give(const struct v2v_tile_conv *self, float *out, const float *sums,
                 const struct group *group, const struct v2v_winograd_part *part)
{
    const struct v2v_tiles *list = part->out_list;
    for (int64_t i = 0; i < group->count * self->outputs; i++) {
        const int64_t t = i / self->outputs, o = i % self->outputs;
        const struct place *place = &group->place[t];
        const float *from =
            sums + (t / PAIR * self->outputs + o) * AMX_SUMS + t % PAIR * (AMX_SUMS / PAIR);
        const struct amx_result result = {.bias = self->bias + o * AMX_BLOCK,
                                          .slope = self->spec.slope,
                                          .pixels = PIXELS,
                                          .outputs = self->spec.out - o * AMX_BLOCK};
        if (list == NULL) {
            give_plain(self, out + o * AMX_BLOCK * self->out_rows * self->out_width, from, &result,
                       place);
            continue;
        }
        const int64_t tile = list->number[place->row * list->columns + place->column] -
                             list->before[part->first_row];
        v2v_amx_unpack_blocked(
            (bf16 *)out + (o * self->spec.out_pixels + tile * PIXELS) * AMX_DEPTH, from, &result);
    }
}

static void run_group(const struct v2v_tile_conv *self, float *out, const float *in,
                      const struct v2v_winograd_part *part, int64_t first, float *mine)
{
    struct group group;
    float *sums = mine + self->packed_floats + PAIR * BLOCKS * LINED / 2;
    list_places(&group, part, first);
    if (self->plane != NULL) {
        pack_planes(self, (bf16 *)mine, in, &group);
        look_at_packed(&group);
        group.base = (const bf16 *)mine;
        group.pixels = (int64_t)GROUP * SEEN;
    } else {
        look_at_list(&group, part);
        group.base = (const bf16 *)in;
        group.pixels = self->spec.in_pixels;
    }
    multiply(self, sums, (bf16 *)(mine + self->packed_floats), &group);
    give(self, out, sums, &group, part);
}

void v2v_tile_conv_forward(struct v2v_tile_conv *self, float *out, const float *in,
                           const struct v2v_winograd_part *part)
{
    int64_t tiles = 0;
    V2V_ASSERT((part->in_list == NULL) == (self->plane != NULL));
    V2V_ASSERT((part->out_list == NULL) == (self->spec.out_pixels == 0));
    for (int64_t r = 0; r < part->runs; r++) {
        tiles += part->run[r].count;
    }
#pragma omp parallel num_threads(self->threads)
    {
        float *mine = self->spec.workspace->data + omp_get_thread_num() * self->thread_floats;
        if (self->has_unit) {
            v2v_amx_begin();
        }
#pragma omp for schedule(dynamic)
        for (int64_t first = 0; first < tiles; first += GROUP) {
            run_group(self, out, in, part, first, mine);
        }
        if (self->has_unit) {
            v2v_amx_end();
        }
    }
}
