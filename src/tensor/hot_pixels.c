#include "v2v3d/tensor/hot_pixels.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* PSFs are sampled where they happen to lie: elsewhere between pixels points may be sharper. */
static const double between_pixels = 2.0;

/* Of the light of the frame, and of its noise. */
static const double least_part = 0.5, least_noises = 8.0;

enum { NEIGHBOURS = 8, OF_BRIGHT = 1000 };

struct level {
    double base, least; /* a hot pixel is brighter than their sum, at least */
};

static int64_t sample(float *to, const float *from, int64_t count)
{
    const int64_t step = count / V2V_HOT_PIXELS_SCRATCH + 1;
    int64_t n = 0;
    for (int64_t i = 0; i < count; i += step) {
        to[n++] = from[i];
    }
    return n;
}

/* By 2 x 2 neighbours at the places of the samples. */
static double noise_of(float *scratch, const float *images, int64_t count, int64_t height,
                       int64_t width)
{
    const int64_t samples = count * height * width, step = samples / V2V_HOT_PIXELS_SCRATCH + 1;
    int64_t n = 0;
    for (int64_t i = 0; i < samples; i += step) {
        if (i % width < width - 1 && i / width % height < height - 1) {
            const float *a = images + i, *b = a + width;
            scratch[n++] = fabsf((a[0] - a[1]) - (b[0] - b[1]));
        }
    }
    return n > 0 ? v2v_noise_of_differences(scratch, n) : 0.0;
}

/* The least step above the base: of few photons, which most pixels have none of, one. */
static double quantum_of(const float *samples, int64_t count, double base)
{
    double least = INFINITY;
    for (int64_t i = 0; i < count; i++) {
        const double step = (double)samples[i] - base;
        least = step > 0.0 && step < least ? step : least;
    }
    return isfinite(least) ? least : 0.0;
}

static struct level level_of(float *scratch, const float *images, int64_t count, int64_t height,
                             int64_t width)
{
    double noise = noise_of(scratch, images, count, height, width);
    const int64_t n = sample(scratch, images, count * height * width);
    const double bright = (double)v2v_select(scratch, n, n - 1 - n / OF_BRIGHT);
    const double base = (double)v2v_select(scratch, n, n / 2);
    noise = noise > 0.0 ? noise : quantum_of(scratch, n, base);
    return (struct level){base, bright > base ? least_part * (bright - base) + least_noises * noise
                                              : INFINITY};
}

/* Ascending. @return how many there are */
static int neighbours_of(float sorted[NEIGHBOURS], const float *image, int64_t y, int64_t x,
                         int64_t height, int64_t width)
{
    int n = 0;
    for (int64_t j = v2v_larger(y - 1, 0); j <= v2v_smaller(y + 1, height - 1); j++) {
        for (int64_t i = v2v_larger(x - 1, 0); i <= v2v_smaller(x + 1, width - 1); i++) {
            const float value = image[j * width + i];
            int at = n;
            if (j == y && i == x) {
                continue;
            }
            for (; at > 0 && sorted[at - 1] > value; at--) {
                sorted[at] = sorted[at - 1];
            }
            sorted[at] = value;
            n++;
        }
    }
    return n;
}

static double sum_above(const float *x, int count, double base)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        sum += (double)x[i] - base;
    }
    return sum;
}

double v2v_sharpness_of_image(const float *image, int64_t height, int64_t width)
{
    const double least_of_brightest = 0.1;
    float brightest = 0.0f;
    double most = 0.0;
    for (int64_t i = 0; i < height * width; i++) {
        brightest = image[i] > brightest ? image[i] : brightest;
    }
    for (int64_t i = 0; i < height * width; i++) {
        float around[NEIGHBOURS];
        if (image[i] > 0.0f && (double)image[i] >= least_of_brightest * (double)brightest) {
            const int n = neighbours_of(around, image, i / width, i % width, height, width);
            const double sum = sum_above(around, n, 0.0);
            most = fmax(most, sum > 0.0 ? (double)image[i] / sum : INFINITY);
        }
    }
    return most;
}

static int mend(float *image, int64_t y, int64_t x, int64_t height, int64_t width, double sharpness,
                const struct level *level)
{
    float *here = image + y * width + x, sorted[NEIGHBOURS];
    const int n = neighbours_of(sorted, image, y, x, height, width);
    if (n == 0) {
        return 0;
    }
    const double sum = fmax(sum_above(sorted, n, level->base), 0.0);
    const double made = between_pixels * sharpness * sum * NEIGHBOURS / n;
    if (!((double)*here - level->base - made > level->least)) {
        return 0;
    }
    *here = 0.5f * (sorted[(n - 1) / 2] + sorted[n / 2]);
    return 1;
}

int64_t v2v_hot_pixels_mend(float *images, float *scratch, int64_t count, int64_t height,
                            int64_t width, double sharpness)
{
    int64_t hot = 0;
    const struct level level = level_of(scratch, images, count, height, width);
    if (!isfinite(sharpness) || !isfinite(level.least)) {
        return 0;
    }
    const float least = (float)(level.base + level.least);
    for (int64_t i = 0; i < count * height * width; i++) {
        if (images[i] > least) {
            float *image = images + i / (height * width) * height * width;
            hot += mend(image, i / width % height, i % width, height, width, sharpness, &level);
        }
    }
    return hot;
}
