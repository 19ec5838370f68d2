#include "op/winograd_rows.h"

#include "op/panel_kernel.h"
#include "op/pixels.h"
#include "v2v3d/base/bounds.h"

#include <omp.h>
#include <string.h>

enum { TILE = WINOGRAD_TILE, POINTS = WINOGRAD_POINTS, BATCH = 2 * PANEL_COLUMNS };

/* Tiles that are copied one by one. */
enum { FEW_TILES = 8 };

/* A batch is tiles that go through the transforms together. A line is one image row of every run,
 * from one pixel to the left of it on; phase j is every tile's pixel j, phase[j][t] = line[t * tile
 * + j], the last two phases being the next tile's first ones; points[i][j][t] are the lines of the
 * tiles behind the transform along x, i counting lines. */
struct scratch {
    float *line;
    float *phase;
    float *points;
    int64_t step; /* from phase to phase */
};

static int64_t phase_step(int64_t tiles_x)
{
    int64_t most = tiles_x > BATCH ? tiles_x : BATCH;
    return (most + 1 + 15) / 16 * 16;
}

int64_t v2v_rows_point(int64_t panels, int64_t channels)
{
    return panels * channels * PANEL_COLUMNS + 16;
}

int64_t v2v_rows_floats(int64_t tiles_x)
{
    return phase_step(tiles_x) * (2 * POINTS + POINTS * POINTS);
}

static struct scratch thread_scratch(const struct rows *rows)
{
    struct scratch scratch = {.line = rows->lines + omp_get_thread_num() * rows->line_floats,
                              .step = phase_step(rows->tiles_x)};
    scratch.phase = scratch.line + scratch.step * POINTS;
    scratch.points = scratch.phase + scratch.step * POINTS;
    return scratch;
}

/* A whole row, where rows fill panels or must not mix; else as many tiles as fill two panels, the
 * last run being cut there. */
struct batch {
    const struct v2v_tile_run *run;
    int64_t runs, tiles;
    int64_t begun; /* tiles of the first run that belong to the batch before */
    int64_t place; /* of the first tile among the values */
};

/* A batch's runs, cut: the next one while `tiles` of the batch remain. */
static struct v2v_tile_run cut_run(const struct batch *batch, int64_t r, int64_t tiles)
{
    struct v2v_tile_run run = batch->run[r];
    if (r == 0) {
        run.first += batch->begun;
        run.count -= batch->begun;
    }
    run.count = v2v_within(run.count, 0, tiles);
    return run;
}

static int stays_alone(const struct rows *rows, const struct v2v_tile_run *run)
{
    return run->count == rows->tiles_x && (rows->in_order || rows->tiles_x % PANEL_COLUMNS == 0);
}

/* Written in place: a copy would be read before the values' scattered stores are through. */
static void set_batch(struct batch *batch, const struct rows *rows, const struct v2v_tile_run *run,
                      int64_t begun, int64_t place)
{
    int64_t left = rows->tiles - place, most = v2v_smaller(BATCH - place % BATCH, left);
    batch->run = run;
    batch->begun = begun;
    batch->place = place;
    if (left >= rows->tiles_x && begun == 0 && stays_alone(rows, run)) {
        batch->runs = 1;
        batch->tiles = run->count;
        return;
    }
    batch->runs = batch->tiles = 0;
    while (batch->tiles < most) {
        batch->tiles += cut_run(batch, batch->runs, most - batch->tiles).count;
        batch->runs++;
    }
}

static void set_first_batch(struct batch *batch, const struct rows *rows)
{
    set_batch(batch, rows, rows->run, rows->begun, 0);
}

/* The tiles behind those of `batch`; none: an empty one. `next` may be `batch`. */
static void set_next_batch(struct batch *next, const struct rows *rows, const struct batch *batch)
{
    int64_t last = batch->runs - 1, before = 0;
    for (int64_t r = 0; r < last; r++) {
        before += cut_run(batch, r, batch->tiles).count;
    }
    int64_t done = batch->tiles - before + (last == 0 ? batch->begun : 0);
    int whole = done == batch->run[last].count;
    set_batch(next, rows, batch->run + last + whole, whole ? 0 : done, batch->place + batch->tiles);
}

/* ---- lines and phases ---- */

/* Tiles' pixels, and two more with `beyond`: short copies of fixed sizes are instructions. */
static void copy_tiles(float *to, const float *from, int64_t tiles, int beyond)
{
    if (tiles > FEW_TILES) {
        memcpy(to, from, (size_t)(tiles * TILE) * sizeof *to);
    }
    for (int64_t t = 0; t < tiles && tiles <= FEW_TILES; t++) {
        memcpy(to + t * TILE, from + t * TILE, TILE * sizeof *to);
    }
    if (beyond) {
        memcpy(to + tiles * TILE, from + tiles * TILE, 2 * sizeof *to);
    }
}

/* Pixels [start, start + length) of an image row, zero where the plane ends. */
static void load_pixels(const struct rows *rows, float *line, int64_t start, int64_t length,
                        const float *row, const struct v2v_plane *plane)
{
    int64_t x0 = v2v_within(plane->x0, start, start + length);
    int64_t x1 = v2v_within(plane->x1, x0, start + length);
    memset(line, 0, (size_t)(x0 - start) * sizeof *line);
    if (rows->half) {
        v2v_pixels_repeat(line + x0 - start, row, x0, x1);
    } else {
        memcpy(line + x0 - start, row + x0, (size_t)(x1 - x0) * sizeof *line);
    }
    memset(line + x1 - start, 0, (size_t)(start + length - x1) * sizeof *line);
}

/* Where a run of a batch lies in a plane: pixels [start, start + 4 * tiles + 2) of six rows. */
struct piece {
    struct v2v_tile_run run; /* cut */
    int64_t row, start;
    int inside; /* the plane */
};

/* What a batch reads of a plane. */
struct reading {
    struct batch batch;
    const float *pixels; /* of the plane */
    const struct v2v_plane *plane;
    struct piece piece[BATCH];
};

/* Of the batch that is in `reading` already. */
static void read_from(struct reading *reading, const struct rows *rows, const float *base,
                      const struct v2v_plane *planes, int64_t channel)
{
    const struct batch *batch = &reading->batch;
    const struct v2v_plane *plane = &planes[channel];
    int64_t tile = 0;
    reading->pixels = base + plane->offset + rows->shift;
    reading->plane = plane;
    for (int64_t r = 0; r < batch->runs; r++) {
        struct v2v_tile_run run = cut_run(batch, r, batch->tiles - tile);
        int64_t y = run.row * TILE - 1, x = run.first * TILE - 1;
        reading->piece[r] =
            (struct piece){.run = run,
                           .row = y,
                           .start = x,
                           .inside = y >= plane->y0 && y + POINTS <= plane->y1 && x >= plane->x0 &&
                                     x + run.count * TILE + 2 <= plane->x1};
        tile += run.count;
    }
}

static const float *piece_row(const struct rows *rows, const struct reading *reading,
                              const struct piece *piece, int64_t i)
{
    return reading->pixels + ((piece->row + i) >> rows->half) * rows->pitch;
}

/* Line i of a piece: 4 * tiles + 2 pixels. */
static void load_piece(const struct rows *rows, float *line, const struct reading *reading,
                       const struct piece *piece, int64_t i)
{
    const float *row = piece_row(rows, reading, piece, i);
    int64_t y = piece->row + i, length = piece->run.count * TILE + 2;
    if (rows->in_list != NULL) {
        v2v_tiles_line(line, rows->in_list, reading->pixels, &piece->run, i);
    } else if (piece->inside && rows->half) {
        v2v_pixels_repeat(line, row, piece->start, piece->start + length);
    } else if (piece->inside) {
        copy_tiles(line, row + piece->start, piece->run.count, 1);
    } else if (y < reading->plane->y0 || y >= reading->plane->y1) {
        memset(line, 0, (size_t)length * sizeof *line);
    } else {
        load_pixels(rows, line, piece->start, length, row, reading->plane);
    }
}

/* Line i of a batch, split into its phases. */
static void load_phases(const struct rows *rows, const struct scratch *scratch,
                        const struct reading *reading, int64_t i)
{
    const struct batch *batch = &reading->batch;
    float *line = scratch->line, *phase = scratch->phase;
    int64_t step = scratch->step;
    float beyond[BATCH][2];
    for (int64_t r = 0; r < batch->runs; r++) {
        const struct piece *piece = &reading->piece[r];
        load_piece(rows, line, reading, piece, i);
        line += piece->run.count * TILE;
        memcpy(beyond[r], line, sizeof beyond[r]);
    }
    v2v_pixels_split(phase, step, scratch->line, batch->tiles);
    for (int64_t j = 0; j < 2; j++) {
        memcpy(phase + (TILE + j) * step, phase + j * step + 1,
               (size_t)batch->tiles * sizeof *phase);
    }
    for (int64_t r = 0, last = -1; r < batch->runs; r++) {
        last += reading->piece[r].run.count;
        phase[TILE * step + last] = beyond[r][0];
        phase[(TILE + 1) * step + last] = beyond[r][1];
    }
}

/* Ask memory for line i of a batch whose turn comes next: the hardware foresees neither parts of
 * rows here and there nor where a page or a channel ends. Inline, or the compiler would take it for
 * a function without effect. */
static inline __attribute__((always_inline)) void
fetch_line(const struct rows *rows, const struct reading *reading, int64_t i)
{
    if (rows->in_list != NULL) {
        return; /* one stream, which the hardware foresees */
    }
    for (int64_t r = 0; r < reading->batch.runs; r++) {
        const struct piece *piece = &reading->piece[r];
        const struct v2v_plane *plane = reading->plane;
        int64_t end = v2v_smaller(piece->start + piece->run.count * TILE + 2, plane->x1);
        int64_t start = piece->start > plane->x0 ? piece->start : plane->x0;
        if (piece->row + i < plane->y0 || piece->row + i >= plane->y1 || start >= end) {
            continue;
        }
        const float *row = piece_row(rows, reading, piece, i);
        int64_t last = (end - 1) >> rows->half;
        for (int64_t x = start >> rows->half; x < last; x += WINOGRAD_LINE) {
            __builtin_prefetch(row + x);
        }
        __builtin_prefetch(row + last);
    }
}

/* Adjoint of load_pixels for one run. */
static void add_line(const struct rows *rows, float *base, const struct v2v_plane *plane, int64_t y,
                     const struct v2v_tile_run *run, const float *line)
{
    int64_t length = run->count * TILE + 2, start = run->first * TILE - 1;
    if (y < plane->y0 || y >= plane->y1) {
        return;
    }
    int64_t x0 = v2v_within(plane->x0, start, start + length);
    int64_t x1 = v2v_within(plane->x1, x0, start + length);
    float *to = base + plane->offset + (y >> rows->half) * rows->pitch;
    if (rows->half) {
        v2v_pixels_repeat_turned(to, line + x0 - start, x0, x1);
    } else {
        v2v_pixels_add(to + x0, line + x0 - start, x1 - x0);
    }
}

/* ---- along y: between the lines of a batch and the panels ---- */

struct span {
    int64_t offset; /* of the first tile's value */
    int64_t count;
};

/* From tile `tile` of the batch on, those of one panel. */
static struct span span_at(const struct batch *batch, int64_t tile, int64_t channels)
{
    int64_t place = batch->place + tile, lane = place % PANEL_COLUMNS;
    return (struct span){.offset = place / PANEL_COLUMNS * channels * PANEL_COLUMNS + lane,
                         .count = v2v_within(PANEL_COLUMNS - lane, 0, batch->tiles - tile)};
}

static void lines_to_values(const struct rows *rows, winograd_axis *axis, float *values,
                            int64_t channels, const struct scratch *scratch,
                            const struct batch *batch)
{
    int64_t point = v2v_rows_point(rows->panels, channels);
    struct span span;
    for (int64_t tile = 0; tile < batch->tiles; tile += span.count) {
        span = span_at(batch, tile, channels);
        for (int64_t j = 0; j < POINTS; j++) {
            axis(values + span.offset + j * point, POINTS * point,
                 scratch->points + j * scratch->step + tile, POINTS * scratch->step, span.count);
        }
    }
}

/* Ask memory for the values of the next channel, which lie behind this one's: a thread takes back
 * one after the other. Inline, or the compiler would take it for a function without effect. */
static inline __attribute__((always_inline)) void fetch_values(const float *values, int64_t point,
                                                               int64_t count)
{
    for (int64_t j = 0; j < POINTS; j++) {
        for (int64_t t = 0; t < count; t += WINOGRAD_LINE) {
            __builtin_prefetch(values + j * POINTS * point + PANEL_COLUMNS + t, 0, 2);
        }
    }
}

static void values_to_lines(const struct rows *rows, winograd_axis *axis,
                            const struct scratch *scratch, const float *values, int64_t channels,
                            const struct batch *batch)
{
    int64_t point = v2v_rows_point(rows->panels, channels);
    struct span span;
    for (int64_t tile = 0; tile < batch->tiles; tile += span.count) {
        span = span_at(batch, tile, channels);
        for (int64_t j = 0; j < POINTS; j++) {
            const float *from = values + span.offset + j * point;
            fetch_values(from, point, span.count);
            axis(scratch->points + j * scratch->step + tile, POINTS * scratch->step, from,
                 POINTS * point, span.count);
        }
    }
}

/* ---- the four transforms of a channel ---- */

static float *line_points(const struct scratch *scratch, int64_t i)
{
    return scratch->points + i * POINTS * scratch->step;
}

static int is_whole(const struct rows *rows, const struct batch *batch)
{
    return batch->runs == 1 && batch->begun == 0 && batch->tiles == rows->tiles_x;
}

/* Does a whole row lie right under `above`, a whole one (NULL: none)? Two of its lines are known.
 */
static int is_under(const struct rows *rows, const struct batch *batch,
                    const struct v2v_tile_run *above)
{
    return above != NULL && is_whole(rows, batch) && batch->run->row == above->row + 1;
}

void v2v_rows_input(const struct rows *rows, float *values, int64_t channels, const float *base,
                    const struct v2v_plane *plane, int64_t channel, int64_t following)
{
    struct scratch scratch = thread_scratch(rows);
    struct reading reading[2], *now = &reading[0], *next = &reading[1], *swap;
    const struct v2v_tile_run *above = NULL;
    int64_t step = scratch.step, left = rows->runs;
    set_first_batch(&now->batch, rows);
    read_from(now, rows, base, plane, channel);
    while (left > 0) {
        int64_t known = is_under(rows, &now->batch, above) ? 2 : 0;
        set_next_batch(&next->batch, rows, &now->batch);
        left = next->batch.runs;
        if (left == 0) {
            set_first_batch(&next->batch, rows);
        }
        read_from(next, rows, base, plane, left > 0 ? channel : following);
        memcpy(scratch.points, line_points(&scratch, TILE),
               (size_t)(known * POINTS * step) * sizeof *scratch.points);
        for (int64_t i = known; i < POINTS; i++) {
            fetch_line(rows, next, i);
            load_phases(rows, &scratch, now, i);
            rows->kernel->input(line_points(&scratch, i), step, scratch.phase, step,
                                now->batch.tiles);
        }
        lines_to_values(rows, rows->kernel->input_past, values, channels, &scratch, &now->batch);
        above = is_whole(rows, &now->batch) ? now->batch.run : NULL;
        swap = now;
        now = next;
        next = swap;
    }
}

/* Line i of every run, whose tiles' phases are in the scratch: added to the plane. */
static void add_phases(const struct rows *rows, const struct scratch *scratch,
                       const struct batch *batch, int64_t i, float *base,
                       const struct v2v_plane *plane)
{
    int64_t step = scratch->step, tile = 0;
    for (int64_t r = 0; r < batch->runs; r++) {
        struct v2v_tile_run run = cut_run(batch, r, batch->tiles - tile);
        float *phase = scratch->phase + tile, *beyond = scratch->line + run.count * TILE;
        for (int64_t j = 0; j < 2; j++) { /* the next tile's first pixels */
            const float *last = phase + (TILE + j) * step;
            v2v_pixels_add(phase + j * step + 1, last, run.count - 1);
            beyond[j] = last[run.count - 1];
        }
        v2v_pixels_join(scratch->line, phase, step, run.count);
        add_line(rows, base, plane, run.row * TILE - 1 + i, &run, scratch->line);
        tile += run.count;
    }
}

void v2v_rows_input_turned(const struct rows *rows, float *base, const struct v2v_plane *plane,
                           const float *values, int64_t channels)
{
    struct scratch scratch = thread_scratch(rows);
    struct batch batch;
    int64_t step = scratch.step;
    for (set_first_batch(&batch, rows); batch.runs > 0; set_next_batch(&batch, rows, &batch)) {
        values_to_lines(rows, rows->kernel->input_turned, &scratch, values, channels, &batch);
        for (int64_t i = 0; i < POINTS; i++) {
            rows->kernel->input_turned(scratch.phase, step, line_points(&scratch, i), step,
                                       batch.tiles);
            add_phases(rows, &scratch, &batch, i, base, plane);
        }
    }
}

/* Where a run of a batch lies in the output image: pixels [at, at + count) of each of its lines. */
struct spot {
    int64_t at, count;
    int64_t lines; /* that the image has, of the four */
    int64_t tiles;
};

static void find_spots(const struct rows *rows, const struct batch *batch, struct spot *spot)
{
    int64_t half = rows->stride2, tile = 0;
    for (int64_t r = 0; r < batch->runs; r++) {
        struct v2v_tile_run run = cut_run(batch, r, batch->tiles - tile);
        int64_t y = run.row * TILE, x = run.first * TILE;
        int64_t count = v2v_within(run.count * TILE, 0, rows->width - x);
        spot[r] = (struct spot){.at = ((y - rows->first_row * TILE) >> half) * rows->out_width +
                                      (x >> half),
                                .count = (count + half) >> half,
                                .lines = v2v_within(rows->height - y, 0, TILE),
                                .tiles = run.count};
        tile += run.count;
    }
}

/* Ask memory for a batch's lines, as fetch_line. Inline, or the compiler would take it for a
 * function without effect. */
static inline __attribute__((always_inline)) void fetch_spots(const struct rows *rows,
                                                              const struct batch *batch,
                                                              const struct spot *spot,
                                                              const float *image)
{
    for (int64_t r = 0; r < batch->runs; r++) {
        for (int64_t i = 0; i < spot[r].lines; i += 1 + rows->stride2) {
            const float *row = image + spot[r].at + (i >> rows->stride2) * rows->out_width;
            for (int64_t x = 0; x < spot[r].count - 1; x += WINOGRAD_LINE) {
                __builtin_prefetch(row + x, 1);
            }
            __builtin_prefetch(row + spot[r].count - 1, 1);
        }
    }
}

/* Line i of a batch, lying in the scratch, to the list, where the batch's tiles follow each other.
 */
static void list_line(const struct rows *rows, const struct scratch *scratch,
                      const struct batch *batch, int64_t i, float *channel)
{
    const struct v2v_tiles *list = rows->out_list;
    struct v2v_tile_run run = cut_run(batch, 0, batch->tiles);
    int64_t number = list->number[run.row * list->columns + run.first];
    float *to = channel + (number - list->before[rows->first_row]) * TILE * TILE + i * TILE;
    for (int64_t t = 0; t < batch->tiles; t++) {
        memcpy(to + t * TILE * TILE, scratch->line + t * TILE, TILE * sizeof *to);
    }
}

/* Line i of every run, lying in the scratch, to the image. */
static void store_line(const struct rows *rows, const struct scratch *scratch,
                       const struct batch *batch, const struct spot *spot, int64_t i, float *image)
{
    const float *line = scratch->line;
    float *row = image + (i >> rows->stride2) * rows->out_width;
    for (int64_t r = 0; r < batch->runs; r++) {
        int64_t pixels = spot[r].tiles * TILE >> rows->stride2;
        if (i < spot[r].lines && !rows->stride2 && spot[r].count == pixels) {
            copy_tiles(row + spot[r].at, line, spot[r].tiles, 0);
        } else if (i < spot[r].lines) {
            memcpy(row + spot[r].at, line, (size_t)spot[r].count * sizeof *line);
        }
        line += pixels;
    }
}

void v2v_rows_output(const struct rows *rows, float *image, const float *values, int64_t channels,
                     float bias, float slope)
{
    struct scratch scratch = thread_scratch(rows);
    struct batch batch;
    struct spot spot[BATCH];
    for (set_first_batch(&batch, rows); batch.runs > 0; set_next_batch(&batch, rows, &batch)) {
        int64_t pixels = batch.tiles * TILE;
        if (rows->out_list == NULL) {
            find_spots(rows, &batch, spot);
            fetch_spots(rows, &batch, spot, image);
        }
        values_to_lines(rows, rows->kernel->output, &scratch, values, channels, &batch);
        for (int64_t i = 0; i < TILE; i += 1 + rows->stride2) {
            rows->kernel->output(scratch.phase, scratch.step, line_points(&scratch, i),
                                 scratch.step, batch.tiles);
            v2v_pixels_join(scratch.line, scratch.phase, scratch.step, batch.tiles);
            if (rows->stride2) {
                v2v_pixels_drop_odd(scratch.line, pixels);
            }
            v2v_pixels_activate(scratch.line, pixels >> rows->stride2, bias, slope);
            if (rows->out_list != NULL) {
                list_line(rows, &scratch, &batch, i, image);
            } else {
                store_line(rows, &scratch, &batch, spot, i, image);
            }
        }
    }
}

/* Line i of every run, from the image to the scratch; zero where the image has none. */
static void load_line(const struct rows *rows, const struct scratch *scratch,
                      const struct batch *batch, int64_t i, const float *image)
{
    int64_t half = rows->stride2, tile = 0;
    float *line = scratch->line;
    for (int64_t r = 0; r < batch->runs; r++) {
        struct v2v_tile_run run = cut_run(batch, r, batch->tiles - tile);
        int64_t y = run.row * TILE + i, x = run.first * TILE, length = run.count * TILE;
        int64_t count = y < rows->height ? v2v_within(length, 0, rows->width - x) : 0;
        const float *row = image + (y >> half) * rows->out_width + (x >> half);
        if (half && y % 2 == 0) {
            v2v_pixels_spread(line, row, (count + 1) / 2);
        } else if (half) {
            count = 0;
        } else {
            memcpy(line, row, (size_t)count * sizeof *line);
        }
        memset(line + count, 0, (size_t)(length - count) * sizeof *line);
        line += length;
        tile += run.count;
    }
}

void v2v_rows_output_turned(const struct rows *rows, float *values, int64_t channels,
                            const float *image)
{
    struct scratch scratch = thread_scratch(rows);
    struct batch batch;
    for (set_first_batch(&batch, rows); batch.runs > 0; set_next_batch(&batch, rows, &batch)) {
        for (int64_t i = 0; i < TILE; i++) {
            load_line(rows, &scratch, &batch, i, image);
            v2v_pixels_split(scratch.phase, scratch.step, scratch.line, batch.tiles);
            rows->kernel->output_turned(line_points(&scratch, i), scratch.step, scratch.phase,
                                        scratch.step, batch.tiles);
        }
        lines_to_values(rows, rows->kernel->output_turned_past, values, channels, &scratch, &batch);
    }
}
