#include "v2v3d/op/resample.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/status.h"
#include <string.h>

/** Larger, or NaN: a NaN must be seen downstream, and stays. */
static inline int beats(float challenger, float best)
{
    return best == best && !(challenger <= best);
}

V2V_SIMD_CLONES
static void maxpool2_row(float *out, uint8_t *which, const float *top, const float *bottom,
                         int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        float candidates[] = {top[2 * x], top[2 * x + 1], bottom[2 * x], bottom[2 * x + 1]};
        int place = 0;
        for (int i = 1; i < 4; i++) {
            place = beats(candidates[i], candidates[place]) ? i : place;
        }
        out[x] = candidates[place];
        if (which != NULL) {
            which[x] = (uint8_t)place;
        }
    }
}

void v2v_maxpool2_forward(float *out, uint8_t *which, const float *in, int64_t planes,
                          int64_t height, int64_t width)
{
    int64_t rows = height / 2, columns = width / 2;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < rows; y++) {
            const float *top = in + (c * height + 2 * y) * width;
            int64_t to = (c * rows + y) * columns;
            maxpool2_row(out + to, which == NULL ? NULL : which + to, top, top + width, columns);
        }
    }
}

/** Row y % 2 of the windows of one row of dout; an odd column belongs to none. */
static void maxpool2_backward_row(float *din, const float *dout, const uint8_t *which,
                                  int64_t width, int row)
{
    for (int64_t x = 0; x < width / 2; x++) {
        din[2 * x] = which[x] == 2 * row ? dout[x] : 0.0f;
        din[2 * x + 1] = which[x] == 2 * row + 1 ? dout[x] : 0.0f;
    }
    if (width % 2 != 0) {
        din[width - 1] = 0.0f;
    }
}

void v2v_maxpool2_backward(float *din, const float *dout, const uint8_t *which, int64_t planes,
                           int64_t height, int64_t width)
{
    int64_t rows = height / 2, columns = width / 2;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < height; y++) {
            float *to = din + (c * height + y) * width;
            int64_t from = (c * rows + y / 2) * columns;
            if (y / 2 < rows) {
                maxpool2_backward_row(to, dout + from, which + from, width, (int)(y % 2));
            } else {
                memset(to, 0, (size_t)width * sizeof *to);
            }
        }
    }
}

/** Columns of the input that are added up at a time: they lie on the stack. */
enum { RUN = 1024 };

/** Mean over `factor` rows of `count` columns. */
static inline __attribute__((always_inline)) void
average_run(float *out, const float *in, int64_t stride, int64_t count, int factor)
{
    float sums[RUN];
    memcpy(sums, in, (size_t)count * sizeof *sums);
    for (int k = 1; k < factor; k++) {
#pragma omp simd
        for (int64_t x = 0; x < count; x++) {
            sums[x] += in[k * stride + x];
        }
    }
    float share = 1.0f / (float)(factor * factor);
#pragma omp simd
    for (int64_t x = 0; x < count / factor; x++) {
        float sum = 0.0f;
        for (int l = 0; l < factor; l++) {
            sum += sums[x * factor + l];
        }
        out[x] = sum * share;
    }
}

/** The encoder's factors are known to the compiler: it turns neighbours into vectors. */
V2V_SIMD_CLONES
static void average_row(float *out, const float *in, int64_t stride, int64_t count, int factor)
{
    if (factor == 2) {
        average_run(out, in, stride, count, 2);
    } else if (factor == 4) {
        average_run(out, in, stride, count, 4);
    } else if (factor == 8) {
        average_run(out, in, stride, count, 8);
    } else {
        average_run(out, in, stride, count, factor);
    }
}

/** One row of the means, of rows `stride` apart, in runs that the stack holds. */
static void average_rows(float *out, const float *in, int64_t stride, int64_t columns, int factor)
{
    int64_t run = RUN / factor;
    for (int64_t x = 0; x < columns; x += run) {
        int64_t count = columns - x < run ? columns - x : run;
        average_row(out + x, in + x * factor, stride, count * factor, factor);
    }
}

void v2v_avgpool_forward(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                         int factor)
{
    V2V_ASSERT(factor >= 1 && factor <= RUN);
    int64_t rows = height / factor, columns = width / factor;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < rows; y++) {
            average_rows(out + (c * rows + y) * columns, in + (c * height + y * factor) * width,
                         width, columns, factor);
        }
    }
}

void v2v_avgpool_lines(float *out, const struct v2v_lines *in, int factor, int64_t first,
                       int64_t rows)
{
    V2V_ASSERT(factor >= 1 && factor <= RUN);
    V2V_ASSERT(v2v_lines_place(in, first * factor) + rows * factor <= in->held);
    int64_t height = in->height / factor, columns = in->width / factor;
    for (int64_t y = first; y < first + rows; y++) {
        const float *from = v2v_lines_at(in, y * factor);
        for (int64_t c = 0; c < in->channels; c++) {
            average_rows(out + (c * height + y) * columns, from + c * v2v_lines_stride(in),
                         in->pitch, columns, factor);
        }
    }
}

static void share_row(float *din, const float *dout, int64_t width, int factor)
{
    float share = 1.0f / (float)(factor * factor);
    int64_t columns = width / factor;
    for (int64_t x = 0; x < columns; x++) {
        float value = dout[x] * share;
        for (int l = 0; l < factor; l++) {
            din[x * factor + l] = value;
        }
    }
    memset(din + columns * factor, 0, (size_t)(width - columns * factor) * sizeof *din);
}

void v2v_avgpool_backward(float *din, const float *dout, int64_t planes, int64_t height,
                          int64_t width, int factor)
{
    int64_t rows = height / factor, columns = width / factor;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < height; y++) {
            float *to = din + (c * height + y) * width;
            if (y / factor >= rows) {
                memset(to, 0, (size_t)width * sizeof *to);
            } else if (y % factor == 0) {
                share_row(to, dout + (c * rows + y / factor) * columns, width, factor);
            } else {
                memcpy(to, to - width, (size_t)width * sizeof *to);
            }
        }
    }
}

V2V_SIMD_CLONES
static void repeat_row(float *out, const float *in, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        out[2 * x] = in[x];
        out[2 * x + 1] = in[x];
    }
}

V2V_SIMD_CLONES
static void gather_row(float *out, const float *top, const float *bottom, int64_t width)
{
#pragma omp simd
    for (int64_t x = 0; x < width; x++) {
        out[x] = (top[2 * x] + top[2 * x + 1]) + (bottom[2 * x] + bottom[2 * x + 1]);
    }
}

void v2v_nearest2_forward(float *out, const float *in, int64_t planes, int64_t height,
                          int64_t width)
{
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < planes * height; row++) {
        float *to = out + row * 4 * width;
        repeat_row(to, in + row * width, width);
        memcpy(to + 2 * width, to, (size_t)(2 * width) * sizeof *to);
    }
}

void v2v_nearest2_backward(float *din, const float *dout, int64_t planes, int64_t height,
                           int64_t width)
{
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < planes * height; row++) {
        const float *from = dout + row * 4 * width;
        gather_row(din + row * width, from, from + 2 * width, width);
    }
}
