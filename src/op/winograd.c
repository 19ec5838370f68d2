/* Chunks of tile rows go through three stages, each over all threads: transform the input planes
 * into values, multiply for every point of the transform, transform back. Values lie in panels of
 * 32 tiles, [point][panel][channel][32]. The gradients are the exact adjoints of the three stages.
 */
#include "v2v3d/op/winograd.h"
#include "v2v3d/base/bounds.h"

#include "op/panel_kernel.h"
#include "op/pixels.h"
#include "op/winograd_kernel.h"
#include "op/winograd_rows.h"
#include "v2v3d/base/memory.h"

#include <omp.h>
#include <string.h>

enum { TILES = PANEL_COLUMNS, FILTERS = PANEL_ROWS };

_Static_assert((int)WINOGRAD_TILE == (int)V2V_TILE, "lists of tiles are lists of our tiles");

/** Channels or tiles of one pass of products: a panel's share, 16 KB, stays in the first-level
 *  cache, all left rows' share in the second-level one. */
enum { DEPTH = 128 };

/** Values of a chunk: few enough not to be the job's memory, enough that the weights are not read
 *  from memory too often. */
static const int64_t CHUNK_FLOATS = 16 << 20;

/** In training: filters are transposed, the weights' gradient comes from memory, once a chunk. */
static const int64_t TRAINING_CHUNK_FLOATS = 64 << 20;

struct v2v_winograd {
    struct v2v_winograd_spec spec;
    struct v2v_plane *plane;
    struct v2v_tiles tiles; /* all */
    const struct panel_kernel *panel;
    const struct winograd_kernel *kernel;
    int threads;
    int64_t in8, out8, out32;         /**< channels, filled up */
    int64_t out_height, out_width;    /**< of the output image */
    int64_t out_rows;                 /**< that its array holds */
    int64_t chunk_tiles, panels;      /**< of the largest chunk */
    int64_t line_floats, pack_floats; /**< of one thread */
    const float *bias;
    struct v2v_piece weights; /**< [point][run of DEPTH inputs][out8/8][input of the run][8] */
    float *kept; /**< [chunk] the input's values of the last forward pass; NULL: they are not */
    int is_kept; /**< and that pass was not followed by a backward one */
};

/* ---- plan ---- */

static void plan(struct v2v_winograd *self)
{
    const struct v2v_winograd_spec *spec = &self->spec;
    self->out_height = (spec->height + spec->stride2) >> spec->stride2;
    self->out_width = (spec->width + spec->stride2) >> spec->stride2;
    self->out_rows = spec->out_rows > 0 ? spec->out_rows : self->out_height;
    self->in8 = v2v_round_up(spec->in, PANEL_ROWS);
    self->out8 = v2v_round_up(spec->out, PANEL_ROWS);
    self->out32 = v2v_round_up(spec->out, PANEL_COLUMNS);
    int64_t row = WINOGRAD_VALUES * (self->in8 + self->out8) * self->tiles.columns;
    int64_t floats = spec->training ? TRAINING_CHUNK_FLOATS : CHUNK_FLOATS;
    floats = spec->chunk_floats > 0 ? spec->chunk_floats : floats;
    int64_t most = floats / row > 1 ? floats / row : 1;
    int64_t chunks = (self->tiles.rows + most - 1) / most;
    self->chunk_tiles = (self->tiles.rows + chunks - 1) / chunks * self->tiles.columns;
    self->panels = (self->chunk_tiles + TILES - 1) / TILES;
    self->line_floats = v2v_rows_floats(self->tiles.columns);
    self->pack_floats = spec->training ? DEPTH * (self->in8 + PANEL_COLUMNS) : 0;
}

/* Floats from point to point of the weights and of their gradient: as v2v_rows_point, not a power
 * of two. */
static int64_t weights_point(const struct v2v_winograd *self)
{
    return self->out8 * self->spec.in + 16;
}

static int64_t gradient_point(const struct v2v_winograd *self)
{
    return self->out32 * self->in8 + 16;
}

/* Rows of tiles of a chunk, and the values of its input. */
static int64_t chunk_rows(const struct v2v_winograd *self)
{
    return self->chunk_tiles / self->tiles.columns;
}

static int64_t input_floats(const struct v2v_winograd *self)
{
    return WINOGRAD_VALUES * v2v_rows_point(self->panels, self->in8);
}

/* One buffer after the other: lines and packed operands of every thread, values of both sides. */
static int64_t lay_out(const struct v2v_winograd *self, float *memory, float **lines, float **packs,
                       float **input, float **output, float **gradient)
{
    int64_t total = 0;
    const struct {
        float **place;
        int64_t floats;
    } part[] = {
        {lines, self->threads * self->line_floats},
        {packs, self->threads * self->pack_floats},
        {input, input_floats(self)},
        {output, WINOGRAD_VALUES * v2v_rows_point(self->panels, self->out8)},
        {gradient, self->spec.training ? WINOGRAD_VALUES * gradient_point(self) : 0},
    };
    for (size_t i = 0; i < sizeof part / sizeof *part; i++) {
        if (memory != NULL) {
            *part[i].place = memory + total;
        }
        total += v2v_round_up(part[i].floats, 16);
    }
    return total;
}

enum v2v_status v2v_winograd_create(struct v2v_winograd **winograd,
                                    const struct v2v_winograd_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_winograd *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "winograd", 1));
    self->spec = *spec;
    V2V_TRY(V2V_ALLOC(self->plane, "winograd", spec->in));
    memcpy(self->plane, spec->plane, (size_t)spec->in * sizeof *self->plane);
    self->panel = v2v_panel_choose();
    self->kernel = v2v_winograd_choose();
    self->threads = omp_get_max_threads();
    V2V_TRY(v2v_tiles_init(&self->tiles, spec->height, spec->width));
    plan(self);
    V2V_TRY(v2v_pool_take(&self->weights, spec->pool, "conv.weights",
                          v2v_mem_product(WINOGRAD_VALUES, weights_point(self), 1)));
    if (spec->keeps) {
        int64_t chunks = (self->tiles.rows + chunk_rows(self) - 1) / chunk_rows(self);
        V2V_TRY(V2V_ALLOC(self->kept, "conv.kept", v2v_mem_product(chunks, input_floats(self), 1)));
    }
    V2V_TRY(
        v2v_workspace_reserve(spec->workspace, lay_out(self, NULL, NULL, NULL, NULL, NULL, NULL)));
done:
    if (rc != V2V_OK) {
        v2v_winograd_destroy(&self);
    }
    *winograd = self;
    return rc;
}

void v2v_winograd_destroy(struct v2v_winograd **winograd)
{
    if (*winograd == NULL) {
        return;
    }
    v2v_mem_free((*winograd)->plane);
    v2v_tiles_fini(&(*winograd)->tiles);
    v2v_pool_give(&(*winograd)->weights);
    v2v_mem_free((*winograd)->kept);
    v2v_mem_free(*winograd);
    *winograd = NULL;
}

/* ---- weights ---- */

/* Place of the filters of 8 outputs from `out` on for input `in`, among those of a point. */
static int64_t filters_at(const struct v2v_winograd *self, int64_t out, int64_t in)
{
    int64_t run = in / DEPTH * DEPTH, depth = v2v_smaller(DEPTH, self->spec.in - run);
    return run * self->out8 + out * depth + (in - run) * FILTERS;
}

/* Filters of 8 outputs and 2 inputs at a time, [9][2][8] taps: as they lie among the transformed
 * ones, and a vector of the widest instruction set. */
enum { PAIR = 2 * FILTERS };

static void gather_taps(float *taps, const float *weight, int64_t in, int64_t inputs,
                        int64_t outputs)
{
    for (int64_t o = 0; o < outputs; o++) {
        for (int64_t i = 0; i < inputs; i++) {
            const float *from = weight + (o * in + i) * 9;
            for (int64_t k = 0; k < 9; k++) {
                taps[k * PAIR + i * FILTERS + o] = from[k];
            }
        }
    }
}

void v2v_winograd_set_weights(struct v2v_winograd *self, const float *weight, const float *bias)
{
    int64_t in = self->spec.in, out = self->spec.out;
    float *weights = v2v_piece_data(&self->weights);
    self->bias = bias;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t o = 0; o < out; o += FILTERS) {
        float taps[9 * PAIR] = {0};
        for (int64_t i = 0; i < in; i += 2) {
            int64_t inputs = v2v_smaller(2, in - i);
            gather_taps(taps, weight + (o * in + i) * 9, in, inputs, v2v_smaller(FILTERS, out - o));
            self->kernel->weights(weights + filters_at(self, o, i), weights_point(self), taps, PAIR,
                                  inputs * FILTERS);
        }
    }
}

/* ---- stages ---- */

/* A chunk of runs and the memory it uses. The input's gradient takes the place of the input's
 * values unless these are kept. */
struct chunk {
    struct rows rows;
    int64_t panels;
    int64_t over; /* tiles of the last run that are left for the next chunk */
    float *packs;
    float *input, *dinput, *output, *gradient;
};

/* The first `most` tiles of these runs; `begun` of the first one belong to the chunk before. */
static struct chunk chunk_of(const struct v2v_winograd *self, const struct v2v_tile_run *run,
                             int64_t runs, int64_t begun, int64_t most)
{
    struct chunk chunk = {0};
    const struct v2v_winograd_spec *spec = &self->spec;
    int64_t taken = 0, tiles = -begun;
    while (taken < runs && tiles < most) {
        V2V_ASSERT(run[taken].row < self->tiles.rows);
        V2V_ASSERT(run[taken].first + run[taken].count <= self->tiles.columns);
        tiles += run[taken++].count;
    }
    chunk.over = tiles > most ? tiles - most : 0;
    chunk.rows = (struct rows){.kernel = self->kernel,
                               .run = run,
                               .runs = taken,
                               .begun = begun,
                               .tiles = tiles - chunk.over,
                               .tiles_x = self->tiles.columns,
                               .height = spec->height,
                               .width = spec->width,
                               .out_width = self->out_width,
                               .stride2 = spec->stride2,
                               .pitch = spec->pitch,
                               .half = spec->half,
                               .line_floats = self->line_floats};
    chunk.panels = (chunk.rows.tiles + TILES - 1) / TILES;
    chunk.rows.panels = chunk.panels;
    (void)lay_out(self, spec->workspace->data, &chunk.rows.lines, &chunk.packs, &chunk.dinput,
                  &chunk.output, &chunk.gradient);
    chunk.input = chunk.dinput;
    if (self->kept != NULL) {
        chunk.input = self->kept + run->row / chunk_rows(self) * input_floats(self);
    }
    return chunk;
}

/* Whole rows, from row of tiles `first` on. */
static struct chunk chunk_at(const struct v2v_winograd *self, int64_t first)
{
    return chunk_of(self, self->tiles.run + first, self->tiles.rows - first, 0, self->chunk_tiles);
}

static float *thread_pack(const struct v2v_winograd *self, const struct chunk *chunk)
{
    return chunk->packs + omp_get_thread_num() * self->pack_floats;
}

static void transform_input(const struct v2v_winograd *self, const struct chunk *chunk,
                            const float *base)
{
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t i = 0; i < self->spec.in; i++) {
        v2v_rows_input(&chunk->rows, chunk->input + i * TILES, self->in8, base, self->plane, i,
                       i + 1 < self->spec.in ? i + 1 : i);
    }
}

static void transform_output(const struct v2v_winograd *self, const struct chunk *chunk, float *out)
{
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t o = 0; o < self->spec.out; o++) {
        v2v_rows_output(&chunk->rows, out + o * self->out_rows * self->out_width,
                        chunk->output + o * TILES, self->out8, self->bias[o], self->spec.slope);
    }
}

/* Which chunks of a pass these are. */
enum { FIRST_CHUNK = 1, LAST_CHUNK = 2 };

/* The bias's gradient is summed where a plane of dout comes into a cache anyway. */
static void transform_output_gradient(const struct v2v_winograd *self, const struct chunk *chunk,
                                      const struct v2v_gradients *to, const float *dout, int which)
{
    int64_t height = self->out_height, width = self->out_width;
    int sums = (which & FIRST_CHUNK) != 0 && to->dbias != NULL;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t o = 0; o < self->spec.out; o++) {
        const float *plane = dout + o * height * width;
        if (sums) {
            float sum = (float)v2v_pixels_sum(plane, height, width);
            to->dbias[o] = to->sets ? sum : to->dbias[o] + sum;
        }
        v2v_rows_output_turned(&chunk->rows, chunk->output + o * TILES, self->out8, plane);
    }
}

/* Planes of one owner overlap: one thread adds to them, in the list's order. Those that are set are
 * cleared by that thread, whose cache then holds them, and taken back through the activation before
 * they leave it. Rows of tiles overlap, too: they are added in their order, so that the sums are
 * the same in an image and in slabs of it. */
static void add_input_gradient(const struct v2v_winograd *self, const struct chunk *chunk,
                               const struct v2v_gradients *to, const float *base, int which)
{
    int64_t in = self->spec.in, image = (self->spec.height >> self->spec.half) * self->spec.pitch;
    int clears = (which & FIRST_CHUNK) != 0 && self->spec.sets;
    int activates = (which & LAST_CHUNK) != 0 && to->in_slope > 0.0f;
    const struct v2v_plane *plane = self->plane;
    struct rows rows = chunk->rows;
    rows.in_order = 1;
    V2V_ASSERT(self->spec.sets || !activates);
#pragma omp parallel for schedule(dynamic, PANEL_ROWS) num_threads(self->threads)
    for (int64_t first = 0; first < in; first++) {
        if (first > 0 && plane[first].owner == plane[first - 1].owner) {
            continue;
        }
        for (int64_t i = first; i < in && plane[i].owner == plane[first].owner; i++) {
            float *din = to->din + plane[i].offset;
            if (clears) {
                memset(din, 0, (size_t)image * sizeof *din);
            }
            v2v_rows_input_turned(&rows, to->din, &plane[i], chunk->dinput + i * TILES, self->in8);
            if (activates) {
                v2v_pixels_activate_turned(din, din, base + plane[i].offset, image, to->in_slope);
            }
        }
    }
}

/* ---- products, for every point ---- */

/* What a pass of products reads: left[rows/8][step][8] and right[panel][channels][32], `depth` of
 * its channels. */
struct share {
    const float *left, *right;
    int64_t rows, step, channels, depth;
};

/* Ask memory for `lines` lines of a cache. Inline, or the compiler would take it for a function
 * without effect. */
static inline __attribute__((always_inline)) void fetch(const float *next, int64_t lines)
{
    for (int64_t line = 0; line < lines; line++) {
        __builtin_prefetch(next + line * WINOGRAD_LINE, 0, 2);
    }
}

/* Lines that each of `products` asks for, to have `floats` in the end. */
static int64_t lines_each(int64_t floats, int64_t products)
{
    return (floats / WINOGRAD_LINE + products - 1) / products;
}

/* sums[panel][rows][32] = (add: +=) left times right. Every product asks for its part of what is
 * taken of the next panel, for that went past the caches; behind the last panel comes the first
 * one's part of the next pass, the channels after these. */
static void multiply_share(const struct v2v_winograd *self, const struct chunk *chunk, float *sums,
                           const struct share *share, int add)
{
    int64_t lines = lines_each(DEPTH * TILES, share->rows / PANEL_ROWS);
    for (int64_t panel = 0; panel < chunk->panels; panel++) {
        const float *right = share->right + panel * share->channels * TILES;
        const float *next = panel + 1 < chunk->panels ? right + share->channels * TILES
                                                      : share->right + share->depth * TILES;
        for (int64_t row = 0; row < share->rows; row += PANEL_ROWS, next += lines * WINOGRAD_LINE) {
            fetch(next, lines);
            self->panel->product(sums + (panel * share->rows + row) * TILES,
                                 share->left + row * share->step, right, share->depth, add);
        }
    }
}

static void multiply(const struct v2v_winograd *self, const struct chunk *chunk)
{
    int64_t in = self->spec.in, out8 = self->out8;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t point = 0; point < WINOGRAD_VALUES; point++) {
        const float *weights = v2v_piece_data(&self->weights) + point * weights_point(self);
        const float *input = chunk->input + point * v2v_rows_point(chunk->panels, self->in8);
        float *output = chunk->output + point * v2v_rows_point(chunk->panels, out8);
        for (int64_t i = 0; i < in; i += DEPTH) {
            int64_t depth = v2v_smaller(DEPTH, in - i);
            struct share share = {.left = weights + filters_at(self, 0, i),
                                  .right = input + i * TILES,
                                  .rows = out8,
                                  .step = depth,
                                  .channels = self->in8,
                                  .depth = depth};
            multiply_share(self, chunk, output, &share, i > 0);
        }
    }
}

/* Left operand of the data gradient: filters [out..][in] of a run of outputs, transposed to
 * [in/8][out][8]. */
static void pack_filters(const struct v2v_winograd *self, float *pack, const float *weights,
                         int64_t first, int64_t depth)
{
    int64_t in = self->spec.in;
    for (int64_t i = 0; i < in; i += PANEL_ROWS) {
        float *to = pack + i * depth;
        int64_t rows = v2v_smaller(PANEL_ROWS, in - i);
        for (int64_t o = 0; o < depth; o += PANEL_ROWS) {
            const float *from = weights + filters_at(self, first + o, i);
            float whole[PANEL_ROWS * PANEL_ROWS] = {0};
            if (rows < PANEL_ROWS) {
                memcpy(whole, from, (size_t)(rows * PANEL_ROWS) * sizeof *whole);
                from = whole;
            }
            self->panel->turn(to + o * PANEL_ROWS, PANEL_ROWS, from, PANEL_ROWS);
        }
    }
}

static void multiply_data(const struct v2v_winograd *self, const struct chunk *chunk)
{
    int64_t out = self->spec.out, in8 = self->in8;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t point = 0; point < WINOGRAD_VALUES; point++) {
        const float *weights = v2v_piece_data(&self->weights) + point * weights_point(self);
        const float *output = chunk->output + point * v2v_rows_point(chunk->panels, self->out8);
        float *input = chunk->dinput + point * v2v_rows_point(chunk->panels, in8);
        float *pack = thread_pack(self, chunk);
        for (int64_t o = 0; o < out; o += DEPTH) {
            struct share share = {.left = pack,
                                  .right = output + o * TILES,
                                  .rows = in8,
                                  .step = v2v_smaller(DEPTH, self->out8 - o),
                                  .channels = self->out8,
                                  .depth = v2v_smaller(DEPTH, out - o)};
            pack_filters(self, pack, weights, o, share.step);
            multiply_share(self, chunk, input, &share, o > 0);
        }
    }
}

/* Channels first .. first + 7 of tiles, transposed: [tile][step] from [panel][channels][32].
 */
static void turn_tiles(const struct v2v_winograd *self, float *to, int64_t step, const float *from,
                       int64_t channels, int64_t first, int64_t tile, int64_t count)
{
    for (int64_t t = 0; t < count; t += PANEL_ROWS) {
        int64_t panel = (tile + t) / TILES, lane = (tile + t) % TILES;
        self->panel->turn(to + t * step, step, from + (panel * channels + first) * TILES + lane,
                          TILES);
    }
}

/* Right operand of the weights' gradient: 32 outputs of a run of tiles, [tile][32]. */
static void pack_outputs(const struct v2v_winograd *self, float *pack, const float *output,
                         int64_t first, int64_t tile, int64_t count)
{
    int64_t end = v2v_smaller(self->out8, first + TILES);
    for (int64_t o = first; o < end; o += PANEL_ROWS) {
        turn_tiles(self, pack + o - first, TILES, output, self->out8, o, tile, count);
    }
}

/* gradient[point][out/32][in8][32] (+)= sum over the chunk's tiles. A panel of outputs stays in the
 * first-level cache while all inputs pass. Every product asks for its part of the next run's
 * operands, which lie behind this one's. */
static void multiply_weights(const struct v2v_winograd *self, const struct chunk *chunk, int add)
{
    int64_t in8 = self->in8, tiles = chunk->panels * TILES;
    int64_t products = self->out32 / TILES * (in8 / PANEL_ROWS);
    int64_t in_lines = lines_each(DEPTH * in8, products);
    int64_t out_lines = lines_each(DEPTH * self->out8, products);
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t point = 0; point < WINOGRAD_VALUES; point++) {
        const float *input = chunk->input + point * v2v_rows_point(chunk->panels, in8);
        const float *output = chunk->output + point * v2v_rows_point(chunk->panels, self->out8);
        float *gradient = chunk->gradient + point * gradient_point(self);
        float *left = thread_pack(self, chunk), *right = left + DEPTH * in8;
        for (int64_t t = 0; t < tiles; t += DEPTH) {
            int64_t depth = v2v_smaller(DEPTH, tiles - t);
            const float *next_in = input + (t + depth) * in8;
            const float *next_out = output + (t + depth) * self->out8;
            for (int64_t i = 0; i < in8; i += PANEL_ROWS) {
                turn_tiles(self, left + i * depth, PANEL_ROWS, input, in8, i, t, depth);
            }
            for (int64_t o = 0; o < self->out32; o += TILES) {
                pack_outputs(self, right, output, o, t, depth);
                for (int64_t i = 0; i < in8; i += PANEL_ROWS) {
                    fetch(next_in, in_lines);
                    fetch(next_out, out_lines);
                    next_in += in_lines * WINOGRAD_LINE;
                    next_out += out_lines * WINOGRAD_LINE;
                    self->panel->product(gradient + o * in8 + i * TILES, left + i * depth, right,
                                         depth, add || t > 0);
                }
            }
        }
    }
}

/* Tiles that fill up the last panel take part in no sum. */
static void clear_tail(const struct v2v_winograd *self, const struct chunk *chunk, float *values,
                       int64_t channels)
{
    int64_t used = chunk->rows.tiles % TILES, rows = WINOGRAD_VALUES * channels;
    if (used == 0) {
        return;
    }
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t row = 0; row < rows; row++) {
        int64_t point = row / channels, channel = row % channels;
        float *last = values + point * v2v_rows_point(chunk->panels, channels) +
                      (chunk->panels - 1) * channels * TILES;
        memset(last + channel * TILES + used, 0, (size_t)(TILES - used) * sizeof *last);
    }
}

/* ---- the three computations ---- */

/* As many tiles at a time as fill all panels, unless they are kept: then whole rows. */
void v2v_winograd_forward_part(struct v2v_winograd *self, float *out, const float *base,
                               const struct v2v_winograd_part *part)
{
    int64_t most = self->kept != NULL ? self->chunk_tiles : self->panels * TILES;
    int64_t done = 0, begun = 0;
    V2V_ASSERT(part->in_list == NULL || !self->spec.half);
    V2V_ASSERT(part->out_list == NULL || !self->spec.stride2);
    self->is_kept = 0;
    while (done < part->runs) {
        struct chunk chunk = chunk_of(self, part->run + done, part->runs - done, begun, most);
        chunk.rows.shift = part->shift;
        chunk.rows.first_row = part->first_row;
        chunk.rows.in_list = part->in_list;
        chunk.rows.out_list = part->out_list;
        transform_input(self, &chunk, base);
        multiply(self, &chunk);
        transform_output(self, &chunk, out);
        done += chunk.rows.runs - (chunk.over > 0);
        begun = chunk.over > 0 ? part->run[done].count - chunk.over : 0;
    }
}

void v2v_winograd_forward(struct v2v_winograd *self, float *out, const float *base)
{
    struct v2v_winograd_part whole = {.run = self->tiles.run, .runs = self->tiles.rows};
    v2v_winograd_forward_part(self, out, base, &whole);
    self->is_kept = self->kept != NULL;
}

/* Inputs whose taps are written in one go. */
enum { GO = PANEL_ROWS };

/* [count][9 inputs]: the gradient of `inputs` filters of `count` outputs, a multiple of 8, from
 * input `i` on. */
static void turn_gradient(const struct v2v_winograd *self, float (*taps)[9 * GO],
                          const float *gradient, int64_t i, int64_t inputs, int64_t count)
{
    float apart[9 * GO * TILES];
    for (int64_t n = 0; n < inputs; n++) {
        self->kernel->weights_turned(apart + n * 9 * TILES, TILES, gradient + (i + n) * TILES,
                                     gradient_point(self), count);
    }
    for (int64_t row = 0; row < 9 * inputs; row += PANEL_ROWS) {
        for (int64_t o = 0; o < count; o += PANEL_ROWS) {
            self->panel->turn(taps[o] + row, 9 * GO, apart + row * TILES + o, TILES);
        }
    }
}

static void give_weights_gradient(const struct v2v_winograd *self, const struct v2v_gradients *to,
                                  const float *gradient)
{
    int64_t in = self->spec.in, out = self->spec.out;
#pragma omp parallel for schedule(static) num_threads(self->threads)
    for (int64_t first = 0; first < out; first += TILES) {
        int64_t count = v2v_smaller(TILES, out - first);
        int64_t filled = v2v_smaller(TILES, self->out8 - first);
        float taps[TILES][9 * GO];
        for (int64_t i = 0; i < in; i += GO) {
            int64_t inputs = v2v_smaller(GO, in - i);
            turn_gradient(self, taps, gradient + first * self->in8, i, inputs, filled);
            for (int64_t o = 0; o < count; o++) {
                float *row = to->dweight + ((first + o) * in + i) * 9;
                if (to->sets) {
                    memcpy(row, taps[o], (size_t)(9 * inputs) * sizeof *row);
                } else {
                    v2v_pixels_add(row, taps[o], 9 * inputs);
                }
            }
        }
    }
}

/* The gradient of the input comes last: it may take the place of the input's values. */
void v2v_winograd_backward(struct v2v_winograd *self, const struct v2v_gradients *to,
                           const float *base, const float *dout)
{
    float *gradient = NULL;
    int64_t rows;
    for (int64_t first = 0; first < self->tiles.rows; first += rows) {
        struct chunk chunk = chunk_at(self, first);
        rows = chunk.rows.runs;
        int which = (first == 0) * FIRST_CHUNK + (first + rows == self->tiles.rows) * LAST_CHUNK;
        transform_output_gradient(self, &chunk, to, dout, which);
        if (to->dweight != NULL) {
            if (!self->is_kept) {
                transform_input(self, &chunk, base);
            }
            clear_tail(self, &chunk, chunk.input, self->in8);
            clear_tail(self, &chunk, chunk.output, self->out8);
            multiply_weights(self, &chunk, first > 0);
            gradient = chunk.gradient;
        }
        if (to->din != NULL) {
            multiply_data(self, &chunk);
            add_input_gradient(self, &chunk, to, base, which);
        }
    }
    if (to->dweight != NULL) {
        give_weights_gradient(self, to, gradient);
    }
    self->is_kept = 0;
}
