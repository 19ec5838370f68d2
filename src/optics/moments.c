#include "optics/moments.h"

void v2v_slice_moments(double moment[3], const float *slice, int64_t height, int64_t width)
{
    moment[0] = moment[1] = moment[2] = 0;
    for (int64_t y = 0; y < height; y++) {
        double row = 0;
        for (int64_t x = 0; x < width; x++) {
            const double value = slice[y * width + x];
            row += value;
            moment[2] += value * (double)x;
        }
        moment[0] += row;
        moment[1] += row * (double)y;
    }
}
