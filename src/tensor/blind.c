#include "v2v3d/tensor/blind.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Samples of one value that noise doesn't make: the side of a block, and a run. Blocks begin in
 * every second row and column. */
enum { SIDE = 8, STEP = 2, RUN = 32 };

/* Values of such parts, of which there are one or two: more of a view are counts of smooth light;
 * more of a frame aren't looked at. */
enum { MOST_VALUES = 4, OF_FRAME = 16 };

/* Of the samples that touch a part, those next to its value: noise of 1.6 counts makes it 0.53, of
 * 0.7 counts 0.93. */
static const double most_next = 0.8;

/* Samples that are no chance: so many, and this part of all. */
enum { FEW = 32, PARTS_OF_FEW = 1000 };

/* Of the gap between a part's value and the least of the others, and of those how many lie as close
 * to it: the dark, where a camera's zero is well above a mask's. */
static const float part_of_gap = 0.25f;
static const double much_beside = 0.01;

/* Marks of a part of one value, and of a view of one beside others that vary. */
enum { PART = 1, DEAD = 2 };

struct images {
    const float *views;
    float zero;
    uint8_t *marks;
    int64_t count, height, width;
};

static void mark(uint8_t *marks, int64_t height, int64_t width, int64_t pitch)
{
    for (int64_t y = 0; y < height; y++) {
        memset(marks + y * pitch, PART, (size_t)width);
    }
}

static int64_t mark_rows(uint8_t *marks, const float *view, int64_t height, int64_t width)
{
    int64_t found = 0;
    for (int64_t y = 0; y < height; y++) {
        const float *row = view + y * width;
        for (int64_t x = 0, first = 0; x < width; x++) {
            first = row[x] == row[first] ? first : x;
            if (x + 1 - first == RUN) {
                mark(marks + y * width + first, 1, RUN, width);
                found++;
            } else if (x + 1 - first > RUN) {
                marks[y * width + x] = PART;
            }
        }
    }
    return found;
}

/* Columns side by side, so that memory is read along rows. */
static int64_t mark_columns(uint8_t *marks, const float *view, int64_t height, int64_t width)
{
    enum { BUNDLE = 64 };
    int64_t found = 0;
    for (int64_t left = 0; left < width; left += BUNDLE) {
        const int64_t count = v2v_smaller(BUNDLE, width - left);
        int64_t first[BUNDLE] = {0};
        for (int64_t y = 1; y < height; y++) {
            const float *row = view + y * width + left, *above = row - width;
            for (int64_t x = 0; x < count; x++) {
                first[x] = row[x] == above[x] ? first[x] : y;
                if (y + 1 - first[x] == RUN) {
                    mark(marks + first[x] * width + left + x, RUN, 1, width);
                    found++;
                } else if (y + 1 - first[x] > RUN) {
                    marks[y * width + left + x] = PART;
                }
            }
        }
    }
    return found;
}

static int is_block(const float *at, int64_t width)
{
    const float value = at[0];
    int is_one = at[SIDE - 1] == value && at[(SIDE - 1) * width] == value;
    for (int64_t y = 0; y < SIDE && is_one; y++) {
        for (int64_t x = 0; x < SIDE; x++) {
            is_one &= at[y * width + x] == value;
        }
    }
    return is_one;
}

static int64_t mark_blocks(uint8_t *marks, const float *view, int64_t height, int64_t width)
{
    int64_t found = 0;
    for (int64_t y = 0; y + SIDE <= height; y += STEP) {
        for (int64_t x = 0; x + SIDE <= width; x += STEP) {
            if (is_block(view + y * width + x, width)) {
                mark(marks + y * width + x, SIDE, SIDE, width);
                found++;
            }
        }
    }
    return found;
}

/* @return how many parts there are */
static int64_t mark_parts(const struct images *in)
{
    const int64_t height = in->height, width = in->width, pixels = height * width;
    int64_t found = 0;
#pragma omp parallel for schedule(dynamic) reduction(+ : found)
    for (int64_t v = 0; v < in->count; v++) {
        const float *view = in->views + v * pixels;
        uint8_t *marks = in->marks + v * pixels;
        memset(marks, 0, (size_t)pixels);
        if (v2v_is_of_one_value(view, pixels)) {
            memset(marks, PART, (size_t)pixels);
            found++;
        } else {
            found += mark_rows(marks, view, height, width) +
                     mark_columns(marks, view, height, width) +
                     mark_blocks(marks, view, height, width);
        }
    }
    return found;
}

static int is_among(const float *values, int count, float value)
{
    int found = 0;
    for (int k = 0; k < count; k++) {
        found |= values[k] == value;
    }
    return found;
}

static int64_t some_of(const struct images *in)
{
    return v2v_larger(FEW, in->count * in->height * in->width / PARTS_OF_FEW);
}

/* The first values of parts among so many samples. @return how many */
static int list_values(float *values, int most, const float *views, const uint8_t *marks,
                       int64_t samples)
{
    int listed = 0;
    for (int64_t i = 0; i < samples && listed < most; i++) {
        if (marks[i] == PART && !is_among(values, listed, views[i])) {
            values[listed++] = views[i];
        }
    }
    return listed;
}

/* Does a part of this value touch a sample? */
static int touches(const float *view, const uint8_t *marks, int64_t height, int64_t width,
                   int64_t at, float value)
{
    const int64_t y = at / width, x = at % width;
    int found = 0;
    for (int64_t j = v2v_larger(y - 1, 0); j <= y + 1 && j < height; j++) {
        for (int64_t i = v2v_larger(x - 1, 0); i <= x + 1 && i < width; i++) {
            found |= marks[j * width + i] == PART && view[j * width + i] == value;
        }
    }
    return found;
}

/* Are most samples that touch a view's parts of this value of one of the values next to it? */
static int is_coarse(const float *view, const uint8_t *marks, int64_t height, int64_t width,
                     float value)
{
    float lower = -INFINITY, higher = INFINITY;
    int64_t touching = 0, next = 0;
    for (int64_t i = 0; i < height * width; i++) {
        lower = view[i] < value && view[i] > lower ? view[i] : lower;
        higher = view[i] > value && view[i] < higher ? view[i] : higher;
    }
    for (int64_t i = 0; i < height * width; i++) {
        if (view[i] != value && touches(view, marks, height, width, i, value)) {
            touching++;
            next += view[i] == lower || view[i] == higher;
        }
    }
    return (double)next > most_next * (double)touching;
}

/* Parts of a view whose counts are coarser than their noise are none. */
static void forget_coarse(const struct images *in, int64_t v)
{
    const int64_t pixels = in->height * in->width;
    const float *view = in->views + v * pixels;
    uint8_t *marks = in->marks + v * pixels;
    float values[MOST_VALUES + 1];
    int kept = 0;
    const int listed = list_values(values, MOST_VALUES + 1, view, marks, pixels);
    for (int k = 0; k < listed && listed <= MOST_VALUES; k++) {
        if (!is_coarse(view, marks, in->height, in->width, values[k])) {
            values[kept++] = values[k];
        }
    }
    for (int64_t i = 0; i < pixels && kept < listed; i++) {
        marks[i] = marks[i] == PART && is_among(values, kept, view[i]) ? PART : 0;
    }
}

/* Samples that are of no part. */
struct beside {
    int64_t below, above, same;
};

static struct beside look_beside(const struct images *in, float value)
{
    int64_t below = 0, above = 0, same = 0;
#pragma omp parallel for simd schedule(static) reduction(+ : below, above, same)
    for (int64_t i = 0; i < in->count * in->height * in->width; i++) {
        const int is_beside = in->marks[i] == 0;
        below += is_beside && in->views[i] < value;
        above += is_beside && in->views[i] > value;
        same += is_beside && in->views[i] == value;
    }
    return (struct beside){below, above, same};
}

/* Does a value lie below all others that are of no part, farther than much of them lies from their
 * least? */
static int lies_apart(const struct images *in, float value)
{
    const int64_t samples = in->count * in->height * in->width;
    float least = INFINITY;
    int64_t beside = 0, close = 0;
#pragma omp parallel for simd schedule(static) reduction(min : least) reduction(+ : beside)
    for (int64_t i = 0; i < samples; i++) {
        const int is_beside = in->marks[i] == 0 && in->views[i] != value;
        least = is_beside && in->views[i] < least ? in->views[i] : least;
        beside += is_beside;
    }
    const float end = least + (least - value) * part_of_gap;
#pragma omp parallel for simd schedule(static) reduction(+ : close)
    for (int64_t i = 0; i < samples; i++) {
        close += in->marks[i] == 0 && in->views[i] != value && in->views[i] < end;
    }
    return value < least && (double)close > much_beside * (double)beside;
}

/* Does noise go both ways? Light is not below zero, and what lies there by itself is not its
 * dark. */
static int may_see_nothing(const struct images *in, float value)
{
    const struct beside beside = look_beside(in, value);
    const int64_t some = some_of(in);
    const int is_below = isnan(in->zero) ? lies_apart(in, value) : value < in->zero;
    return beside.above >= some && (beside.below >= some || is_below);
}

/* .. after parts grew. */
static int sees_nothing(const struct images *in, float value)
{
    const struct beside beside = look_beside(in, value);
    return beside.below >= some_of(in) || beside.below + beside.same < FEW;
}

/* Is there enough but this value in views that vary? */
static int do_others_vary(const struct images *in, float value)
{
    const int64_t pixels = in->height * in->width;
    int64_t others = 0;
#pragma omp parallel for schedule(dynamic) reduction(+ : others)
    for (int64_t v = 0; v < in->count; v++) {
        const float *view = in->views + v * pixels;
        const int64_t looked_at = v2v_is_of_one_value(view, pixels) ? 0 : pixels;
        for (int64_t i = 0; i < looked_at; i++) {
            others += view[i] != value;
        }
    }
    return others >= some_of(in);
}

static int spread_to(uint8_t *mark, uint8_t from, int is_alike)
{
    const int is_new = from != 0 && *mark == 0 && is_alike;
    *mark = is_new ? PART : *mark;
    return is_new;
}

/* To what touches a part by a side, of its value. */
static void grow(const struct images *in, int64_t v)
{
    const int64_t width = in->width, pixels = in->height * width;
    const float *view = in->views + v * pixels;
    uint8_t *marks = in->marks + v * pixels;
    for (int is_more = memchr(marks, PART, (size_t)pixels) != NULL; is_more;) {
        is_more = 0;
        for (int64_t i = 0; i < pixels; i++) {
            const int64_t left = i % width > 0 ? i - 1 : i, up = i >= width ? i - width : i;
            is_more |= spread_to(&marks[i], marks[left], view[i] == view[left]) |
                       spread_to(&marks[i], marks[up], view[i] == view[up]);
        }
        for (int64_t i = pixels - 1; i >= 0; i--) {
            const int64_t right = (i + 1) % width > 0 ? i + 1 : i;
            const int64_t down = i + width < pixels ? i + width : i;
            is_more |= spread_to(&marks[i], marks[right], view[i] == view[right]) |
                       spread_to(&marks[i], marks[down], view[i] == view[down]);
        }
    }
}

/* Values, of those listed, that see nothing; parts grow. @return how many */
static int choose_values(float *values, int listed, const struct images *in)
{
    int possible = 0, chosen = 0;
    for (int k = 0; k < listed; k++) {
        if (may_see_nothing(in, values[k])) {
            values[possible++] = values[k];
        }
    }
#pragma omp parallel for schedule(dynamic)
    for (int64_t v = 0; v < (possible > 0 ? in->count : 0); v++) {
        grow(in, v);
    }
    for (int k = 0; k < possible; k++) {
        if (sees_nothing(in, values[k])) {
            values[chosen++] = values[k];
        }
    }
    return chosen;
}

/* What is marked becomes 1 where nothing is seen, else 0. @return how many see nothing */
static int64_t settle(const struct images *in, const float *values, int count)
{
    const int64_t pixels = in->height * in->width;
    int64_t found = 0;
    for (int64_t v = 0; v < in->count; v++) {
        const float *view = in->views + v * pixels;
        uint8_t *marks = in->marks + v * pixels;
        if (v2v_is_of_one_value(view, pixels) && do_others_vary(in, view[0])) {
            memset(marks, DEAD, (size_t)pixels);
        }
    }
#pragma omp parallel for schedule(static) reduction(+ : found)
    for (int64_t i = 0; i < in->count * pixels; i++) {
        const uint8_t mark = in->marks[i];
        in->marks[i] = mark == DEAD || (mark == PART && is_among(values, count, in->views[i]));
        found += in->marks[i];
    }
    return found;
}

int64_t v2v_blind_find(uint8_t *marks, const float *views, double zero, int64_t count,
                       int64_t height, int64_t width)
{
    const struct images in = {views, (float)zero, marks, count, height, width};
    const int64_t samples = count * height * width;
    float values[OF_FRAME];
    if (mark_parts(&in) == 0) {
        return 0;
    }
#pragma omp parallel for schedule(dynamic)
    for (int64_t v = 0; v < count; v++) {
        forget_coarse(&in, v);
    }
    const int listed = list_values(values, OF_FRAME, views, marks, samples);
    return settle(&in, values, choose_values(values, listed, &in));
}

void v2v_blind_leave(float *views, const uint8_t *marks, int64_t samples)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        views[i] = marks[i] ? V2V_BLIND : views[i];
    }
}

void v2v_blind_darken(float *views, int64_t samples)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        views[i] = views[i] != V2V_BLIND ? views[i] : 0.0f;
    }
}

void v2v_blind_fill(float *views, int64_t count, int64_t pixels)
{
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < count; v++) {
        float *view = views + v * pixels;
        double sum = 0.0, seen = 0.0;
        for (int64_t i = 0; i < pixels; i++) {
            sum += view[i] != V2V_BLIND ? (double)view[i] : 0.0;
            seen += view[i] != V2V_BLIND;
        }
        const float mean = seen > 0.0 ? (float)(sum / seen) : 0.0f;
        for (int64_t i = 0; i < pixels; i++) {
            view[i] = view[i] != V2V_BLIND ? view[i] : mean;
        }
    }
}

void v2v_blind_take_over(float *views, const float *from, int64_t samples)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        views[i] = from[i] == V2V_BLIND ? V2V_BLIND : views[i];
    }
}

int64_t v2v_blind_count(const float *views, int64_t samples)
{
    int64_t found = 0;
#pragma omp parallel for simd schedule(static) reduction(+ : found)
    for (int64_t i = 0; i < samples; i++) {
        found += views[i] == V2V_BLIND;
    }
    return found;
}

int64_t v2v_blind_gather_seen(float *seen, const float *views, int64_t samples)
{
    int64_t count = 0;
    for (int64_t i = 0; i < samples; i++) {
        if (views[i] != V2V_BLIND) {
            seen[count++] = views[i];
        }
    }
    return count;
}
