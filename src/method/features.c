#include "method/features.h"

#include "method/tv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/saturation.h"

#include <math.h>
#include <string.h>

static const double taus[V2V_FEATURES - 1] = {2.0, 64.0};

/* Stream of photons beside that of normal noise. */
static const uint64_t of_photons = (uint64_t)'P' << 56;

struct v2v_features {
    struct v2v_estimator *estimator; /* tv, which lends its data step */
    struct v2v_data_step *step;
    struct v2v_torus torus;
    int64_t views, slices, height, width;
    double light;
    float *volume;  /* [z,torus] */
    float *image;   /* [v,torus] */
    float *highest; /* [v]: of the views at hand, as v2v_saturated_value says */
};

enum v2v_status v2v_features_create(struct v2v_features **features,
                                    const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_features *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "features", 1));
    *self = (struct v2v_features){.views = problem->psf->views,
                                  .slices = problem->psf->slices,
                                  .height = problem->height,
                                  .width = problem->width,
                                  .light = v2v_psf_light(problem->psf)};
    V2V_TRY(v2v_estimator_create(&self->estimator, &v2v_estimator_tv, problem, NULL));
    self->step = v2v_tv_data_step(self->estimator);
    self->torus = v2v_data_step_torus(self->step);
    V2V_TRY(V2V_ALLOC(self->volume, "features.volume",
                      v2v_mem_product(self->slices, self->torus.height, self->torus.width)));
    V2V_TRY(V2V_ALLOC(self->image, "features.views",
                      v2v_mem_product(self->views, self->torus.height, self->torus.width)));
    V2V_TRY(V2V_ALLOC(self->highest, "features.views", self->views));
done:
    if (rc != V2V_OK) {
        v2v_features_destroy(&self);
    }
    *features = self;
    return rc;
}

void v2v_features_destroy(struct v2v_features **features)
{
    struct v2v_features *self = *features;
    *features = NULL;
    if (self != NULL) {
        v2v_estimator_destroy(&self->estimator);
        v2v_mem_free(self->volume);
        v2v_mem_free(self->image);
        v2v_mem_free(self->highest);
        v2v_mem_free(self);
    }
}

struct v2v_estimator *v2v_features_tv(const struct v2v_features *features)
{
    return features->estimator;
}

struct v2v_torus v2v_features_torus(const struct v2v_features *features)
{
    return features->torus;
}

/* Planes on the torus, cut to the frame. */
static void cut(const struct v2v_features *self, float *out, const float *planes, int64_t count)
{
    const struct v2v_torus *torus = &self->torus;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t i = 0; i < count; i++) {
        for (int64_t y = 0; y < self->height; y++) {
            memcpy(out + (i * self->height + y) * self->width,
                   planes + (i * torus->height + y) * torus->width,
                   (size_t)self->width * sizeof *out);
        }
    }
}

void v2v_features_cut(const struct v2v_features *features, float *out, const float *volume)
{
    cut(features, out, volume, features->slices);
}

/* image = the views that a volume gives, of a part with the light around it.
 * volume may be self->volume, which is written over */
static void project(const struct v2v_features *self, const float *volume)
{
    const struct v2v_surroundings *around = self->estimator->around;
    const int64_t pixels = self->torus.height * self->torus.width;
    if (around == NULL) {
        v2v_data_step_project(self->step, self->image, volume);
        return;
    }
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < self->slices * pixels; i++) {
        self->volume[i] = volume[i] - around->light[i];
    }
    v2v_data_step_project(self->step, self->image, self->volume);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < self->views * pixels; i++) {
        self->image[i] += around->seen[i];
    }
}

/* image = y - image where views are known, 0 elsewhere. */
static void miss(const struct v2v_features *self, const float *views)
{
    const struct v2v_torus *torus = &self->torus;
    const struct v2v_surroundings *around = self->estimator->around;
    const struct v2v_part rows = around != NULL ? around->rows : (struct v2v_part){0, self->height};
    const struct v2v_part columns =
        around != NULL ? around->columns : (struct v2v_part){0, self->width};
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        const int64_t pixels = self->height * self->width;
        self->highest[v] =
            around != NULL ? around->highest[v] : v2v_saturated_value(views + v * pixels, pixels);
    }
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t v = 0; v < self->views; v++) {
        for (int64_t y = 0; y < torus->height; y++) {
            const int is_known = y >= rows.first && y < rows.first + rows.count;
            const int64_t first = is_known ? columns.first : torus->width;
            const int64_t end = is_known ? first + columns.count : torus->width;
            const float *recorded = views + (v * self->height + y) * self->width;
            const float highest = self->highest[v];
            float *row = self->image + (v * torus->height + y) * torus->width;
            memset(row, 0, (size_t)first * sizeof *row);
            for (int64_t x = first; x < end; x++) {
                row[x] = v2v_rest_of(recorded[x], row[x], highest);
            }
            memset(row + end, 0, (size_t)(torus->width - end) * sizeof *row);
        }
    }
}

void v2v_features_of_volume(struct v2v_features *features, float *out, const float *volume,
                            const float *views)
{
    struct v2v_features *self = features;
    const int64_t voxels = self->slices * self->height * self->width;
    const int64_t whole = self->slices * self->torus.height * self->torus.width;
    cut(self, out, volume, self->slices);
    project(self, volume);
    miss(self, views);
    v2v_data_step_begin_torus(self->step, self->image);
    for (int k = 1; k < V2V_FEATURES; k++) {
        v2v_watchdog_beat("features of a frame");
        memset(self->volume, 0, (size_t)whole * sizeof *self->volume);
        v2v_data_step_factor(
            self->step, &(struct v2v_penalty){.constant = self->light * self->light / taus[k - 1]});
        v2v_data_step_run(self->step, self->volume);
        cut(self, out + k * voxels, self->volume, self->slices);
    }
}

enum v2v_status v2v_features_of_views(struct v2v_features *features, float *out, float *volume,
                                      struct v2v_tv_noise *noise, const float *views)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_estimator *tv = features->estimator;
    V2V_TRY(tv->ops->run(features->estimator, &out, views, NULL)); /* f0, which is cut again */
    if (volume == NULL) {
        volume = features->volume;
    }
    v2v_tv_torus_volume(tv, volume);
    *noise = v2v_tv_noise(tv);
    if (noise->deviation > 0.0 || noise->gain > 0.0) {
        v2v_features_of_volume(features, out, volume, views);
    } else { /* no light: samples below zero are none that a correction may add */
        const int64_t voxels = features->slices * features->height * features->width;
        memset(out, 0, (size_t)(V2V_FEATURES * voxels) * sizeof *out);
    }
done:
    return rc;
}

void v2v_features_simulate(struct v2v_features *features, float *views, const float *volume,
                           const struct v2v_tv_noise *noise, uint64_t seed, uint64_t stream)
{
    const int64_t samples = features->views * features->height * features->width;
    v2v_data_step_project(features->step, features->image, volume);
    cut(features, views, features->image, features->views);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        const uint64_t index = (uint64_t)i;
        const double less = /* by frames beyond those that the noise is of */
            noise->averaging != NULL ? noise->frames / (double)noise->averaging->frames[i] : 1.0;
        const double gain = less * noise->gain;
        if (gain > 0.0) {
            const double photons = fmax((double)views[i], 0.0) / gain;
            views[i] = (float)(gain * (double)v2v_random_poisson(seed, stream + of_photons, index,
                                                                 photons));
        }
        views[i] += (float)(sqrt(less) * noise->deviation * v2v_random_normal(seed, stream, index));
    }
}

/* Place that comes to `i` when the first `size` of `whole` places on a circle are mirrored. */
static int64_t mirrored(int64_t i, int64_t size, int64_t whole)
{
    const int64_t place = size - 1 - i;
    return place < 0 ? place + whole : place;
}

void v2v_features_flip(const struct v2v_features *features, float *out, const float *volume,
                       unsigned flips)
{
    const struct v2v_torus *torus = &features->torus;
    const int64_t slices = features->slices;
#pragma omp parallel for collapse(2) schedule(static)
    for (int64_t z = 0; z < slices; z++) {
        for (int64_t y = 0; y < torus->height; y++) {
            const int64_t from_z = flips & V2V_FLIP_Z ? slices - 1 - z : z;
            const int64_t from_y =
                flips & V2V_FLIP_Y ? mirrored(y, features->height, torus->height) : y;
            const float *from = volume + (from_z * torus->height + from_y) * torus->width;
            float *to = out + (z * torus->height + y) * torus->width;
            for (int64_t x = 0; x < torus->width; x++) {
                to[x] = from[flips & V2V_FLIP_X ? mirrored(x, features->width, torus->width) : x];
            }
        }
    }
}
