#include "eval/uncertainty.h"

#include "v2v3d/base/bounds.h"

#include <math.h>

enum { RADIUS = 2 };

/* Mean of in[first] .. over what of the window lies within n elements, `stride` apart. */
static float window_mean(const float *in, int64_t at, int64_t n, int64_t stride)
{
    const int64_t first = v2v_larger(0, at - RADIUS), end = v2v_smaller(n, at + RADIUS + 1);
    double sum = 0.0;
    for (int64_t i = first; i < end; i++) {
        sum += (double)in[i * stride];
    }
    return (float)(sum / (double)(end - first));
}

/* A power of two near the largest error or bias; squares over it stay within float32. */
static float unit_of(const float *a, const float *b, const float *c, int64_t count)
{
    float largest = 0.0f;
    for (int64_t i = 0; i < count; i++) {
        const float one = 0.5f * a[i], other = 0.5f * b[i];
        largest = fmaxf(largest, fmaxf(fabsf(one - other), fabsf(c[i] - (one + other))));
    }
    return largest > 0.0f && isfinite(largest) ? exp2f((float)ilogbf(largest)) : 1.0f;
}

void v2v_uncertainty_of(float *a, const float *b, const float *c, float *scratch, int64_t slices,
                        int64_t height, int64_t width)
{
    const float unit = unit_of(a, b, c, slices * height * width);
    for (int64_t z = 0; z < slices; z++) {
        const int64_t first = z * height * width;
        float *map = a + first;
        for (int64_t i = 0; i < height * width; i++) {
            const float one = 0.5f * map[i], other = 0.5f * b[first + i];
            const float error = (one - other) / unit;
            const float bias = (c[first + i] - (one + other)) / unit;
            map[i] = error * error + bias * bias;
        }
        for (int64_t i = 0; i < height * width; i++) {
            scratch[i] = window_mean(map + i / width * width, i % width, width, 1);
        }
        for (int64_t i = 0; i < height * width; i++) {
            map[i] = unit * sqrtf(window_mean(scratch + i % width, i / width, height, width));
        }
    }
}
