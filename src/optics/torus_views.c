#include "optics/torus_views.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/saturation.h"

#include <math.h>
#include <string.h>

/* Times that weights go by the light of the moment. */
enum { FREELY = 8 };

int64_t v2v_torus_views_samples(const struct v2v_torus_views *views)
{
    return v2v_mem_product(views->views, views->torus.rows.count, views->torus.width);
}

enum v2v_status v2v_torus_views_init(struct v2v_torus_views *views, int64_t count, int64_t height,
                                     int64_t width, const struct v2v_torus *torus)
{
    enum v2v_status rc = V2V_OK;
    *views =
        (struct v2v_torus_views){.views = count, .height = height, .width = width, .torus = *torus};
    V2V_TRY(V2V_ALLOC(views->recorded, "data_step.views", v2v_torus_views_samples(views)));
    V2V_TRY(V2V_ALLOC(views->missed, "data_step.views", v2v_torus_views_samples(views)));
    V2V_TRY(V2V_ALLOC(views->highest, "data_step.views", count));
done:
    return rc;
}

void v2v_torus_views_fini(struct v2v_torus_views *views)
{
    struct v2v_view_weights *weights = &views->weights;
    v2v_mem_free(views->recorded);
    v2v_mem_free(views->missed);
    v2v_mem_free(views->highest);
    v2v_mem_free(views->around);
    v2v_mem_free(weights->kept);
    v2v_mem_free(weights->light);
    v2v_mem_free(weights->split);
    *views = (struct v2v_torus_views){0};
}

/* Beyond the frame, from its last pixel to its first in a straight line. */
static void bridge(float *line, int64_t size, int64_t whole)
{
    const float last = line[size - 1], first = line[0];
    for (int64_t i = size; i < whole; i++) {
        const float part = (float)(i - size + 1) / (float)(whole - size + 1);
        line[i] = last + part * (first - last);
    }
}

/* A sample of a frame; of a blind one, which follows the volume soon, the mean of the other views
 * there. */
static float first_guess(const struct v2v_torus_views *views, const float *frame, int64_t v,
                         int64_t pixel)
{
    const int64_t pixels = views->height * views->width;
    const float here = frame[v * pixels + pixel];
    double sum = 0.0, seen = 0.0;
    if (here != V2V_BLIND) {
        return here;
    }
    for (int64_t o = 0; o < views->views; o++) {
        const float other = frame[o * pixels + pixel];
        sum += other != V2V_BLIND ? (double)other : 0.0;
        seen += other != V2V_BLIND;
    }
    return seen > 0.0 ? (float)(sum / seen) : 0.0f;
}

/* Row y of view v on the torus. */
static void torus_row(const struct v2v_torus_views *views, float *row, const float *frame,
                      double scale, int64_t v, int64_t y)
{
    const int64_t height = views->height, width = views->width;
    const int64_t above = v2v_smaller(y, height - 1);
    const double part = (double)(y - above) / (double)(views->torus.height - height + 1);
    for (int64_t x = 0; x < width; x++) {
        const float last = first_guess(views, frame, v, above * width + x);
        const float first = part > 0.0 ? first_guess(views, frame, v, x) : last;
        row[x] = (float)(scale * (last + part * (first - last)));
    }
    bridge(row, width, views->torus.width);
}

/* @return bool: are there samples that aren't known? */
static int find_unknown(struct v2v_torus_views *views, const float *frame)
{
    const int64_t pixels = views->height * views->width;
    int64_t unknown = 0;
#pragma omp parallel for schedule(static) reduction(+ : unknown)
    for (int64_t v = 0; v < views->views; v++) {
        const float *view = frame + v * pixels;
        views->highest[v] = v2v_saturated_value(view, pixels);
        unknown += v2v_blind_count(view, pixels) + isfinite(views->highest[v]);
    }
    return unknown > 0;
}

void v2v_torus_views_take(struct v2v_torus_views *views, const float *frame, double scale)
{
    const struct v2v_torus *torus = &views->torus;
    views->frame = find_unknown(views, frame) ? frame : NULL;
    views->scale = (float)scale;
    views->weights.is_on = 0;
    views->known_rows = (struct v2v_part){0, views->height};
    views->known_columns = (struct v2v_part){0, views->width};
    if (views->around != NULL) {
        memset(views->around, 0, (size_t)v2v_torus_views_samples(views) * sizeof *views->around);
    }
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < views->views; v++) {
        for (int64_t y = 0; y < torus->rows.count; y++) {
            torus_row(views, views->recorded + (v * torus->rows.count + y) * torus->width, frame,
                      scale, v, torus->rows.first + y);
        }
    }
}

void v2v_torus_views_take_whole(struct v2v_torus_views *views, const float *samples)
{
    const struct v2v_torus *torus = &views->torus;
    views->frame = NULL;
    views->weights.is_on = 0;
    views->known_rows = (struct v2v_part){0, torus->height};
    views->known_columns = (struct v2v_part){0, torus->width};
    memcpy(views->recorded, samples, (size_t)v2v_torus_views_samples(views) * sizeof *samples);
}

/* Bounds without the light around are not kept: what is saturated is light then. */
static void take_highest(struct v2v_torus_views *views, const float *frame, const float *highest)
{
    for (int64_t v = 0; v < views->views; v++) {
        views->highest[v] = views->around != NULL ? highest[v] : INFINITY;
        views->frame = isfinite(views->highest[v]) ? frame : views->frame;
    }
}

void v2v_torus_views_surround(struct v2v_torus_views *views, const float *seen, const float *frame,
                              const float *highest)
{
    const int64_t samples = v2v_torus_views_samples(views);
    const float *inside = views->missed;
    take_highest(views, frame, highest);
    float *around = views->around != NULL ? views->around : views->missed;
    float *recorded = views->recorded;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        around[i] = seen[i] - inside[i];
        recorded[i] -= around[i];
    }
}

enum v2v_status v2v_torus_views_take_weights(struct v2v_torus_views *views)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_view_weights *weights = &views->weights;
    const int64_t samples = v2v_torus_views_samples(views);
    V2V_TRY(V2V_ALLOC(weights->kept, "data_step.weights", samples));
    V2V_TRY(V2V_ALLOC(weights->light, "data_step.weights", samples));
    V2V_TRY(V2V_ALLOC(weights->split, "data_step.weights", samples));
    V2V_TRY(V2V_ALLOC(views->around, "data_step.weights", samples));
done:
    return rc;
}

void v2v_torus_views_weigh(struct v2v_torus_views *views, double gain, double floor)
{
    struct v2v_view_weights *weights = &views->weights;
    const size_t bytes = (size_t)v2v_torus_views_samples(views) * sizeof(float);
    V2V_ASSERT(weights->kept != NULL && weights->split != NULL && gain >= 0.0 && floor > 0.0);
    weights->is_on = 1;
    weights->gain = (float)gain;
    weights->floor = (float)floor;
    weights->frames = NULL;
    weights->taken = 0;
    memcpy(weights->kept, views->recorded, bytes);
    memset(weights->split, 0, bytes);
}

void v2v_torus_views_average(struct v2v_torus_views *views, const float *frames, double unit)
{
    V2V_ASSERT(views->weights.is_on && unit > 0.0);
    views->weights.frames = frames;
    views->weights.frames_unit = (float)unit;
}

/* Samples that aren't known follow the volume. */
static void follow(float *recorded, const float *missed, int64_t first, int64_t end)
{
    for (int64_t x = first; x < end; x++) {
        recorded[x] -= missed[x];
    }
}

/* Squares of the samples that are known, first .. end of a row. */
static double squares_of(const float *missed, int64_t first, int64_t end)
{
    double squares = 0.0;
    for (int64_t x = first; x < end; x++) {
        squares += (double)missed[x] * (double)missed[x];
    }
    return squares;
}

/* Part of the way from the light that weights went by to that of now: all of it at first, then
 * less and less, or weights and volume would answer each other for ever where views contradict. */
static float part_of_way(int64_t taken)
{
    return taken < FREELY ? 1.0f : FREELY / (float)(taken + 1);
}

/* Row `whole` of a view's frames; NULL: it has none. */
static const float *frames_of(const struct v2v_torus_views *views, int64_t v, int64_t whole)
{
    const float *frames = views->weights.frames;
    return frames == NULL ? NULL : frames + (v * views->height + whole) * views->width;
}

/* Saturated samples follow a volume that is brighter. @param highest of the torus, in units of y */
static void follow_brighter(const struct v2v_torus_views *views, int64_t at, float highest,
                            int64_t first, int64_t end)
{
    for (int64_t x = at + first; x < at + end; x++) {
        const float around = views->around != NULL ? views->around[x] : 0.0f;
        views->recorded[x] = fmaxf(highest - around, views->recorded[x] - views->missed[x]);
    }
}

/* Likewise with weights, which make other samples of them.
 * @param is_saturated bool: a volume that is brighter is not answered */
static double weigh_row(const struct v2v_torus_views *views, int64_t at, const float *frames,
                        int64_t first, int64_t end, int is_saturated)
{
    const struct v2v_view_weights *weights = &views->weights;
    const float part_of_frames = frames != NULL ? 1.0f / weights->frames_unit : 1.0f;
    float *recorded = views->recorded + at, *split = weights->split + at;
    float *lights = weights->light + at;
    const float part = part_of_way(weights->taken);
    const float *kept = weights->kept + at, *missed = views->missed + at;
    const float *around = views->around + at;
    double squares = 0.0;
    for (int64_t x = first; x < end; x++) {
        const float projected = recorded[x] - missed[x];
        const float light = fmaxf(projected + around[x], 0.0f);
        lights[x] = part < 1.0f ? lights[x] + part * (light - lights[x]) : light;
        const float averaged = frames != NULL ? sqrtf(part_of_frames * frames[x]) : 1.0f;
        const float moved = projected + split[x];
        const float weight = is_saturated && moved > kept[x]
                                 ? 0.0f
                                 : averaged / (weights->gain * lights[x] + weights->floor);
        const float between = (weight * kept[x] + moved) / (weight + 1.0f);
        const double d = (double)kept[x] - (double)projected;
        squares += d * d;
        split[x] = moved - between;
        recorded[x] = between - split[x];
    }
    return squares;
}

/* Row `whole` of a view as taken, where samples aren't known; NULL: there are none such. */
static const float *frame_row(const struct v2v_torus_views *views, int64_t v, int64_t whole)
{
    return views->frame == NULL ? NULL : views->frame + (v * views->height + whole) * views->width;
}

enum knowledge { KNOWN, BLIND, SATURATED };

static enum knowledge knowledge_of(float sample, float highest)
{
    return sample == V2V_BLIND ? BLIND : sample == highest ? SATURATED : KNOWN;
}

/* Samples from `x` on to `end` at most that are alike known. @return the end of them */
static int64_t end_of_alike(const float *row, float highest, int64_t x, int64_t end)
{
    const enum knowledge first = knowledge_of(row[x], highest);
    while (x < end && knowledge_of(row[x], highest) == first) {
        x++;
    }
    return x;
}

/* Samples first .. end, known alike, of a row of the frame. @return squares of those that are
 * known */
static double answer(const struct v2v_torus_views *views, int64_t at, enum knowledge knowledge,
                     float highest, const float *frames, int64_t first, int64_t end)
{
    const int is_on = views->weights.is_on, is_saturated = knowledge == SATURATED;
    double squares = 0.0;
    if (knowledge == BLIND) {
        follow(views->recorded + at, views->missed + at, first, end);
    } else if (is_on) {
        squares = weigh_row(views, at, frames, first, end, is_saturated);
    } else if (is_saturated) {
        follow_brighter(views, at, highest, first, end);
    } else {
        squares = squares_of(views->missed + at, first, end);
    }
    return is_saturated ? 0.0 : squares;
}

/* What of a row of the torus lies in the frame. @return squares of what is known */
static double answer_row(const struct v2v_torus_views *views, int64_t v, int64_t at, int64_t whole,
                         const struct v2v_part *columns)
{
    const int64_t end = columns->first + columns->count;
    const float *row = frame_row(views, v, whole), *frames = frames_of(views, v, whole);
    const float highest = views->highest[v];
    double squares = 0.0;
    if (row == NULL) {
        return answer(views, at, KNOWN, highest, frames, columns->first, end);
    }
    for (int64_t x = columns->first, next = x; x < end; x = next) {
        next = end_of_alike(row, highest, x, end);
        squares += answer(views, at, knowledge_of(row[x], highest), highest * views->scale, frames,
                          x, next);
    }
    return squares;
}

/* A row of the residual of one view, `y` of this rank's. @return squares of what is known */
static double extend_row(const struct v2v_torus_views *views, int64_t v, int64_t y)
{
    const struct v2v_part *rows = &views->known_rows, *columns = &views->known_columns;
    const int64_t at = (v * views->torus.rows.count + y) * views->torus.width;
    const int64_t whole = views->torus.rows.first + y, width = views->torus.width;
    const int is_known = whole >= rows->first && whole < rows->first + rows->count;
    const int64_t first = is_known ? columns->first : width;
    const int64_t end = is_known ? first + columns->count : width;
    follow(views->recorded + at, views->missed + at, 0, first);
    follow(views->recorded + at, views->missed + at, end, width);
    return is_known ? answer_row(views, v, at, whole, columns) : 0.0;
}

void v2v_torus_views_extend(struct v2v_torus_views *views, double *squares)
{
    const struct v2v_part *rows = &views->torus.rows;
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < rows->count; y++) {
        double sum = 0.0;
        for (int64_t v = 0; v < views->views; v++) {
            sum += extend_row(views, v, y);
        }
        squares[rows->first + y] = sum;
    }
    views->weights.taken++;
}

/* y - A x, by the light that weights go by where there are any. */
static double left_at(const struct v2v_torus_views *views, int64_t at)
{
    const struct v2v_view_weights *weights = &views->weights;
    return weights->is_on ? (double)(weights->kept[at] - (weights->light[at] - views->around[at]))
                          : (double)views->missed[at];
}

int64_t v2v_torus_views_known(const struct v2v_torus_views *views)
{
    const struct v2v_part *rows = &views->known_rows, *columns = &views->known_columns;
    int64_t unknown = 0;
    for (int64_t i = 0; views->frame != NULL && i < views->views * rows->count; i++) {
        const int64_t v = i / rows->count;
        const float *row = frame_row(views, v, rows->first + i % rows->count);
        for (int64_t x = columns->first; x < columns->first + columns->count; x++) {
            unknown += knowledge_of(row[x], views->highest[v]) != KNOWN;
        }
    }
    return views->views * rows->count * columns->count - unknown;
}

int64_t v2v_torus_views_squares(const struct v2v_torus_views *views)
{
    return views->views * (views->known_rows.count / V2V_DATA_STEP_SQUARE) *
           (views->known_columns.count / V2V_DATA_STEP_SQUARE);
}

void v2v_torus_views_coarse(const struct v2v_torus_views *views, double *sums)
{
    enum { SIDE = V2V_DATA_STEP_SQUARE };
    const struct v2v_torus *torus = &views->torus;
    const struct v2v_part *known = &views->known_rows, *columns = &views->known_columns;
    const int64_t down = known->count / SIDE, across = columns->count / SIDE;
    const int64_t first = v2v_larger(known->first, torus->rows.first);
    const int64_t end =
        v2v_smaller(known->first + down * SIDE, torus->rows.first + torus->rows.count);
    memset(sums, 0, (size_t)v2v_torus_views_squares(views) * sizeof *sums);
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < views->views; v++) {
        for (int64_t y = first; y < end; y++) {
            double *row = sums + (v * down + (y - known->first) / SIDE) * across;
            const int64_t at = (v * torus->rows.count + y - torus->rows.first) * torus->width;
            const float *frame = frame_row(views, v, y);
            for (int64_t x = 0; x < across * SIDE; x++) {
                const int is_known = frame == NULL || knowledge_of(frame[columns->first + x],
                                                                   views->highest[v]) == KNOWN;
                row[x / SIDE] += is_known ? left_at(views, at + columns->first + x) : (double)NAN;
            }
        }
    }
}
