/* The body of a kernel set; included once by each winograd_*.c, which defines
 *   LANES            floats of a vector
 *   TARGET           the instruction set, as a function attribute
 *   WINOGRAD_KERNEL  the name of the table
 *   STREAM           if it has one: the store of a vector, a cache's line, past the caches
 * No include guard: it is a template. Pairs of points p and -p share the sum of the even pixels and
 * that of the odd ones. */
#include "op/winograd_kernel.h"
#include <string.h>

typedef float values __attribute__((vector_size(LANES * 4), aligned(4), may_alias));

#define INLINE TARGET static inline __attribute__((always_inline))

INLINE void input(values *v, const values *d)
{
    values even = d[4] - 4.0f * d[2], odd = d[3] - 4.0f * d[1];
    values even2 = d[4] - d[2], odd2 = 2.0f * (d[3] - d[1]);
    v[0] = 4.0f * d[0] - 5.0f * d[2] + d[4];
    v[1] = even + odd;
    v[2] = even - odd;
    v[3] = even2 + odd2;
    v[4] = even2 - odd2;
    v[5] = 4.0f * d[1] - 5.0f * d[3] + d[5];
}

INLINE void input_turned(values *d, const values *v)
{
    values sum = v[1] + v[2], difference = v[1] - v[2];
    values sum2 = v[3] + v[4], difference2 = 2.0f * (v[3] - v[4]);
    d[0] = 4.0f * v[0];
    d[1] = 4.0f * (v[5] - difference) - difference2;
    d[2] = -5.0f * v[0] - 4.0f * sum - sum2;
    d[3] = difference + difference2 - 5.0f * v[5];
    d[4] = v[0] + sum + sum2;
    d[5] = v[5];
}

INLINE void output(values *y, const values *v)
{
    values sum = v[1] + v[2], difference = v[1] - v[2];
    values sum2 = v[3] + v[4], difference2 = v[3] - v[4];
    y[0] = v[0] + sum + sum2;
    y[1] = difference + 2.0f * difference2;
    y[2] = sum + 4.0f * sum2;
    y[3] = difference + 8.0f * difference2 + v[5];
}

INLINE void output_turned(values *v, const values *y)
{
    values even = y[0] + y[2], odd = y[1] + y[3];
    values even2 = y[0] + 4.0f * y[2], odd2 = 2.0f * y[1] + 8.0f * y[3];
    v[0] = y[0];
    v[1] = even + odd;
    v[2] = even - odd;
    v[3] = even2 + odd2;
    v[4] = even2 - odd2;
    v[5] = y[3];
}

INLINE void taps(values *u, const values *g)
{
    values even = (-1.0f / 6.0f) * (g[0] + g[2]), odd = (-1.0f / 6.0f) * g[1];
    values even2 = (1.0f / 24.0f) * (g[0] + 4.0f * g[2]), odd2 = (1.0f / 12.0f) * g[1];
    u[0] = 0.25f * g[0];
    u[1] = even + odd;
    u[2] = even - odd;
    u[3] = even2 + odd2;
    u[4] = even2 - odd2;
    u[5] = g[2];
}

INLINE void taps_turned(values *g, const values *u)
{
    values even = (-1.0f / 6.0f) * (u[1] + u[2]), odd = (-1.0f / 6.0f) * (u[1] - u[2]);
    values even2 = (1.0f / 24.0f) * (u[3] + u[4]), odd2 = (1.0f / 12.0f) * (u[3] - u[4]);
    g[0] = 0.25f * u[0] + even + even2;
    g[1] = odd + odd2;
    g[2] = even + 4.0f * even2 + u[5];
}

INLINE void filter(values *u, const values *g)
{
    values half[3][WINOGRAD_POINTS], column[WINOGRAD_POINTS];
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) {
        taps(half[k], g + 3 * k);
    }
#pragma GCC unroll 6
    for (int x = 0; x < WINOGRAD_POINTS; x++) {
        values three[3] = {half[0][x], half[1][x], half[2][x]};
        taps(column, three);
#pragma GCC unroll 6
        for (int y = 0; y < WINOGRAD_POINTS; y++) {
            u[y * WINOGRAD_POINTS + x] = column[y];
        }
    }
}

INLINE void filter_turned(values *g, const values *u)
{
    values half[3][WINOGRAD_POINTS], three[3];
#pragma GCC unroll 6
    for (int y = 0; y < WINOGRAD_POINTS; y++) {
        taps_turned(three, u + y * WINOGRAD_POINTS);
#pragma GCC unroll 3
        for (int l = 0; l < 3; l++) {
            half[l][y] = three[l];
        }
    }
#pragma GCC unroll 3
    for (int l = 0; l < 3; l++) {
        taps_turned(three, half[l]);
#pragma GCC unroll 3
        for (int k = 0; k < 3; k++) {
            g[3 * k + l] = three[k];
        }
    }
}

typedef void transform(values *out, const values *in);

/* The first `count` lanes, fewer than a vector has: copies of fixed sizes become instructions. */
INLINE void copy_lanes(void *to, const void *from, int64_t count)
{
    char *out = to;
    const char *in = from;
#pragma GCC unroll 4
    for (size_t lanes = LANES / 2; lanes > 0; lanes /= 2) {
        if ((size_t)count & lanes) {
            size_t bytes = lanes * sizeof(float);
            memcpy(out, in, bytes);
            out += bytes;
            in += bytes;
        }
    }
}

#ifdef STREAM
enum { STREAMS = 1 };
#else
enum { STREAMS = 0 };
#define STREAM(to, vector) (*(values *)(to) = (vector))
#endif

/* Do whole vectors, of a cache's line each, begin where lines do? */
INLINE int fills_lines(const float *out, int64_t out_step)
{
    return STREAMS && out_step % LANES == 0 && (uintptr_t)out % sizeof(values) == 0;
}

/* The last vector may be filled in part. `past`: whole vectors go past the caches, which hold far
 * less than is written before it is read. */
INLINE void along(transform *apply, float *out, int64_t out_step, int outs, const float *in,
                  int64_t in_step, int ins, int64_t count, int past)
{
    values x[WINOGRAD_VALUES], y[WINOGRAD_VALUES];
    int64_t t = 0;
    for (; t + LANES <= count; t += LANES) {
#pragma GCC unroll 36
        for (int i = 0; i < ins; i++) {
            x[i] = *(const values *)(in + i * in_step + t);
        }
        apply(y, x);
#pragma GCC unroll 36
        for (int i = 0; i < outs; i++) {
            if (past) {
                STREAM(out + i * out_step + t, y[i]);
            } else {
                *(values *)(out + i * out_step + t) = y[i];
            }
        }
    }
    if (t == count) {
        return;
    }
    for (int i = 0; i < ins; i++) {
        x[i] = (values){0};
        copy_lanes(&x[i], in + i * in_step + t, count - t);
    }
    apply(y, x);
    for (int i = 0; i < outs; i++) {
        copy_lanes(out + i * out_step + t, &y[i], count - t);
    }
}

#define AXIS(name, apply, outs, ins)                                                               \
    TARGET static void name(float *out, int64_t out_step, const float *in, int64_t in_step,        \
                            int64_t count)                                                         \
    {                                                                                              \
        along(apply, out, out_step, outs, in, in_step, ins, count, 0);                             \
    }

/* What is read only after all of a layer's, or of all layers', is written: behind the barrier of an
 * OpenMP loop, which ends with a locked instruction and so with such stores seen by all. */
#define AXIS_PAST(name, apply, outs, ins)                                                          \
    TARGET static void name(float *out, int64_t out_step, const float *in, int64_t in_step,        \
                            int64_t count)                                                         \
    {                                                                                              \
        if (fills_lines(out, out_step)) {                                                          \
            along(apply, out, out_step, outs, in, in_step, ins, count, 1);                         \
        } else {                                                                                   \
            along(apply, out, out_step, outs, in, in_step, ins, count, 0);                         \
        }                                                                                          \
    }

AXIS(along_input, input, WINOGRAD_POINTS, WINOGRAD_POINTS)
AXIS_PAST(input_past, input, WINOGRAD_POINTS, WINOGRAD_POINTS)
AXIS(along_input_turned, input_turned, WINOGRAD_POINTS, WINOGRAD_POINTS)
AXIS(along_output, output, WINOGRAD_TILE, WINOGRAD_POINTS)
AXIS(along_output_turned, output_turned, WINOGRAD_POINTS, WINOGRAD_TILE)
AXIS_PAST(output_turned_past, output_turned, WINOGRAD_POINTS, WINOGRAD_TILE)
AXIS_PAST(both_weights, filter, WINOGRAD_VALUES, 9)
AXIS(both_weights_turned, filter_turned, 9, WINOGRAD_VALUES)

const struct winograd_kernel WINOGRAD_KERNEL = {.input = along_input,
                                                .input_past = input_past,
                                                .input_turned = along_input_turned,
                                                .output = along_output,
                                                .output_turned = along_output_turned,
                                                .output_turned_past = output_turned_past,
                                                .weights = both_weights,
                                                .weights_turned = both_weights_turned};
