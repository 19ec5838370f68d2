#include "v2v3d/op/resample.h"
#include "op/simd.h"
#include <string.h>

/** The larger of two, or the NaN of either: a NaN must be seen downstream. */
static inline int beats(float challenger, float best)
{
    return challenger > best || challenger != challenger;
}

V2V_SIMD_CLONES
static void maxpool2_row(float *out, uint8_t *which, const float *top, const float *bottom,
                         int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        float candidates[] = {top[2 * x], top[2 * x + 1], bottom[2 * x], bottom[2 * x + 1]};
        int place = 0;
        for (int i = 1; i < 4; i++) {
            place =
                candidates[place] == candidates[place] && beats(candidates[i], candidates[place])
                    ? i
                    : place;
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

void v2v_maxpool2_backward(float *din, const float *dout, const uint8_t *which, int64_t planes,
                           int64_t height, int64_t width)
{
    int64_t rows = height / 2, columns = width / 2;
#pragma omp parallel for schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        float *plane = din + c * height * width;
        memset(plane, 0, (size_t)(height * width) * sizeof *plane);
        for (int64_t y = 0; y < rows; y++) {
            for (int64_t x = 0; x < columns; x++) {
                int64_t from = (c * rows + y) * columns + x;
                int place = which[from];
                plane[(2 * y + place / 2) * width + 2 * x + place % 2] = dout[from];
            }
        }
    }
}

void v2v_avgpool_forward(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                         int factor)
{
    int64_t rows = height / factor, columns = width / factor;
    float share = 1.0f / (float)(factor * factor);
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < rows; y++) {
            const float *block = in + (c * height + y * factor) * width;
            for (int64_t x = 0; x < columns; x++) {
                float sum = 0.0f;
                for (int k = 0; k < factor; k++) {
                    for (int l = 0; l < factor; l++) {
                        sum += block[k * width + x * factor + l];
                    }
                }
                out[(c * rows + y) * columns + x] = sum * share;
            }
        }
    }
}

void v2v_avgpool_backward(float *din, const float *dout, int64_t planes, int64_t height,
                          int64_t width, int factor)
{
    int64_t rows = height / factor, columns = width / factor;
    float share = 1.0f / (float)(factor * factor);
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t c = 0; c < planes; c++) {
        for (int64_t y = 0; y < height; y++) {
            float *row = din + (c * height + y) * width;
            memset(row, 0, (size_t)width * sizeof *row);
            if (y / factor >= rows) {
                continue;
            }
            const float *from = dout + (c * rows + y / factor) * columns;
            for (int64_t x = 0; x < columns; x++) {
                for (int l = 0; l < factor; l++) {
                    row[x * factor + l] = from[x] * share;
                }
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
