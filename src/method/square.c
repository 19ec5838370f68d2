#include "method/square.h"

#include "v2v3d/base/bounds.h"

#include <string.h>

enum { STEP = 16 };

/* Sum of squares about the mean. */
static double variation_of(const float *image, int64_t width, const struct v2v_square *square)
{
    const int64_t across = square->columns.count, count = square->rows.count * across;
    double sum = 0.0, squares = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const int64_t y = square->rows.first + i / across, x = square->columns.first + i % across;
        const double p = (double)image[y * width + x];
        sum += p;
        squares += p * p;
    }
    return squares - sum * sum / (double)count;
}

struct v2v_square v2v_square_find(const float *image, int64_t width, struct v2v_part rows,
                                  struct v2v_part columns, int64_t side)
{
    struct v2v_square best = {{rows.first, v2v_smaller(side, rows.count)},
                              {columns.first, v2v_smaller(side, columns.count)}};
    const int64_t last_top = rows.first + rows.count - best.rows.count;
    const int64_t last_left = columns.first + columns.count - best.columns.count;
    double most = -1.0;
    for (int64_t top = rows.first; top <= last_top; top += STEP) {
        for (int64_t left = columns.first; left <= last_left; left += STEP) {
            const struct v2v_square here = {{top, best.rows.count}, {left, best.columns.count}};
            const double variation = variation_of(image, width, &here);
            if (variation > most) {
                most = variation;
                best = here;
            }
        }
    }
    return best;
}

struct v2v_square v2v_square_of_image(const float *image, int64_t height, int64_t width,
                                      int64_t side)
{
    return v2v_square_find(image, width, (struct v2v_part){0, height}, (struct v2v_part){0, width},
                           side);
}

void v2v_square_cut(const struct v2v_square *square, float *to, const float *images, int64_t count,
                    int64_t height, int64_t width)
{
    const int64_t rows = square->rows.count, columns = square->columns.count;
    for (int64_t row = 0; row < count * rows; row++) {
        const int64_t y = row / rows * height + square->rows.first + row % rows;
        memcpy(to + row * columns, images + y * width + square->columns.first,
               (size_t)columns * sizeof *to);
    }
}
