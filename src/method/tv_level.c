#include "method/tv_level.h"

#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>

/* Views of less noise than this part of their brightness count as this noisy. */
static const double least_noise = 1e-4;

/* Of the brightest pixel, the least brightness. A deep negative one is no brightness: in steps as
 * long as that, 500 iterations left half of it as light. It raises the noise, so that float32 holds
 * it. */
static const double least_of_brightest = 1e-3;

/* The variance counts as at least this part of that in the light, so that few dark samples don't
 * outweigh all others; and what isn't of photons twice, or the dark would have more of it in the
 * volume than the light. */
static const double least_variance = 0.05, dark_twice = 2.0;

/* The mean variance is at least this part of that in the light. */
static const double least_mean = 1e-6;

/** The noise of photons, where it isn't too small; else the level stays.
 *  @param light mean of the samples @param least noise that float32 holds */
static void of_photons(struct v2v_tv_level *level, const struct v2v_photons *photons, double light,
                       double least)
{
    const double variance = photons->gain * photons->bright + photons->variance;
    const double unit = sqrt(variance);
    if (photons->gain > 0.0 && unit > least) {
        level->sigma = unit;
        level->gain = photons->gain / unit;
        level->floor = fmax(dark_twice * photons->variance / variance, least_variance);
        level->dark = sqrt(photons->variance);
        level->mean_variance =
            fmax((photons->gain * light + photons->variance) / variance, least_mean);
    }
}

/* Noise of photons is to be told from that which is the same for all samples. */
static int takes_photons(const struct v2v_tv_views *taken, int is_clear)
{
    return taken->model == V2V_NOISE_MODEL_POISSON ||
           (taken->model == V2V_NOISE_MODEL_AUTO && is_clear);
}

/* Noise of the views of a frame. */
struct noise {
    double sigma; /* if it is the same for all samples */
    struct v2v_photons photons;
    double frames; /* as in the level */
};

/* If all samples were means of so many frames, their variances would have the same sum. Noise that
 * doesn't grow with the light is the same for all. */
static double frames_of(const struct v2v_tv_views *taken, float *scratch, double bright)
{
    const struct v2v_averaging *averaging = taken->averaging;
    const int64_t samples = taken->count * taken->height * taken->width;
    const int is_of_photons =
        takes_photons(taken, averaging->is_of_photons) && averaging->gain > 0.0 && bright > 0.0;
    const double gain = is_of_photons ? averaging->gain * bright : 0.0;
    const double even = is_of_photons ? averaging->variance : 1.0;
    double sum[2] = {0.0};
    for (int is_left = 0; is_left < 2; is_left++) {
#pragma omp parallel for simd schedule(static)
        for (int64_t i = 0; i < samples; i++) {
            const double light = taken->views[i] > 0.0f ? (double)taken->views[i] : 0.0;
            const double of_photons = is_of_photons ? gain * light / bright : 0.0;
            const double variance = (of_photons + even) / (gain + even);
            const double left = is_left ? variance / (double)averaging->frames[i] : variance;
            scratch[i] = taken->views[i] == V2V_BLIND ? 0.0f : (float)left;
        }
        sum[is_left] = v2v_sum(scratch, samples);
    }
    return fmax(sum[0] / sum[1], 1.0); /* of no light, and no noise in the dark: 1 */
}

static struct noise noise_of_averages(const struct v2v_tv_views *taken, float *scratch)
{
    const int64_t samples = taken->count * taken->height * taken->width;
    const struct v2v_averaging *averaging = taken->averaging;
    struct noise noise = {.photons =
                              v2v_photons_averaged(scratch, taken->views, samples, averaging)};
    noise.frames = frames_of(taken, scratch, noise.photons.bright);
    noise.photons.gain /= noise.frames;
    noise.photons.variance /= noise.frames;
    noise.sigma = averaging->sigma / sqrt(noise.frames);
    return noise;
}

static struct noise noise_of_one(const struct v2v_tv_views *taken, float *scratch)
{
    const float *views = taken->views;
    const int64_t count = taken->count, height = taken->height, width = taken->width;
    struct noise noise = {.sigma = v2v_noise_of_images(scratch, views, count, height, width)};
    if (taken->model == V2V_NOISE_MODEL_GAUSSIAN) {
        noise.photons.bright = v2v_photons_bright(scratch, views, count * height * width);
    } else {
        noise.photons = v2v_photons_find(scratch, views, count, height, width, taken->camera);
    }
    return noise;
}

struct v2v_tv_level v2v_tv_level_of(const struct v2v_tv_views *taken, float *scratch)
{
    const float *views = taken->views;
    const int64_t samples = taken->count * taken->height * taken->width;
    float most = 0.0f, least = 0.0f;
#pragma omp parallel for simd schedule(static) reduction(max : most) reduction(min : least)
    for (int64_t i = 0; i < samples; i++) {
        most = views[i] > most ? views[i] : most;
        least = views[i] < least && views[i] != V2V_BLIND ? views[i] : least;
    }
    const double brightest = (double)most, deepest = -(double)least;
    if (brightest == 0.0) {
        return (struct v2v_tv_level){0};
    }
    const struct noise noise =
        taken->averaging != NULL ? noise_of_averages(taken, scratch) : noise_of_one(taken, scratch);
    const struct v2v_photons *photons = &noise.photons;
    const double brightness = fmax(photons->bright, least_of_brightest * brightest);
    const double noisy = fmax(brightness, least_of_brightest * fmax(brightest, deepest));
    struct v2v_tv_level level = {.brightness = brightness,
                                 .deepest = deepest / brightness,
                                 .sigma = fmax(noise.sigma, least_noise * noisy),
                                 .floor = 1.0,
                                 .mean_variance = 1.0,
                                 .frames = noise.frames};
    level.dark = level.sigma;
    if (takes_photons(taken, photons->is_clear)) {
        const int64_t seen = v2v_blind_gather_seen(scratch, views, samples);
        of_photons(&level, photons, v2v_sum(scratch, seen) / (double)seen, least_noise * noisy);
    }
    return level;
}
