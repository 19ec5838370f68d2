#include "v2v3d/tensor/coarse.h"

#include "v2v3d/base/bounds.h"

#include <math.h>

/* Of an image's pixels from (y, x) on. */
static float mean_of_square(const float *image, int64_t height, int64_t width, int64_t y, int64_t x,
                            int64_t side)
{
    const int64_t rows = v2v_smaller(side, height - y), columns = v2v_smaller(side, width - x);
    float sum = 0.0f;
    for (int64_t i = 0; i < rows; i++) {
        const float *row = image + (y + i) * width + x;
        for (int64_t j = 0; j < columns; j++) {
            sum += fabsf(row[j]) < INFINITY ? row[j] : 0.0f;
        }
    }
    return sum / (float)(rows * columns);
}

void v2v_coarse_images(float *to, const float *from, int64_t count, int64_t height, int64_t width,
                       int64_t side, float scale)
{
    const int64_t rows = v2v_parts(height, side), columns = v2v_parts(width, side);
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t k = 0; k < count; k++) {
        for (int64_t y = 0; y < rows; y++) {
            const float *image = from + k * height * width;
            float *row = to + (k * rows + y) * columns;
            for (int64_t x = 0; x < columns; x++) {
                row[x] = scale * mean_of_square(image, height, width, y * side, x * side, side);
            }
        }
    }
}

/* Along a line. */
static void soften(float *line, int64_t count, int64_t stride)
{
    float before = line[0];
    for (int64_t i = 0; i < count; i++) {
        const float here = line[i * stride];
        const float behind = line[v2v_smaller(i + 1, count - 1) * stride];
        line[i * stride] = 0.25f * (before + 2.0f * here + behind);
        before = here;
    }
}

void v2v_soften_images(float *images, int64_t count, int64_t height, int64_t width)
{
#pragma omp parallel for schedule(static)
    for (int64_t k = 0; k < count; k++) {
        float *image = images + k * height * width;
        for (int64_t y = 0; y < height; y++) {
            soften(image + y * width, width, 1);
        }
        for (int64_t x = 0; x < width; x++) {
            soften(image + x, height, width);
        }
    }
}
