#include "v2v3d/tensor/warp.h"

#include "v2v3d/base/bounds.h"

#include <math.h>
#include <string.h>

enum { TAPS = 4 };

/* Weights of the pixels -1, 0, 1, 2 for a place at t, 0 .. 1, between 0 and 1. */
static void cubic(double weight[TAPS], double t)
{
    weight[0] = t * (-0.5 + t * (1.0 - 0.5 * t));
    weight[1] = 1.0 + t * t * (-2.5 + 1.5 * t);
    weight[2] = t * (0.5 + t * (2.0 - 1.5 * t));
    weight[3] = t * t * (-0.5 + 0.5 * t);
}

static double sample(const float *image, int64_t height, int64_t width, double y, double x)
{
    const double top = floor(y), left = floor(x);
    const int64_t y0 = (int64_t)top, x0 = (int64_t)left;
    double along_y[TAPS], along_x[TAPS], sum = 0.0;
    cubic(along_y, y - top);
    cubic(along_x, x - left);
    for (int i = 0; i < TAPS; i++) {
        const float *row = image + v2v_within(y0 - 1 + i, 0, height - 1) * width;
        double of_row = 0.0;
        for (int j = 0; j < TAPS; j++) {
            of_row += along_x[j] * (double)row[v2v_within(x0 - 1 + j, 0, width - 1)];
        }
        sum += along_y[i] * of_row;
    }
    return sum;
}

void v2v_warp_image(float *to, const float *from, int64_t height, int64_t width,
                    const double field_y[V2V_FIELD_TERMS], const double field_x[V2V_FIELD_TERMS],
                    double sign)
{
    if (v2v_field_is_zero(field_y) && v2v_field_is_zero(field_x)) {
        memcpy(to, from, (size_t)(height * width) * sizeof *to);
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) {
            double terms[V2V_FIELD_TERMS];
            v2v_field_terms(terms, v2v_field_place(y, height), v2v_field_place(x, width));
            to[y * width + x] = (float)sample(from, height, width,
                                              (double)y + sign * v2v_field_value(field_y, terms),
                                              (double)x + sign * v2v_field_value(field_x, terms));
        }
    }
}

void v2v_shade_image(float *image, int64_t height, int64_t width,
                     const double field[V2V_FIELD_TERMS], double sign)
{
    if (v2v_field_is_zero(field)) {
        return;
    }
#pragma omp parallel for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) {
            double terms[V2V_FIELD_TERMS];
            v2v_field_terms(terms, v2v_field_place(y, height), v2v_field_place(x, width));
            const double factor = exp(sign * v2v_field_value(field, terms));
            image[y * width + x] = (float)(factor * (double)image[y * width + x]);
        }
    }
}
