#include "method/brightness.h"

#include "v2v3d/base/memory.h"

#include <math.h>
#include <stdlib.h>

enum { SIDE = 8, LEAST_PIECES = 16 };

/* Standard deviations of its noise that a piece's light in both frames together is above: below, a
 * ratio is noise, which would pull the median towards 0. */
static const double least_light = 8.0;

/* Beyond this factor or its inverse, one of the frames is dark: it is another scene. */
static const double most = 4.0;

int64_t v2v_brightness_pieces(int64_t views, int64_t height, int64_t width)
{
    return v2v_mem_product(views, height / SIDE, width / SIDE);
}

static double sum_of_piece(const float *from, int64_t width)
{
    double sum = 0.0;
    for (int64_t i = 0; i < SIDE * SIDE; i++) {
        sum += (double)from[i / SIDE * width + i % SIDE];
    }
    return sum;
}

static int by_ratio(const void *a, const void *b)
{
    const struct v2v_ratio *left = a, *right = b;
    return (left->ratio > right->ratio) - (left->ratio < right->ratio);
}

/* Of ratios in their order. */
static double median_of(const struct v2v_ratio *ratios, int64_t count)
{
    double all = 0.0, below = 0.0;
    int64_t i = -1;
    for (int64_t k = 0; k < count; k++) {
        all += (double)ratios[k].light;
    }
    while (2.0 * below < all) {
        below += (double)ratios[++i].light;
    }
    return (double)ratios[i].ratio;
}

double v2v_brightness_factor(struct v2v_ratio *scratch, const float *frame, const float *neighbour,
                             int64_t views, int64_t height, int64_t width, double sigma)
{
    const int64_t rows = height / SIDE, columns = width / SIDE;
    const double least = least_light * sqrt(2.0) * SIDE * sigma;
    int64_t count = 0;
#pragma omp parallel for schedule(static)
    for (int64_t k = 0; k < views * rows * columns; k++) {
        const int64_t v = k / (rows * columns), row = k / columns % rows, column = k % columns;
        const int64_t at = (v * height + row * SIDE) * width + column * SIDE;
        const double here = sum_of_piece(frame + at, width);
        const double there = sum_of_piece(neighbour + at, width);
        const int is_bright = here + there > least && here + there < INFINITY;
        scratch[k] = (struct v2v_ratio){(float)(there > 0.0 ? here / there : (double)INFINITY),
                                        is_bright ? (float)(here + there) : 0.0f};
    }
    for (int64_t k = 0; k < views * rows * columns; k++) {
        if (scratch[k].light > 0.0f) {
            scratch[count++] = scratch[k];
        }
    }
    if (count < LEAST_PIECES) {
        return 1.0;
    }
    qsort(scratch, (size_t)count, sizeof *scratch, by_ratio);
    const double factor = median_of(scratch, count);
    return factor <= most && factor >= 1.0 / most ? factor : 1.0;
}
