#include "op/winograd_rows.h"

#include "op/panel_kernel.h"
#include "op/simd.h"

#include <omp.h>
#include <string.h>

enum { TILE = WINOGRAD_TILE, POINTS = WINOGRAD_POINTS };

/* A line is one image row with the pixels that its first and last tile read beyond it; phase j is
 * every tile's pixel j, phase[j][t] = line[t * tile + j]; points[i][j][t] are the lines of a row of
 * tiles behind the transform along x, i counting lines. */
struct scratch {
    float *line;
    float *phase;
    float *points;
    int64_t step; /* from phase to phase */
};

static int64_t phase_step(int64_t tiles_x)
{
    return (tiles_x + 1 + 15) / 16 * 16;
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

/* ---- lines and phases ---- */

/* One tile more than the row has: its first two pixels are the last tile's last ones. */
V2V_SIMD_CLONES
static void split(float *restrict phase, int64_t step, const float *restrict line, int64_t count)
{
    for (int64_t t = 0; t < count; t++) {
        for (int j = 0; j < TILE; j++) {
            phase[j * step + t] = line[t * TILE + j];
        }
    }
}

V2V_SIMD_CLONES
static void join(float *restrict line, const float *restrict phase, int64_t step, int64_t count)
{
    for (int64_t t = 0; t < count; t++) {
        for (int j = 0; j < TILE; j++) {
            line[t * TILE + j] = phase[j * step + t];
        }
    }
}

static int64_t within(int64_t x, int64_t low, int64_t high)
{
    x = x > low ? x : low;
    return x < high ? x : high;
}

/* Image row y of a plane behind one pixel to the left: line[x + 1], zero where the plane ends. */
static void load_line(const struct rows *rows, float *line, const float *base,
                      const struct v2v_plane *plane, int64_t y)
{
    int64_t length = (rows->tiles_x + 1) * TILE;
    if (y < plane->y0 || y >= plane->y1) {
        memset(line, 0, (size_t)length * sizeof *line);
        return;
    }
    int64_t x0 = within(plane->x0, -1, length - 1), x1 = within(plane->x1, x0, length - 1);
    const float *from = base + plane->offset + rows->shift + (y >> rows->half) * rows->pitch;
    memset(line, 0, (size_t)(x0 + 1) * sizeof *line);
    if (rows->half) {
        for (int64_t x = x0; x < x1; x++) {
            line[x + 1] = from[x >> 1];
        }
    } else {
        memcpy(line + x0 + 1, from + x0, (size_t)(x1 - x0) * sizeof *line);
    }
    memset(line + x1 + 1, 0, (size_t)(length - 1 - x1) * sizeof *line);
}

/* Adjoint of load_line. */
static void add_line(const struct rows *rows, float *base, const struct v2v_plane *plane, int64_t y,
                     const float *line)
{
    int64_t length = rows->tiles_x * TILE + 2;
    if (y < plane->y0 || y >= plane->y1) {
        return;
    }
    int64_t x0 = within(plane->x0, -1, length - 1), x1 = within(plane->x1, x0, length - 1);
    float *to = base + plane->offset + (y >> rows->half) * rows->pitch;
    if (rows->half) {
        for (int64_t x = x0; x < x1; x++) {
            to[x >> 1] += line[x + 1];
        }
    } else {
        for (int64_t x = x0; x < x1; x++) {
            to[x] += line[x + 1];
        }
    }
}

/* ---- along y: between the lines of a row of tiles and the panels ---- */

struct run {
    int64_t offset; /* of the first tile's value */
    int64_t tile;   /* in the row */
    int64_t count;
};

/* The row's tiles from `tile` on that lie in one panel. */
static struct run run_at(const struct rows *rows, int64_t row, int64_t tile, int64_t channels)
{
    int64_t index = row * rows->tiles_x + tile, lane = index % PANEL_COLUMNS;
    return (struct run){.offset = index / PANEL_COLUMNS * channels * PANEL_COLUMNS + lane,
                        .tile = tile,
                        .count = within(PANEL_COLUMNS - lane, 0, rows->tiles_x - tile)};
}

static void lines_to_values(const struct rows *rows, winograd_axis *axis, float *values,
                            int64_t channels, const struct scratch *scratch, int64_t row)
{
    int64_t point = v2v_rows_point(rows->panels, channels);
    struct run run;
    for (int64_t tile = 0; tile < rows->tiles_x; tile += run.count) {
        run = run_at(rows, row, tile, channels);
        for (int64_t j = 0; j < POINTS; j++) {
            axis(values + run.offset + j * point, POINTS * point,
                 scratch->points + j * scratch->step + tile, POINTS * scratch->step, run.count);
        }
    }
}

static void values_to_lines(const struct rows *rows, winograd_axis *axis,
                            const struct scratch *scratch, const float *values, int64_t channels,
                            int64_t row)
{
    int64_t point = v2v_rows_point(rows->panels, channels);
    struct run run;
    for (int64_t tile = 0; tile < rows->tiles_x; tile += run.count) {
        run = run_at(rows, row, tile, channels);
        for (int64_t j = 0; j < POINTS; j++) {
            axis(scratch->points + j * scratch->step + tile, POINTS * scratch->step,
                 values + run.offset + j * point, POINTS * point, run.count);
        }
    }
}

/* ---- the four transforms of a channel ---- */

static float *line_points(const struct scratch *scratch, int64_t i)
{
    return scratch->points + i * POINTS * scratch->step;
}

static void input_line(const struct rows *rows, const struct scratch *scratch, int64_t i,
                       const float *base, const struct v2v_plane *plane, int64_t y)
{
    int64_t step = scratch->step;
    load_line(rows, scratch->line, base, plane, y);
    split(scratch->phase, step, scratch->line, rows->tiles_x + 1);
    for (int64_t j = 0; j < 2; j++) {
        memcpy(scratch->phase + (TILE + j) * step, scratch->phase + j * step + 1,
               (size_t)rows->tiles_x * sizeof *scratch->phase);
    }
    rows->kernel->input(line_points(scratch, i), step, scratch->phase, step, rows->tiles_x);
}

void v2v_rows_input(const struct rows *rows, float *values, int64_t channels, const float *base,
                    const struct v2v_plane *plane)
{
    struct scratch scratch = thread_scratch(rows);
    for (int64_t row = 0; row < rows->count; row++) {
        int64_t y = (rows->first + row) * TILE - 1, known = row > 0 ? 2 : 0;
        memcpy(scratch.points, line_points(&scratch, TILE),
               (size_t)(known * POINTS * scratch.step) * sizeof *scratch.points);
        for (int64_t i = known; i < POINTS; i++) {
            input_line(rows, &scratch, i, base, plane, y + i);
        }
        lines_to_values(rows, rows->kernel->input, values, channels, &scratch, row);
    }
}

void v2v_rows_input_turned(const struct rows *rows, float *base, const struct v2v_plane *plane,
                           const float *values, int64_t channels)
{
    struct scratch scratch = thread_scratch(rows);
    int64_t step = scratch.step;
    for (int64_t row = 0; row < rows->count; row++) {
        values_to_lines(rows, rows->kernel->input_turned, &scratch, values, channels, row);
        for (int64_t i = 0; i < POINTS; i++) {
            rows->kernel->input_turned(scratch.phase, step, line_points(&scratch, i), step,
                                       rows->tiles_x);
            join(scratch.line, scratch.phase, step, rows->tiles_x);
            float *next = scratch.line + TILE;
            next[(rows->tiles_x - 1) * TILE] = next[(rows->tiles_x - 1) * TILE + 1] = 0.0f;
            for (int64_t j = 0; j < 2; j++) {
                for (int64_t t = 0; t < rows->tiles_x; t++) {
                    next[t * TILE + j] += scratch.phase[(TILE + j) * step + t];
                }
            }
            add_line(rows, base, plane, (rows->first + row) * TILE - 1 + i, scratch.line);
        }
    }
}

V2V_SIMD_CLONES
static void finish_line(float *restrict to, const float *restrict line, int64_t count, float bias,
                        float slope)
{
    for (int64_t x = 0; x < count; x++) {
        float value = line[x] + bias;
        to[x] = value > 0.0f ? value : slope * value;
    }
}

void v2v_rows_output(const struct rows *rows, float *image, const float *values, int64_t channels,
                     float bias, float slope)
{
    struct scratch scratch = thread_scratch(rows);
    for (int64_t row = 0; row < rows->count; row++) {
        int64_t y = (rows->first + row) * TILE, count = within(TILE, 0, rows->height - y);
        values_to_lines(rows, rows->kernel->output, &scratch, values, channels, row);
        for (int64_t i = 0; i < count; i++) {
            rows->kernel->output(scratch.phase, scratch.step, line_points(&scratch, i),
                                 scratch.step, rows->tiles_x);
            join(scratch.line, scratch.phase, scratch.step, rows->tiles_x);
            finish_line(image + (y + i - rows->out_first) * rows->width, scratch.line, rows->width,
                        bias, slope);
        }
    }
}

void v2v_rows_output_turned(const struct rows *rows, float *values, int64_t channels,
                            const float *image)
{
    struct scratch scratch = thread_scratch(rows);
    int64_t length = rows->tiles_x * TILE;
    for (int64_t row = 0; row < rows->count; row++) {
        int64_t y = (rows->first + row) * TILE;
        for (int64_t i = 0; i < TILE; i++) {
            int64_t count = y + i < rows->height ? rows->width : 0;
            memcpy(scratch.line, image + (y + i) * rows->width,
                   (size_t)count * sizeof *scratch.line);
            memset(scratch.line + count, 0, (size_t)(length - count) * sizeof *scratch.line);
            split(scratch.phase, scratch.step, scratch.line, rows->tiles_x);
            rows->kernel->output_turned(line_points(&scratch, i), scratch.step, scratch.phase,
                                        scratch.step, rows->tiles_x);
        }
        lines_to_values(rows, rows->kernel->output_turned, values, channels, &scratch, row);
    }
}
