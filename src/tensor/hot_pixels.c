#include "v2v3d/tensor/hot_pixels.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* PSFs are sampled where they happen to lie: elsewhere between pixels points may be sharper. */
static const double between_pixels = 2.0;

/* Of the light of the frame, and of its noise. */
static const double least_part = 0.5, least_noises = 8.0;

/* Of what a cold pixel is below the dark: those that touch it and are that far below belong to it,
 * and are twice that far below if they are cold. */
static const double as_far = 0.25;

/* Pixels of one part: fewer than see nothing together. */
enum { MOST_COLD = 31 };

/* Of the light of the frame that a cold pixel is below its dark: more than what numbers are rounded
 * to, and what goes below zero where distortion is undone. */
static const double least_light = 1e-3;

/* One sample in so many is brighter than the bright level, one darker than the dark. */
enum { NEIGHBOURS = 8, OF_BRIGHT = 1000, OF_DARK = 100 };

struct level {
    double base, least;  /* a hot pixel is brighter than their sum, at least; INFINITY: none is */
    double dark, margin; /* a cold one darker than their difference */
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
    const double dark = (double)v2v_select(scratch, n, n / OF_DARK);
    const double base = (double)v2v_select(scratch, n, n / 2);
    noise = noise > 0.0 ? noise : quantum_of(scratch, n, base);
    return (struct level){
        .base = base,
        .least = bright > base ? least_part * (bright - base) + least_noises * noise : INFINITY,
        .dark = dark,
        .margin = least_part * (base - dark) + least_noises * noise +
                  least_light * fmax(bright - base, 0.0)};
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

/* @return whether it was hot */
static int mend_hot(float *image, int64_t place, int64_t height, int64_t width, double sharpness,
                    const struct level *level)
{
    float sorted[NEIGHBOURS];
    const int n = neighbours_of(sorted, image, place / width, place % width, height, width);
    if (n == 0) {
        return 0;
    }
    const double sum = fmax(sum_above(sorted, n, level->base), 0.0);
    const double made = between_pixels * sharpness * sum * NEIGHBOURS / n;
    if (!((double)image[place] - level->base - made > level->least)) {
        return 0;
    }
    image[place] = 0.5f * (sorted[(n - 1) / 2] + sorted[n / 2]);
    return 1;
}

/* Cold pixels that touch each other: the first, and others. */
struct part {
    int64_t place[MOST_COLD];
    int count;
};

static int has(const struct part *part, int64_t place)
{
    int k = 0;
    while (k < part->count && part->place[k] != place) {
        k++;
    }
    return k < part->count;
}

/* All that are below `least`. @return bool: it has room for them
 * @param around [NEIGHBOURS * MOST_COLD]: the `others` that touch it, some more than once */
static int grow(struct part *part, float *around, int64_t *others, const float *image,
                int64_t height, int64_t width, double least)
{
    *others = 0;
    for (int k = 0; k < part->count; k++) {
        const int64_t y = part->place[k] / width, x = part->place[k] % width;
        for (int64_t j = v2v_larger(y - 1, 0); j <= v2v_smaller(y + 1, height - 1); j++) {
            for (int64_t i = v2v_larger(x - 1, 0); i <= v2v_smaller(x + 1, width - 1); i++) {
                const int64_t place = j * width + i;
                if (!((double)image[place] < least)) {
                    around[(*others)++] = image[place];
                } else if (!has(part, place)) {
                    if (part->count == MOST_COLD) {
                        return 0;
                    }
                    part->place[part->count++] = place;
                }
            }
        }
    }
    return 1;
}

/* A cold pixel with those that touch it, where they are few, as rows and parts that see nothing
 * are not (tensor/blind.h), and all far below what is around, as a hole in light is not.
 * @return how many */
static int64_t mend_cold(float *image, int64_t place, int64_t height, int64_t width,
                         const struct level *level)
{
    struct part part = {.place = {place}, .count = 1};
    float around[NEIGHBOURS * MOST_COLD];
    int64_t others = 0;
    const double below = level->dark - (double)image[place];
    if (!grow(&part, around, &others, image, height, width, level->dark - as_far * below) ||
        others == 0) {
        return 0;
    }
    for (int k = 0; k < part.count; k++) {
        if (level->dark - (double)image[part.place[k]] < 2.0 * as_far * below) {
            return 0;
        }
    }
    const float median = v2v_select(around, others, others / 2);
    for (int k = 0; k < part.count; k++) {
        image[part.place[k]] = median;
    }
    return part.count;
}

struct v2v_mended v2v_hot_pixels_mend(float *images, float *scratch, int64_t count, int64_t height,
                                      int64_t width, double sharpness)
{
    struct v2v_mended mended = {0, 0};
    const struct level level = level_of(scratch, images, count, height, width);
    const float brightest = isfinite(sharpness) ? (float)(level.base + level.least) : INFINITY;
    const float darkest = (float)(level.dark - level.margin);
    const int64_t pixels = height * width;
    for (int64_t i = 0; i < count * pixels; i++) {
        float *image = images + i / pixels * pixels;
        if (images[i] < darkest) {
            mended.cold += mend_cold(image, i % pixels, height, width, &level);
        }
    }
    for (int64_t i = 0; i < count * pixels; i++) { /* then: beside cold pixels light seems hot */
        float *image = images + i / pixels * pixels;
        if (images[i] > brightest) {
            mended.hot += mend_hot(image, i % pixels, height, width, sharpness, &level);
        }
    }
    return mended;
}
