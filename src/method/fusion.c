#include "v2v3d/method/fusion.h"

#include "method/photons.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/bulk.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>
#include <string.h>

/* REFERENCE.md 12. Gaussians end at four standard deviations: 6e-5 of their weight is beyond. */
enum { FINE = 2, COARSE = 3, REACH = 4, FINE_TAPS = REACH * FINE, COARSE_TAPS = REACH * COARSE };
static const float tolerated = 1.5f; /* mean square of a difference, which noise makes 1 */
static const float steepness = 2.0f;

/* Of the variance in the light, the least of photons. */
static const double least_variance = 0.01;

struct v2v_fusion {
    int64_t neighbours;
    int64_t views, height, width, pitch;
    float fine[2 * FINE_TAPS + 1], coarse[2 * COARSE_TAPS + 1];
    double smoothed;  /* noise that `fine` leaves of a pixel's, as a factor on its sigma */
    int is_noisy;     /* bool: noise is known */
    float *inverse;   /* [v,y,x]: 1 / (sigma of a smoothed difference) */
    float *sum;       /* [v,y,x] of weighted views */
    float *weight;    /* [v,y,x] of weights */
    float *neighbour; /* [v,y,x] */
    float *padded;    /* [y,pitch]: rows with their ends repeated on either side */
    float *image;     /* [y,x] */
};

int64_t v2v_fusion_floats(int64_t neighbours, int64_t views, int64_t height, int64_t width)
{
    return neighbours == 0
               ? 0
               : 4 * v2v_mem_product(views, height, width) + height * (2 * width + 2 * COARSE_TAPS);
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
                                  int64_t height, int64_t width)
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
    made->pitch = width + 2 * COARSE_TAPS;
    made->smoothed = gaussian(made->fine, FINE_TAPS, FINE); /* root of the square, in y and x */
    (void)gaussian(made->coarse, COARSE_TAPS, COARSE);
    if (neighbours > 0) {
        V2V_TRY(V2V_ALLOC(made->inverse, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->sum, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->weight, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->neighbour, "method.fusion", samples));
        V2V_TRY(V2V_ALLOC(made->padded, "method.fusion", v2v_mem_product(height, made->pitch, 1)));
        V2V_TRY(V2V_ALLOC(made->image, "method.fusion", v2v_mem_product(height, width, 1)));
    }
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
        v2v_mem_free(old->image);
        v2v_mem_free(old->padded);
        v2v_mem_free(old->neighbour);
        v2v_mem_free(old->weight);
        v2v_mem_free(old->sum);
        v2v_mem_free(old->inverse);
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

V2V_SIMD_CLONES static void difference_row(float *restrict to, const float *restrict a,
                                           const float *restrict b, const float *restrict factor,
                                           int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        to[x] = (a[x] - b[x]) * factor[x];
    }
}

/* Nothing of what is not finite. */
V2V_SIMD_CLONES static void weigh_row(float *restrict sum, float *restrict weight,
                                      const float *restrict change, const float *restrict row,
                                      int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        const float beyond = change[x] > tolerated ? change[x] - tolerated : 0.0f;
        const float w = change[x] < INFINITY ? 1.0f / (1.0f + steepness * beyond) : 0.0f;
        sum[x] += w > 0.0f ? w * row[x] : 0.0f;
        weight[x] += w;
    }
}

/* ---- frames ---- */

/* Of the difference of two samples of this variance, smoothed. */
static float inverse_of(const struct v2v_fusion *fusion, double variance)
{
    return (float)(1.0 / (sqrt(2.0 * variance) * fusion->smoothed));
}

/* Where the noise is that of photons: of every sample by the level about it. */
static void take_photons(struct v2v_fusion *fusion, int64_t v, const float *views,
                         const struct v2v_photons *photons)
{
    const int64_t height = fusion->height, width = fusion->width, pitch = fusion->pitch;
    const int64_t first = v * height * width;
    const double in_light = photons->gain * photons->bright + photons->variance;
#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            float *padded = fusion->padded + y * pitch;
            memcpy(padded + COARSE_TAPS, views + first + y * width, (size_t)width * sizeof *views);
            repeat_ends(padded, width);
            smooth_row(fusion->image + y * width, padded, fusion->fine, FINE_TAPS, width);
        }
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            float *row = fusion->inverse + first + y * width;
            smooth_column(row, fusion->image, fusion->fine, FINE_TAPS, y, height, width);
            for (int64_t x = 0; x < width; x++) {
                const double level = fmax((double)row[x], 0.0);
                const double variance = photons->gain * level + photons->variance;
                row[x] = inverse_of(fusion, fmax(variance, least_variance * in_light));
            }
        }
    }
}

/* Noise about every sample of frame t. */
static void take_noise(struct v2v_fusion *fusion, const float *views, double sigma)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    const struct v2v_photons photons = v2v_photons_find(fusion->neighbour, views, fusion->views,
                                                        fusion->height, fusion->width, NULL);
    for (int64_t v = 0; photons.is_clear && v < fusion->views; v++) {
        take_photons(fusion, v, views, &photons);
    }
    if (!photons.is_clear) {
        const float inverse = (float)(1.0 / (sqrt(2.0) * sigma * fusion->smoothed));
#pragma omp parallel for simd schedule(static)
        for (int64_t i = 0; i < samples; i++) {
            fusion->inverse[i] = inverse;
        }
    }
}

void v2v_fusion_begin(struct v2v_fusion *fusion, const float *views)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    double sigma = 0.0; /* where a sample is not finite, which the method names */
    if (v2v_first_not_finite(views, samples) < 0) {
        sigma = v2v_noise_of_images(fusion->neighbour, views, fusion->views, fusion->height,
                                    fusion->width);
    }
    fusion->is_noisy = sigma > 0.0;
    if (fusion->is_noisy) {
        take_noise(fusion, views, sigma);
    }
    v2v_bulk_copy(fusion->sum, views, samples);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        fusion->weight[i] = 1.0f;
    }
}

/* Of one view: the smoothed difference of two frames, its square smoothed again, the weights. */
static void add_view(struct v2v_fusion *fusion, int64_t v, const float *views,
                     const float *neighbour)
{
    const int64_t height = fusion->height, width = fusion->width, pitch = fusion->pitch;
    const int64_t first = v * height * width;
    float *padded = fusion->padded, *image = fusion->image;
#pragma omp parallel
    {
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            const int64_t at = first + y * width;
            difference_row(padded + y * pitch + COARSE_TAPS, views + at, neighbour + at,
                           fusion->inverse + at, width);
            repeat_ends(padded + y * pitch, width);
            smooth_row(image + y * width, padded + y * pitch, fusion->fine, FINE_TAPS, width);
        }
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            float *row = padded + y * pitch + COARSE_TAPS;
            smooth_column(row, image, fusion->fine, FINE_TAPS, y, height, width);
            for (int64_t x = 0; x < width; x++) {
                row[x] *= row[x];
            }
            repeat_ends(padded + y * pitch, width);
        }
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            smooth_row(image + y * width, padded + y * pitch, fusion->coarse, COARSE_TAPS, width);
        }
#pragma omp for schedule(static)
        for (int64_t y = 0; y < height; y++) {
            const int64_t at = first + y * width;
            float *change = padded + y * pitch;
            smooth_column(change, image, fusion->coarse, COARSE_TAPS, y, height, width);
            weigh_row(fusion->sum + at, fusion->weight + at, change, neighbour + at, width);
        }
    }
}

void v2v_fusion_add(struct v2v_fusion *fusion, const float *views, const float *neighbour)
{
    for (int64_t v = 0; fusion->is_noisy && v < fusion->views; v++) {
        add_view(fusion, v, views, neighbour);
    }
}

void v2v_fusion_end(struct v2v_fusion *fusion, float *views)
{
    const int64_t samples = fusion->views * fusion->height * fusion->width;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        views[i] = fusion->sum[i] / fusion->weight[i];
    }
}

enum v2v_status v2v_fusion_read(struct v2v_fusion *fusion, float *views,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = fusion->views * fusion->height * fusion->width;
    const int64_t first = v2v_larger(t - fusion->neighbours, -info->before);
    const int64_t last = v2v_smaller(t + fusion->neighbours, info->frames + info->after - 1);
    V2V_TRY(v2v_recording_read(recording, views, t));
    v2v_scaling_apply(scaling, views, samples);
    if (first == last) {
        goto done;
    }
    v2v_fusion_begin(fusion, views);
    for (int64_t u = first; u <= last; u++) {
        if (u != t) {
            v2v_watchdog_beat("reading a neighbouring frame");
            V2V_TRY(v2v_recording_read(recording, fusion->neighbour, u));
            v2v_scaling_apply(scaling, fusion->neighbour, samples);
            v2v_fusion_add(fusion, views, fusion->neighbour);
        }
    }
    v2v_fusion_end(fusion, views);
done:
    return rc;
}
