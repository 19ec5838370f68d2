#include "recon/windows.h"

#include "v2v3d/base/bounds.h"

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

/* Made longer, to a multiple of the step or to the end, and beginning at an even pixel. */
static struct v2v_part round_up(const struct v2v_part *part, int64_t whole)
{
    const int64_t count = v2v_smaller(v2v_round_up(part->count, V2V_WINDOWS_STEP), whole);
    const int64_t before = (count - part->count) / 4 * 2;
    const int64_t first = v2v_within(part->first - before, 0, whole - count);
    return first % 2 == 0 ? (struct v2v_part){first, count}
                          : (struct v2v_part){first - 1, whole - first + 1};
}

/* Along one axis, tiles first .. end. */
static void cut_axis(struct v2v_part *pixels, struct v2v_part *core, int64_t first, int64_t end,
                     int64_t whole, const struct v2v_windows_plan *plan)
{
    *core = widen(first * plan->tile, end * plan->tile, plan->halo, whole);
    *pixels = widen(core->first, core->first + core->count, plan->margin, whole);
    *pixels = round_up(pixels, whole);
}

static struct v2v_window window_of(const struct box *box, const struct v2v_windows_plan *plan)
{
    struct v2v_window window;
    cut_axis(&window.rows, &window.core_rows, box->top, box->bottom, plan->height, plan);
    cut_axis(&window.columns, &window.core_columns, box->left, box->right, plan->width, plan);
    return window;
}

static int64_t pixels_of(int64_t height, int64_t width, const struct v2v_windows_plan *plan)
{
    return v2v_larger(height + plan->border, plan->least) *
           v2v_larger(width + plan->border, plan->least);
}

static int64_t cost_of(const struct box *box, const struct v2v_windows_plan *plan)
{
    const struct v2v_window window = window_of(box, plan);
    return pixels_of(window.rows.count, window.columns.count, plan);
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

int64_t v2v_windows_cover(struct v2v_window *windows, const uint8_t *changed,
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

double v2v_windows_part(const struct v2v_window *windows, int64_t count,
                        const struct v2v_windows_plan *plan)
{
    double pixels = 0.0;
    for (int64_t i = 0; i < count; i++) {
        pixels += (double)pixels_of(windows[i].rows.count, windows[i].columns.count, plan);
    }
    return pixels / (double)pixels_of(plan->height, plan->width, plan);
}
