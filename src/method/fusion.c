#include "v2v3d/method/fusion.h"

#include "method/brightness.h"
#include "method/local_brightness.h"
#include "method/motion.h"
#include "method/photons.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/bulk.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>
#include <string.h>

/* REFERENCE.md 12. Gaussians end at four standard deviations: 6e-5 of their weight is beyond. */
enum { FINE = 2, COARSE = 3, REACH = 4, FINE_TAPS = REACH * FINE, COARSE_TAPS = REACH * COARSE };

/* Of mean squares of a difference, which noise makes 1: from where on a neighbour weighs less. */
struct gate {
    float tolerated, steepness;
};
static const struct gate of_view = {1.5f, 2.0f};

/* Of the mean over V views, smoothed once more: three of the deviations, 0.447 / sqrt V, that noise
 * makes there. */
static struct gate of_all(int64_t views)
{
    return (struct gate){1.0f + 1.34f / sqrtf((float)views), 12.0f};
}

/* Variance of the mean over that of as many frames of their own noise, from which on frames share
 * it: structure, too, makes some difference. */
static const double least_shared = 1.5;

/* Of a pixel of frame t, in units of the variance in its light: of photons, by the level about it,
 * and what is the same everywhere. */
struct noise {
    double sigma; /* of the frame; 0: not known */
    double unit;  /* the variance in the light */
    double photons, even;
};

struct v2v_fusion {
    int64_t neighbours;
    int64_t views, height, width, pitch;
    float fine[2 * FINE_TAPS + 1], coarse[2 * COARSE_TAPS + 1];
    double smoothed; /* noise that `fine` leaves of a pixel's, as a factor on its sigma */
    struct noise noise;
    struct v2v_averaging averaging; /* no frames: what was given last is of one frame */
    struct v2v_ratio *ratios;
    struct v2v_local_brightness *brightness;
    struct v2v_motion *motion;
    float *photons;   /* [v,y,x] of frame t: this part of the variance, in the noise's unit */
    float *sum;       /* [v,y,x] of weighted views */
    float *weight;    /* [v,y,x] of weights */
    float *neighbour; /* [v,y,x] */
    float *moved;     /* [v,y,x]: a neighbour, moved onto frame t; in the end frame t itself */
    float *factor;    /* [v,y,x]: .. and what its light is multiplied with */
    float *change;    /* [v,y,x] of a neighbour: mean square of its difference */
    float *mean;      /* [y,x] of that over the views */
    float *padded;    /* [y,pitch]: rows with their ends repeated on either side */
    float *image;     /* [y,x] */
    uint8_t *blind;   /* [v,y,x] of frame t: marks */
    int leaves_blind; /* bool: those marked are left out; else they are dark */
    int has_blind;    /* bool: frame t has some that are */
};

int64_t v2v_fusion_floats(int64_t neighbours, int64_t views, int64_t height, int64_t width)
{
    const int64_t samples = v2v_mem_product(views, height, width);
    const int64_t marks = v2v_parts(samples, (int64_t)sizeof(float));
    return marks + (neighbours == 0 ? 0
                                    : 7 * samples + v2v_motion_floats(views, height, width) +
                                          v2v_local_brightness_floats(views, height, width) +
                                          height * (3 * width + 2 * COARSE_TAPS) +
                                          2 * v2v_brightness_pieces(views, height, width));
}

/* Taps that sum to 1. @return the sum of their squares */
static double gaussian(float *taps, int reach, double sigma)
{
    double sum = 0.0, squares = 0.0;
    for (int k = -reach; k <= reach; k++) {
        sum += exp(-0.5 * k * k / (sigma * sigma));
    }
    for (int k = -reach; k <= reach; k++) {
        const double tap = exp(-0.5 * k * k / (sigma * sigma)) / sum;
        taps[k + reach] = (float)tap;
        squares += tap * tap;
    }
    return squares;
}

enum v2v_status v2v_fusion_create(struct v2v_fusion **fusion, int64_t neighbours, int64_t views,
                                  int64_t height, int64_t width, int leaves_blind)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fusion *made = NULL;
    const int64_t samples = v2v_mem_product(views, height, width);
    *fusion = NULL;
    V2V_TRY(V2V_ALLOC(made, "method.fusion", 1));
    made->neighbours = neighbours;
    made->views = views;
    made->height = height;
    made->width = width;
    made->leaves_blind = leaves_blind;
    made->pitch = width + 2 * COARSE_TAPS;
    made->smoothed = gaussian(made->fine, FINE_TAPS, FINE); /* root of the square, in y and x */
    (void)gaussian(made->coarse, COARSE_TAPS, COARSE);
    if (neighbours > 0) {
        V2V_TRY(
            V2V_ALLOC(made->ratios, "method.fusion", v2v_brightness_pieces(views, height, width)));
        V2V_TRY(v2v_local_brightness_create(&made->brightness, views, height, width));
        V2V_TRY(v2v_motion_create(&made->motion, views, height, width));
        V2V_TRY(V2V_ALLOC(made->moved, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->factor, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->photons, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->sum, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->weight, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->neighbour, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->change, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->mean, "method.fusion", v2v_mem_product(height, width, 1)));
        V2V_TRY(V2V_ALLOC(made->padded, "method.fusion", v2v_mem_product(height, made->pitch, 1)));
        V2V_TRY(V2V_ALLOC(made->image, "method.fusion", v2v_mem_product(height, width, 1)));
    }
    V2V_TRY(V2V_ALLOC(made->blind, "method.fusion", samples));
    *fusion = made;
    made = NULL;
done:
    v2v_fusion_destroy(&made);
    return rc;
}

void v2v_fusion_destroy(struct v2v_fusion **fusion)
{
    struct v2v_fusion *old = *fusion;
    *fusion = NULL;
    if (old != NULL) {
        v2v_mem_free(old->blind);
        v2v_mem_free(old->image);
        v2v_mem_free(old->padded);
        v2v_mem_free(old->mean);
        v2v_mem_free(old->change);
        v2v_mem_free(old->neighbour);
        v2v_mem_free(old->weight);
        v2v_mem_free(old->sum);
        v2v_mem_free(old->photons);
        v2v_mem_free(old->factor);
        v2v_mem_free(old->moved);
        v2v_local_brightness_destroy(&old->brightness);
        v2v_motion_destroy(&old->motion);
        v2v_mem_free(old->ratios);
        v2v_mem_free(old);
    }
}

/* ---- rows ---- */

/* Repeat the ends of a row, which begins at padded + COARSE_TAPS. */
static void repeat_ends(float *padded, int64_t width)
{
    float *row = padded + COARSE_TAPS;
    for (int64_t k = 1; k <= COARSE_TAPS; k++) {
        row[-k] = row[0];
        row[width - 1 + k] = row[width - 1];
    }
}

V2V_SIMD_CLONES static void add_row(float *restrict to, const float *restrict row, float tap,
                                    int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        to[x] += tap * row[x];
    }
}

/* What is finite. */
V2V_SIMD_CLONES static void add_finite_row(float *restrict to, const float *restrict row, float tap,
                                           int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        to[x] += row[x] < INFINITY ? tap * row[x] : 0.0f;
    }
}

/* Along a row with its ends repeated. */
static void smooth_row(float *to, const float *padded, const float *taps, int reach, int64_t width)
{
    memset(to, 0, (size_t)width * sizeof *to);
    for (int k = -reach; k <= reach; k++) {
        add_row(to, padded + COARSE_TAPS + k, taps[k + reach], width);
    }
}

/* Across the rows of an image, at row y; the first and the last row repeat. */
static void smooth_column(float *to, const float *image, const float *taps, int reach, int64_t y,
                          int64_t height, int64_t width)
{
    memset(to, 0, (size_t)width * sizeof *to);
    for (int k = -reach; k <= reach; k++) {
        add_row(to, image + v2v_within(y + k, 0, height - 1) * width, taps[k + reach], width);
    }
}

/* What a neighbour is held against. */
struct beside {
    float inverse;       /* of the unit's root, smoothed */
    float photons, even; /* in the light, of the variance of frame t */
    struct gate gate;    /* of all views together */
};

/* The neighbour's noise is that of frame t at its own level, times the factor: in the light. */
static inline float noise_in_light(struct beside beside, float factor)
{
    return factor * (beside.photons + factor * beside.even);
}

V2V_SIMD_CLONES static void difference_row(float *restrict to, const float *restrict views,
                                           const float *restrict neighbour,
                                           const float *restrict factor,
                                           const float *restrict photons, struct beside beside,
                                           int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        const float f = factor[x],
                    least = (float)V2V_PHOTONS_LEAST_VARIANCE * (1.0f + noise_in_light(beside, f));
        const float variance = (1.0f + f) * photons[x] + (1.0f + f * f) * beside.even;
        const float root = sqrtf(variance > least ? variance : least);
        to[x] = (views[x] - f * neighbour[x]) * beside.inverse / root;
    }
}

static float beyond(struct gate gate, float change)
{
    return change > gate.tolerated ? gate.steepness * (change - gate.tolerated) : 0.0f;
}

/* Nothing of what is not finite. */
V2V_SIMD_CLONES static void weigh_row(float *restrict sum, float *restrict weight,
                                      const float *restrict change, const float *restrict mean,
                                      const float *restrict row, const float *restrict factor,
                                      struct beside beside, int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        const float less = 1.0f + beyond(of_view, change[x]) + beyond(beside.gate, mean[x]);
        const float of_noise = noise_in_light(beside, factor[x]) * less;
        const float w = change[x] < INFINITY ? 1.0f / of_noise : 0.0f;
        sum[x] += w > 0.0f ? w * factor[x] * row[x] : 0.0f;
        weight[x] += w;
    }
}

/* The rows of `padded`, smoothed in both directions: to[y,pitch]. In a parallel region. */
static void smooth_padded(const struct v2v_fusion *fusion, float *to, int64_t pitch,
                          const float *taps, int reach)
{
    const int64_t height = fusion->height, width = fusion->width;
#pragma omp for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        float *padded = fusion->padded + y * fusion->pitch;
        repeat_ends(padded, width);
        smooth_row(fusion->image + y * width, padded, taps, reach, width);
    }
#pragma omp for schedule(static)
    for (int64_t y = 0; y < height; y++) {
        smooth_column(to + y * pitch, fusion->image, taps, reach, y, height, width);
    }
}

/* ---- frames ---- */

/* By the level about every pixel of a view. */
static void take_photons(struct v2v_fusion *fusion, int64_t v, const float *views, double gain)
{
    const int64_t height = fusion->height, width = fusion->width, pitch = fusion->pitch;
    const int64_t first = v * height * width;
    const float factor = (float)(gain / fusion->noise.unit);
    float *photons = fusion->photons + first;
#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            float *row = fusion->padded + y * pitch + COARSE_TAPS;
            memcpy(row, views + first + y * width, (size_t)width * sizeof *views);
        }
        smooth_padded(fusion, photons, width, fusion->fine, FINE_TAPS);
#pragma omp for schedule(static)
        for (int64_t i = 0; i < height * width; i++) {
            photons[i] = photons[i] > 0.0f ? factor * photons[i] : 0.0f;
        }
    }
}

/* Of frame t. @param seen its views, but for blind samples */
static void take_noise(struct v2v_fusion *fusion, const float *views, const float *seen,
                       double sigma)
{
    const struct v2v_photons photons = v2v_photons_find(fusion->neighbour, seen, fusion->views,
                                                        fusion->height, fusion->width, NULL);
    fusion->averaging = (struct v2v_averaging){.sigma = sigma,
                                               .gain = photons.gain,
                                               .variance = photons.variance,
                                               .is_of_photons = photons.is_clear};
    if (photons.is_clear) {
        const double of_photons = photons.gain * photons.bright;
        const double unit = of_photons + photons.variance;
        fusion->noise = (struct noise){sigma, unit, of_photons / unit, photons.variance / unit};
        for (int64_t v = 0; v < fusion->views; v++) {
            take_photons(fusion, v, views, photons.gain);
        }
    } else {
        fusion->noise = (struct noise){sigma, sigma * sigma, 0.0, 1.0};
        memset(fusion->photons, 0,
               (size_t)(fusion->views * fusion->height * fusion->width) * sizeof *fusion->photons);
    }
}

/* The views of a frame but for its `blind` samples, which are marked; those behind it until others
 * are aligned. */
static const float *leave_blind(struct v2v_fusion *fusion, const float *views, int64_t blind)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    if (blind == 0) {
        return views;
    }
    v2v_bulk_copy(fusion->moved, views, samples);
    v2v_blind_leave(fusion->moved, fusion->blind, samples);
    return fusion->moved;
}

/* With `blind` samples that are marked. */
static void begin(struct v2v_fusion *fusion, const float *views, int64_t blind)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    const float *seen = views;
    double sigma = 0.0; /* where a sample is not finite, which the method names */
    fusion->has_blind = 0;
    if (v2v_first_not_finite(views, samples) < 0) {
        fusion->has_blind = blind > 0;
        seen = leave_blind(fusion, views, blind);
        sigma = v2v_noise_of_images(fusion->neighbour, seen, fusion->views, fusion->height,
                                    fusion->width);
    }
    fusion->noise = (struct noise){0};
    fusion->averaging = (struct v2v_averaging){0};
    if (sigma > 0.0) {
        take_noise(fusion, views, seen, sigma);
        v2v_local_brightness_begin(fusion->brightness, views, fusion->photons, fusion->noise.unit,
                                   fusion->noise.even);
        v2v_motion_begin(fusion->motion, views, sigma);
    }
    v2v_bulk_copy(fusion->sum, views, samples);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        fusion->weight[i] = 1.0f;
    }
}

void v2v_fusion_begin(struct v2v_fusion *fusion, const float *views)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    int64_t blind = 0;
    if (fusion->leaves_blind && v2v_first_not_finite(views, samples) < 0) {
        blind =
            v2v_blind_find(fusion->blind, views, 0.0, fusion->views, fusion->height, fusion->width);
    }
    begin(fusion, views, blind);
}

static double brightness_of(const struct v2v_fusion *fusion, const float *views,
                            const float *neighbour)
{
    return v2v_brightness_factor(fusion->ratios, views, neighbour, fusion->views, fusion->height,
                                 fusion->width, fusion->noise.sigma);
}

const float *v2v_fusion_align(struct v2v_fusion *fusion, const float *views, const float *neighbour)
{
    if (!(fusion->noise.sigma > 0.0)) {
        return neighbour;
    }
    v2v_motion_find(fusion->motion, neighbour, brightness_of(fusion, views, neighbour));
    v2v_motion_undo(fusion->motion, fusion->moved, neighbour);
    return fusion->moved;
}

static struct beside place(const struct v2v_fusion *fusion)
{
    const struct noise *noise = &fusion->noise;
    return (struct beside){.inverse = (float)(1.0 / (sqrt(noise->unit) * fusion->smoothed)),
                           .photons = (float)noise->photons,
                           .even = (float)noise->even,
                           .gate = of_all(fusion->views)};
}

/* Of one view: the smoothed difference of two frames, its square smoothed again. */
static void find_change(struct v2v_fusion *fusion, int64_t v, const float *views,
                        const float *neighbour, struct beside beside)
{
    const int64_t height = fusion->height, width = fusion->width, pitch = fusion->pitch;
    const int64_t first = v * height * width;
    float *rows = fusion->padded + COARSE_TAPS; /* [y,pitch] */
#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            const int64_t at = first + y * width;
            difference_row(rows + y * pitch, views + at, neighbour + at, fusion->factor + at,
                           fusion->photons + at, beside, width);
        }
        smooth_padded(fusion, rows, pitch, fusion->fine, FINE_TAPS);
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            for (int64_t x = 0; x < width; x++) {
                rows[y * pitch + x] *= rows[y * pitch + x];
            }
        }
        smooth_padded(fusion, fusion->change + first, width, fusion->coarse, COARSE_TAPS);
    }
}

/* Over all views, smoothed once more: what moves too little to be seen in one view. */
static void find_mean_change(struct v2v_fusion *fusion)
{
    const int64_t height = fusion->height, width = fusion->width, pitch = fusion->pitch;
    const float share = 1.0f / (float)fusion->views;
#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            float *row = fusion->padded + y * pitch + COARSE_TAPS;
            memset(row, 0, (size_t)width * sizeof *row);
            for (int64_t v = 0; v < fusion->views; v++) {
                add_finite_row(row, fusion->change + (v * height + y) * width, share, width);
            }
        }
        smooth_padded(fusion, fusion->mean, width, fusion->coarse, COARSE_TAPS);
    }
}

void v2v_fusion_add(struct v2v_fusion *fusion, const float *views, const float *neighbour)
{
    if (fusion->noise.sigma > 0.0) {
        const struct beside beside = place(fusion);
        const int64_t rows = fusion->views * fusion->height, width = fusion->width;
        v2v_local_brightness_find(fusion->brightness, fusion->factor, neighbour,
                                  brightness_of(fusion, views, neighbour));
        for (int64_t v = 0; v < fusion->views; v++) {
            find_change(fusion, v, views, neighbour, beside);
        }
        find_mean_change(fusion);
#pragma omp parallel for schedule(static)
        for (int64_t row = 0; row < rows; row++) {
            const int64_t at = row * width;
            weigh_row(fusion->sum + at, fusion->weight + at, fusion->change + at,
                      fusion->mean + row % fusion->height * width, neighbour + at,
                      fusion->factor + at, beside, width);
        }
    }
}

/* Frames that were filtered over time, or are there twice, share noise: then more is left of it
 * than of as many of their own. By the noise that is found in the mean, which the root of its
 * frames brings back to that of one; not of photons, whose noise is small where structure is not.
 * `sum` is written over. */
static void find_shared_noise(struct v2v_fusion *fusion, const float *views)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    struct v2v_averaging *averaging = &fusion->averaging;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        fusion->sum[i] = views[i] != V2V_BLIND ? views[i] * sqrtf(fusion->weight[i]) : V2V_BLIND;
    }
    const double left = v2v_noise_of_images(fusion->neighbour, fusion->sum, fusion->views,
                                            fusion->height, fusion->width);
    const double times = left / averaging->sigma;
    if (times * times > least_shared) {
        averaging->sigma = left;
    }
}

/* What the camera cut off of frame t, `moved`, stays where it ends, which no mean is above: it has
 * to be found there. */
static void keep_saturated(const struct v2v_fusion *fusion, float *views)
{
    const int64_t pixels = fusion->height * fusion->width;
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < fusion->views; v++) {
        const float *recorded = fusion->moved + v * pixels;
        const float highest = v2v_saturated_value(recorded, pixels);
        for (int64_t i = 0; isfinite(highest) && i < pixels; i++) {
            float *mean = &views[v * pixels + i];
            *mean = recorded[i] == highest || *mean > highest ? highest : *mean; /* NaN stays */
        }
    }
}

void v2v_fusion_end(struct v2v_fusion *fusion, float *views)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        fusion->moved[i] = views[i];
        views[i] = fusion->sum[i] / fusion->weight[i];
    }
    keep_saturated(fusion, views);
    if (fusion->has_blind) {
        v2v_blind_leave(views, fusion->blind, samples);
    }
    if (fusion->noise.sigma > 0.0) {
        fusion->averaging.frames = fusion->weight;
        if (!fusion->averaging.is_of_photons) {
            find_shared_noise(fusion, views);
        }
    }
}

const struct v2v_averaging *v2v_fusion_averaging(const struct v2v_fusion *fusion)
{
    return fusion->averaging.frames != NULL ? &fusion->averaging : NULL;
}

const float *v2v_fusion_recorded(const struct v2v_fusion *fusion)
{
    return fusion->averaging.frames != NULL ? fusion->moved : NULL;
}

enum v2v_status v2v_fusion_read(struct v2v_fusion *fusion, float *views,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    /* at the ends as many frames as in the middle: more on one side; none that shares pages */
    const int64_t others = 2 * fusion->neighbours, apart = v2v_larger(info->apart, 1);
    const int64_t earlier = (t + info->before) / apart;
    const int64_t later = (info->frames + info->after - 1 - t) / apart;
    const int64_t wanted = v2v_smaller(fusion->neighbours, earlier);
    const int64_t after = v2v_smaller(others - wanted, later);
    const int64_t before = v2v_smaller(others - after, earlier);
    int64_t blind = 0;
    fusion->averaging = (struct v2v_averaging){0};
    V2V_TRY(v2v_recording_read_marked(recording, views, fusion->blind, scaling->offset, &blind, t));
    v2v_scaling_apply(scaling, views, samples);
    v2v_blind_leave(views, fusion->blind, blind > 0 ? samples : 0);
    if (before + after > 0 || !fusion->leaves_blind) {
        v2v_blind_darken(views, samples);
    }
    if (before + after == 0) {
        goto done;
    }
    begin(fusion, views, fusion->leaves_blind ? blind : 0);
    for (int64_t i = -before; i <= after; i++) {
        if (i != 0) {
            v2v_watchdog_beat("reading a neighbouring frame");
            V2V_TRY(
                v2v_scaling_read_dark(scaling, recording, fusion->neighbour, NULL, t + i * apart));
            v2v_fusion_add(fusion, views, v2v_fusion_align(fusion, views, fusion->neighbour));
        }
    }
    v2v_fusion_end(fusion, views);
done:
    return rc;
}
