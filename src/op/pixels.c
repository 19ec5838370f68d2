#include "op/pixels.h"

#include "op/winograd_kernel.h"
#include "v2v3d/base/clones.h"

V2V_SIMD_CLONES
void v2v_pixels_split(float *restrict phase, int64_t step, const float *restrict line,
                      int64_t count)
{
    for (int64_t t = 0; t < count; t++) {
        for (int j = 0; j < WINOGRAD_TILE; j++) {
            phase[j * step + t] = line[t * WINOGRAD_TILE + j];
        }
    }
}

V2V_SIMD_CLONES
void v2v_pixels_join(float *restrict line, const float *restrict phase, int64_t step, int64_t count)
{
    for (int64_t t = 0; t < count; t++) {
        for (int j = 0; j < WINOGRAD_TILE; j++) {
            line[t * WINOGRAD_TILE + j] = phase[j * step + t];
        }
    }
}

/* Every pixel twice, whole pairs, and the adjoint. */
V2V_SIMD_CLONES
static void repeat(float *restrict line, const float *restrict row, int64_t count)
{
    for (int64_t k = 0; k < count; k++) {
        line[2 * k] = line[2 * k + 1] = row[k];
    }
}

V2V_SIMD_CLONES
static void add_pairs(float *restrict row, const float *restrict line, int64_t count)
{
    for (int64_t k = 0; k < count; k++) {
        row[k] += line[2 * k] + line[2 * k + 1];
    }
}

V2V_SIMD_CLONES
void v2v_pixels_add(float *restrict row, const float *restrict line, int64_t count)
{
    for (int64_t x = 0; x < count; x++) {
        row[x] += line[x];
    }
}

/* The first and the last may stand alone. */
void v2v_pixels_repeat(float *line, const float *row, int64_t x0, int64_t x1)
{
    if (x0 < x1 && x0 % 2 != 0) {
        *line++ = row[x0++ >> 1];
    }
    repeat(line, row + (x0 >> 1), (x1 - x0) >> 1);
    if (x0 < x1 && x1 % 2 != 0) {
        line[x1 - 1 - x0] = row[x1 >> 1];
    }
}

void v2v_pixels_repeat_turned(float *row, const float *line, int64_t x0, int64_t x1)
{
    if (x0 < x1 && x0 % 2 != 0) {
        row[x0++ >> 1] += *line++;
    }
    add_pairs(row + (x0 >> 1), line, (x1 - x0) >> 1);
    if (x0 < x1 && x1 % 2 != 0) {
        row[x1 >> 1] += line[x1 - 1 - x0];
    }
}

V2V_SIMD_CLONES
void v2v_pixels_activate(float *restrict line, int64_t count, float bias, float slope)
{
    for (int64_t x = 0; x < count; x++) {
        float value = line[x] + bias;
        line[x] = value > 0.0f ? value : slope * value;
    }
}

V2V_SIMD_CLONES
void v2v_pixels_activate_turned(float *din, const float *dout, const float *y, int64_t count,
                                float slope)
{
#pragma omp simd
    for (int64_t x = 0; x < count; x++) {
        din[x] = y[x] > 0.0f ? dout[x] : slope * dout[x];
    }
}

V2V_SIMD_CLONES
double v2v_pixels_sum(const float *plane, int64_t rows, int64_t columns)
{
    double sum = 0.0;
    for (int64_t y = 0; y < rows; y++) {
        const float *row = plane + y * columns;
        float part = 0.0f;
#pragma omp simd reduction(+ : part)
        for (int64_t x = 0; x < columns; x++) {
            part += row[x];
        }
        sum += (double)part;
    }
    return sum;
}

void v2v_pixels_drop_odd(float *line, int64_t count)
{
    for (int64_t x = 0; 2 * x < count; x++) {
        line[x] = line[2 * x];
    }
}

void v2v_pixels_spread(float *line, const float *row, int64_t count)
{
    for (int64_t x = 0; x < count; x++) {
        line[2 * x] = row[x];
        line[2 * x + 1] = 0.0f;
    }
}
