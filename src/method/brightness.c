#include "method/brightness.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

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

/* Of the pieces of this ratio at most. */
static double light_up_to(const struct v2v_ratio *pieces, int64_t count, float ratio)
{
    double sum = 0.0;
    for (int64_t k = 0; k < count; k++) {
        sum += pieces[k].ratio <= ratio ? (double)pieces[k].light : 0.0;
    }
    return sum;
}

static float float_of(uint32_t bits)
{
    float value = 0.0f;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The least ratio, 0 at least, up to which half of the light lies. From 0 to infinity floats are in
 * the order of their bits; nothing has to be sorted. */
static float median_of(const struct v2v_ratio *pieces, int64_t count)
{
    const double half = 0.5 * light_up_to(pieces, count, INFINITY);
    uint32_t low = 0, high = 0x7f800000;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (light_up_to(pieces, count, float_of(middle)) < half) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return float_of(low);
}

double v2v_brightness_factor(struct v2v_ratio *scratch, const float *frame, const float *neighbour,
                             int64_t views, int64_t height, int64_t width, double sigma)
{
    const int64_t rows = height / SIDE, columns = width / SIDE, pieces = views * rows * columns;
    const double least = least_light * sqrt(2.0) * sigma / SIDE; /* of two means */
    int64_t bright = 0;
#pragma omp parallel for schedule(static) reduction(+ : bright)
    for (int64_t k = 0; k < pieces; k++) {
        const int64_t v = k / (rows * columns), row = k / columns % rows, column = k % columns;
        const int64_t at = (v * height + row * SIDE) * width + column * SIDE;
        const double here = v2v_mean_of_square(frame + at, width, SIDE);
        const double there = v2v_mean_of_square(neighbour + at, width, SIDE);
        const int is_bright = here + there > least && here + there < INFINITY;
        scratch[k] = (struct v2v_ratio){(float)(there > 0.0 ? here / there : (double)INFINITY),
                                        is_bright ? (float)(here + there) : 0.0f};
        bright += is_bright;
    }
    if (bright < LEAST_PIECES) {
        return 1.0;
    }
    const double factor = (double)median_of(scratch, pieces);
    return factor <= most && factor >= 1.0 / most ? factor : 1.0;
}
