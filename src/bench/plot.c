#include "v2v3d/bench/bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { HEIGHT = 560, WIDTH = 900, LEFT = 110, RIGHT = 40, TOP = 56, BOTTOM = 76 };
enum { ZOOM = 2, CHARACTER = 6 * ZOOM, LINE = 10 * ZOOM, DOT = 4, GAP = 24 };
static const uint32_t white = 0xffffff, grey = 0x909090, dim = 0x303030, orange = 0xffa030;

/* Marks of a logarithmic axis: 1, 2 and 5 times a power of ten. */
enum { MARKS_A_DECADE = 3 };

static double mark(int64_t i)
{
    static const double factor[MARKS_A_DECADE] = {1.0, 2.0, 5.0};
    int64_t decade = (int64_t)floor((double)i / MARKS_A_DECADE);
    return factor[i - decade * MARKS_A_DECADE] * pow(10.0, (double)decade);
}

/* From mark `low` to mark `high`. */
struct axis {
    int64_t low, high;
    int64_t first, last; /* pixels */
};

/* The marks around the values. */
static struct axis axis_of(const double *values, int64_t count, int64_t first, int64_t last)
{
    struct axis axis = {.first = first, .last = last};
    double least = INFINITY, most = 0.0;
    for (int64_t i = 0; i < count; i++) {
        least = fmin(least, values[i]);
        most = fmax(most, values[i]);
    }
    if (count == 0) {
        least = most = 1.0;
    }
    axis.low = (int64_t)floor(log10(least)) * MARKS_A_DECADE;
    while (mark(axis.low + 1) <= least) {
        axis.low++;
    }
    axis.high = axis.low + 1;
    while (mark(axis.high) < most) {
        axis.high++;
    }
    return axis;
}

static int64_t place_on(const struct axis *axis, double value)
{
    double part = log(value / mark(axis->low)) / log(mark(axis->high) / mark(axis->low));
    return axis->first + (int64_t)lround(part * (double)(axis->last - axis->first));
}

/* Over two decades only the powers of ten are marked. */
static int is_marked(const struct axis *axis, int64_t i)
{
    return axis->high - axis->low <= 2 * MARKS_A_DECADE || i % MARKS_A_DECADE == 0;
}

static void draw_axes(struct v2v_canvas *canvas, const struct axis *x, const struct axis *y)
{
    char text[32];
    for (int64_t i = x->low; i <= x->high; i++) {
        int64_t at = place_on(x, mark(i));
        if (is_marked(x, i)) {
            int length = snprintf(text, sizeof text, "%g", mark(i));
            v2v_canvas_line(canvas, y->last, at, y->first, at, dim);
            v2v_canvas_text(canvas, y->first + LINE / 2, at - length * CHARACTER / 2, text, ZOOM,
                            grey);
        }
    }
    for (int64_t i = y->low; i <= y->high; i++) {
        int64_t at = place_on(y, mark(i));
        if (is_marked(y, i)) {
            int length = snprintf(text, sizeof text, "%.0e", mark(i));
            v2v_canvas_line(canvas, at, x->first, at, x->last, dim);
            v2v_canvas_text(canvas, at - LINE / 3, x->first - (length + 1) * CHARACTER, text, ZOOM,
                            grey);
        }
    }
    v2v_canvas_line(canvas, y->first, x->first, y->first, x->last, grey);
    v2v_canvas_line(canvas, y->first, x->first, y->last, x->first, grey);
}

/* A line of text, or a dot, that others keep away from. */
struct label {
    int64_t y, x, width;
};

static int is_free(const struct label *label, const struct label *others, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        const struct label *other = &others[i];
        if (llabs(label->y - other->y) < LINE && label->x < other->x + other->width &&
            other->x < label->x + label->width) {
            return 0;
        }
    }
    return 1;
}

/* Beside its dot or, line by line, as near to that as nothing is hit. */
static struct label find_room(int64_t y, int64_t x, int64_t width, const struct label *others,
                              int64_t count)
{
    struct label label = {.y = y - LINE / 3, .x = x + GAP, .width = width};
    if (label.x + width > WIDTH) {
        label.x = x - GAP - width;
    }
    const int64_t beside = label.y;
    for (int64_t i = 1; i < 2 * HEIGHT / LINE && !is_free(&label, others, count); i++) {
        int64_t moved = beside + (i % 2 == 0 ? i / 2 : -(i + 1) / 2) * LINE;
        label.y = moved < TOP || moved > HEIGHT - BOTTOM ? label.y : moved;
    }
    return label;
}

static void draw_dot(struct v2v_canvas *canvas, int64_t y, int64_t x)
{
    for (int64_t row = -DOT; row <= DOT; row++) {
        v2v_canvas_line(canvas, y + row, x - DOT, y + row, x + DOT, orange);
    }
}

/* Labels keep away from dots and from each other. */
static void draw_rows(struct v2v_canvas *canvas, const struct axis *x, const struct axis *y,
                      const char *const *names, const double *seconds, const double *errors,
                      int64_t count)
{
    struct label taken[2 * V2V_BENCH_MOST_ROWS];
    for (int64_t i = 0; i < count; i++) {
        taken[i] = (struct label){.y = place_on(y, errors[i]) - LINE / 3,
                                  .x = place_on(x, seconds[i]) - DOT,
                                  .width = 2 * DOT + 1};
    }
    for (int64_t i = 0; i < count; i++) {
        int64_t row = place_on(y, errors[i]), column = place_on(x, seconds[i]);
        int64_t length = (int64_t)strlen(names[i]) * CHARACTER;
        struct label label = find_room(row, column, length, taken, count + i);
        taken[count + i] = label;
        v2v_canvas_line(canvas, row, column, label.y + LINE / 3,
                        label.x > column ? label.x - ZOOM : label.x + label.width, grey);
        draw_dot(canvas, row, column);
        v2v_canvas_text(canvas, label.y, label.x, names[i], ZOOM, white);
    }
}

enum v2v_status v2v_bench_plot(struct v2v_canvas *canvas, const struct v2v_bench_result *result)
{
    enum v2v_status rc = V2V_OK;
    const char *names[V2V_BENCH_MOST_ROWS];
    double seconds[V2V_BENCH_MOST_ROWS], errors[V2V_BENCH_MOST_ROWS];
    int64_t count = 0;
    V2V_TRY(v2v_canvas_init(canvas, HEIGHT, WIDTH));
    for (int64_t i = 0; i < result->rows; i++) {
        const struct v2v_bench_row *row = &result->row[i];
        double error = row->error[0] > row->error[1] ? row->error[0] : row->error[1];
        /* zero, NaN and Inf have no place on logarithmic axes; the table has them */
        if (row->forward_s > 0.0 && error > 0.0 && isfinite(row->error[0] + row->error[1])) {
            names[count] = row->name;
            seconds[count] = row->forward_s;
            errors[count++] = error;
        }
    }
    struct axis x = axis_of(seconds, count, LEFT, WIDTH - RIGHT);
    struct axis y = axis_of(errors, count, HEIGHT - BOTTOM, TOP);
    draw_axes(canvas, &x, &y);
    v2v_canvas_text(canvas, LINE, LEFT, "relative error of the volumes against run time", ZOOM,
                    white);
    v2v_canvas_text(canvas, HEIGHT - 3 * LINE / 2, WIDTH / 2, "forward pass, seconds", ZOOM, white);
    draw_rows(canvas, &x, &y, names, seconds, errors, count);
done:
    return rc;
}
