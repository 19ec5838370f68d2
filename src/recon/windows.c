#include "recon/windows.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/fft/fft2.h"

#include <string.h>

/* Pixels that a window's sides grow by, so that windows of the same size follow each other. */
enum { STEP = 16 };

/* Tiles, the last row and column not included. */
struct box {
    int64_t top, bottom, left, right;
};

static int is_empty(const struct box *box)
{
    return box->top >= box->bottom;
}

/* The smallest box about the tiles marked within `box`. */
static struct box shrink(const struct box *box, const uint8_t *changed, int64_t columns)
{
    struct box about = {box->bottom, box->top, box->right, box->left};
    for (int64_t y = box->top; y < box->bottom; y++) {
        for (int64_t x = box->left; x < box->right; x++) {
            if (changed[y * columns + x]) {
                about.top = v2v_smaller(about.top, y);
                about.bottom = y + 1;
                about.left = v2v_smaller(about.left, x);
                about.right = v2v_larger(about.right, x + 1);
            }
        }
    }
    return about;
}

/* Pixels first .. end with those around, of a side that is `whole` long. */
static struct v2v_part widen(int64_t first, int64_t end, int64_t around, int64_t whole)
{
    const int64_t from = v2v_larger(first - around, 0);
    return (struct v2v_part){from, v2v_smaller(end + around, whole) - from};
}

/* The core and the margin about it, made longer to a good size, or the whole torus. */
static struct v2v_part surround(const struct v2v_part *core, int64_t whole, int64_t torus,
                                const struct v2v_windows_plan *plan)
{
    const int64_t wanted = v2v_larger(core->count + 2 * plan->margin, plan->least);
    const int64_t count = v2v_fft_good_size(v2v_round_up(wanted, STEP));
    const int64_t earliest = -((torus - whole) / 2 * 2), latest = torus - count;
    if (latest <= 0) {
        return (struct v2v_part){0, torus};
    }
    const int64_t first = v2v_within(core->first - (count - core->count) / 2, earliest, latest);
    return (struct v2v_part){first - (first % 2 != 0), count};
}

static struct v2v_core_window window_of(const struct box *box, const struct v2v_windows_plan *plan)
{
    struct v2v_core_window window;
    const int64_t tile = plan->tile;
    window.core_rows = widen(box->top * tile, box->bottom * tile, plan->halo, plan->height);
    window.core_columns = widen(box->left * tile, box->right * tile, plan->halo, plan->width);
    window.rows = surround(&window.core_rows, plan->height, plan->torus_height, plan);
    window.columns = surround(&window.core_columns, plan->width, plan->torus_width, plan);
    return window;
}

static int64_t pixels_of(const struct v2v_core_window *window)
{
    return window->rows.count * window->columns.count;
}

static int64_t cost_of(const struct box *box, const struct v2v_windows_plan *plan)
{
    const struct v2v_core_window window = window_of(box, plan);
    return pixels_of(&window);
}

/* The cut of a box along one axis that leaves the least to compute. @return bool: less than
 * before */
static int cut(struct box *first, struct box *second, const uint8_t *changed, int64_t columns,
               const struct v2v_windows_plan *plan)
{
    const struct box whole = *first;
    int64_t least = cost_of(&whole, plan);
    int found = 0;
    for (int axis = 0; axis < 2; axis++) {
        const int64_t from = axis == 0 ? whole.top : whole.left;
        const int64_t to = axis == 0 ? whole.bottom : whole.right;
        for (int64_t at = from + 1; at < to; at++) {
            struct box before = whole, after = whole;
            *(axis == 0 ? &before.bottom : &before.right) = at;
            *(axis == 0 ? &after.top : &after.left) = at;
            before = shrink(&before, changed, columns);
            after = shrink(&after, changed, columns);
            const int64_t cost = cost_of(&before, plan) + cost_of(&after, plan);
            if (cost < least) {
                least = cost;
                *first = before;
                *second = after;
                found = 1;
            }
        }
    }
    return found;
}

int64_t v2v_windows_cover(struct v2v_core_window *windows, const uint8_t *changed,
                          const struct v2v_windows_plan *plan)
{
    struct box boxes[V2V_WINDOWS_MOST];
    const int64_t columns = v2v_parts(plan->width, plan->tile);
    const struct box frame = {0, v2v_parts(plan->height, plan->tile), 0, columns};
    int64_t count = 1;
    boxes[0] = shrink(&frame, changed, columns);
    if (is_empty(&boxes[0])) {
        return 0;
    }
    for (int64_t i = 0; i < count;) {
        if (count < V2V_WINDOWS_MOST && cut(&boxes[i], &boxes[count], changed, columns, plan)) {
            count++;
        } else {
            i++;
        }
    }
    for (int64_t i = 0; i < count; i++) {
        windows[i] = window_of(&boxes[i], plan);
    }
    return count;
}

struct v2v_part v2v_windows_in_frame(const struct v2v_part *part, int64_t whole)
{
    const int64_t first = v2v_larger(part->first, 0);
    return (struct v2v_part){first - part->first,
                             v2v_smaller(part->first + part->count, whole) - first};
}

/* A row of a window from one of the torus, whose last columns are those before its first. */
static void cut_row(float *to, const float *row, const struct v2v_part *columns, int64_t width)
{
    const int64_t before = v2v_larger(-columns->first, 0);
    memcpy(to, row + width - before, (size_t)before * sizeof *to);
    memcpy(to + before, row + columns->first + before,
           (size_t)(columns->count - before) * sizeof *to);
}

void v2v_windows_cut(float *out, const float *planes, int64_t count,
                     const struct v2v_core_window *window, const struct v2v_windows_plan *plan)
{
    const int64_t height = plan->torus_height, width = plan->torus_width;
    const int64_t rows = window->rows.count;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count * rows; i++) {
        const int64_t y = window->rows.first + i % rows;
        const float *from = planes + (i / rows * height + (y < 0 ? y + height : y)) * width;
        cut_row(out + i * window->columns.count, from, &window->columns, width);
    }
}

double v2v_windows_part(const struct v2v_core_window *windows, int64_t count,
                        const struct v2v_windows_plan *plan)
{
    double pixels = 0.0;
    for (int64_t i = 0; i < count; i++) {
        pixels += (double)pixels_of(&windows[i]);
    }
    return pixels / ((double)plan->torus_height * (double)plan->torus_width);
}
