#include "v2v3d/tensor/smooth.h"

#include "v2v3d/base/bounds.h"

/* Running means of a line. */
static void smooth_line(float *to, const float *from, int64_t size, int64_t stride, int radius)
{
    double sum = 0.0;
    for (int64_t i = -radius; i <= radius; i++) {
        sum += (double)from[v2v_within(i, 0, size - 1) * stride];
    }
    for (int64_t i = 0; i < size; i++) {
        to[i * stride] = (float)(sum / (2.0 * radius + 1.0));
        sum += (double)from[v2v_within(i + radius + 1, 0, size - 1) * stride] -
               (double)from[v2v_within(i - radius, 0, size - 1) * stride];
    }
}

void v2v_smooth_image(float *to, float *scratch, const float *image, int64_t height, int64_t width,
                      int radius)
{
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        smooth_line(scratch + y * width, image + y * width, width, 1, radius);
    }
#pragma omp parallel for schedule(static)
    for (int64_t x = 0; x < width; x++) {
        smooth_line(to + x, scratch + x, height, width, radius);
    }
}

/* Along a line: the weights of n pixels, taken twice, are a triangle, and their squares sum to
 * (2 n n + 1) / (3 n n n). */
double v2v_smooth_twice_count(int radius)
{
    const double n = 2.0 * radius + 1.0, of_line = 3.0 * n * n * n / (2.0 * n * n + 1.0);
    return of_line * of_line;
}
