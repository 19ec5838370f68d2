#include "nn/stack.h"

#include "v2v3d/base/clones.h"
#include "v2v3d/op/resample.h"
#include "v2v3d/tensor/bulk.h"

#include <stddef.h>

enum { MOST_ROWS = 4 }; /* of a window: two images' two */

void v2v_stack_clear_ends(const struct v2v_stack *stack)
{
    const int64_t floats = stack->channels * v2v_stack_pixels(stack);
    if (stack->ends) {
        v2v_bulk_clear(v2v_stack_at(stack, -1, 0), floats);
        v2v_bulk_clear(v2v_stack_at(stack, stack->depth, 0), floats);
    }
}

V2V_SIMD_CLONES
void v2v_stack_add(float *to, const float *from, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        to[i] += from[i];
    }
}

/* Larger, or NaN, which stays: it must be seen downstream. */
static inline int wins(float challenger, float best)
{
    return best == best && !(challenger <= best);
}

/* One row of windows of `rows` rows; `width` is the result's. */
V2V_SIMD_CLONES
static void pool_row(float *out, uint8_t *which, const float *const row[MOST_ROWS], int rows,
                     int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        float best = row[0][2 * x];
        int place = 0;
        for (int k = 1; k < 2 * rows; k++) {
            const float challenger = row[k / 2][2 * x + k % 2];
            place = wins(challenger, best) ? k : place;
            best = wins(challenger, best) ? challenger : best;
        }
        out[x] = best;
        if (which != NULL) {
            which[x] = (uint8_t)place;
        }
    }
}

/* The rows that windows of row y of image d are made of. Returns their number. */
static int rows_of(float *row[MOST_ROWS], const struct v2v_stack *large,
                   const struct v2v_stack *small, int64_t d, int64_t c, int64_t y)
{
    const int images = large->depth > small->depth ? 2 : 1;
    for (int r = 0; r < 2 * images; r++) {
        row[r] = v2v_stack_at(large, images * d + r / 2, c) + (2 * y + r % 2) * large->width;
    }
    return 2 * images;
}

/* Place of a row in an array [depth,channels,y,x] without ends. */
static int64_t place_of(const struct v2v_stack *stack, int64_t d, int64_t c, int64_t y)
{
    return ((d * stack->channels + c) * stack->height + y) * stack->width;
}

void v2v_stack_pool(const struct v2v_stack *out, uint8_t *which, const struct v2v_stack *in)
{
#pragma omp parallel for collapse(3) schedule(static)
    for (int64_t d = 0; d < out->depth; d++) {
        for (int64_t c = 0; c < out->channels; c++) {
            for (int64_t y = 0; y < out->height; y++) {
                float *row[MOST_ROWS];
                const int rows = rows_of(row, in, out, d, c, y);
                const float *const from[MOST_ROWS] = {row[0], row[1], row[rows - 2], row[rows - 1]};
                pool_row(v2v_stack_at(out, d, c) + y * out->width,
                         which == NULL ? NULL : which + place_of(out, d, c, y), from, rows,
                         out->width);
            }
        }
    }
}

void v2v_stack_pool_backward(const struct v2v_stack *din, const struct v2v_stack *dout,
                             const uint8_t *which)
{
#pragma omp parallel for collapse(3) schedule(static)
    for (int64_t d = 0; d < dout->depth; d++) {
        for (int64_t c = 0; c < dout->channels; c++) {
            for (int64_t y = 0; y < dout->height; y++) {
                float *row[MOST_ROWS];
                const float *from = v2v_stack_at(dout, d, c) + y * dout->width;
                const uint8_t *place = which + place_of(dout, d, c, y);
                (void)rows_of(row, din, dout, d, c, y);
                for (int64_t x = 0; x < dout->width; x++) {
                    row[place[x] / 2][2 * x + place[x] % 2] += from[x];
                }
            }
        }
    }
}

void v2v_stack_repeat(const struct v2v_stack *out, int64_t first, const struct v2v_stack *in)
{
    const int64_t times = out->depth / in->depth;
    for (int64_t d = 0; d < out->depth; d++) {
        v2v_nearest2_forward(v2v_stack_at(out, d, first), v2v_stack_at(in, d / times, 0),
                             in->channels, in->height, in->width);
    }
}

void v2v_stack_repeat_backward(const struct v2v_stack *din, const struct v2v_stack *dout,
                               int64_t first, float *scratch)
{
    const int64_t times = dout->depth / din->depth;
    for (int64_t d = 0; d < dout->depth; d++) {
        float *to = v2v_stack_at(din, d / times, 0);
        v2v_nearest2_backward(d % times == 0 ? to : scratch, v2v_stack_at(dout, d, first),
                              din->channels, din->height, din->width);
        if (d % times != 0) {
            const int64_t pixels = v2v_stack_pixels(din);
#pragma omp parallel for schedule(static)
            for (int64_t c = 0; c < din->channels; c++) {
                v2v_stack_add(to + c * pixels, scratch + c * pixels, pixels);
            }
        }
    }
}
