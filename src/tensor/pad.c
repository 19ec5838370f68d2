#include "v2v3d/tensor/pad.h"

#include <string.h>

/* Index i of a row of n pixels that goes on in its mirror image. */
static int64_t mirrored(int64_t i, int64_t n)
{
    if (n == 1) {
        return 0;
    }
    int64_t period = 2 * (n - 1), at = i % period;
    return at < n ? at : period - at;
}

void v2v_pad_reflect(float *out, const float *in, int64_t planes, int64_t height, int64_t width,
                     int64_t padded_height, int64_t padded_width)
{
    for (int64_t row = 0; row < planes * padded_height; row++) {
        int64_t y = mirrored(row % padded_height, height);
        const float *from = in + (row / padded_height * height + y) * width;
        float *to = out + row * padded_width;
        memcpy(to, from, (size_t)width * sizeof *to);
        for (int64_t x = width; x < padded_width; x++) {
            to[x] = from[mirrored(x, width)];
        }
    }
}
