#include "method/lessons.h"

#include "method/features.h"
#include "method/tv.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/tensor/blind.h"

#include <math.h>

/* Lessons in turn are mirrored so: along an even number of axes, which keeps handed things so. */
static const unsigned flips[] = {0, V2V_FLIP_X | V2V_FLIP_Y, V2V_FLIP_X | V2V_FLIP_Z,
                                 V2V_FLIP_Y | V2V_FLIP_Z};
enum { FLIPS = sizeof flips / sizeof *flips };

struct v2v_lessons {
    const struct v2v_config *config;
    const struct v2v_psf_file *psf;
    int64_t height, width; /* of the frames that all below is for; 0: none yet */
    struct v2v_features *features;
    struct v2v_fusion *fusion;
    float *views, *taught;   /* [v,y,x]: as recorded, and of a volume that is known */
    float *frames;           /* likewise, of their averaging; NULL: there is none */
    float *volume, *flipped; /* [z,torus] */
};

int64_t v2v_lessons_images(int64_t slices)
{
    return (V2V_FEATURES + 1) * slices;
}

enum v2v_status v2v_lessons_create(struct v2v_lessons **lessons, const struct v2v_config *config,
                                   const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    *lessons = NULL;
    V2V_TRY(V2V_ALLOC(*lessons, "lessons", 1));
    **lessons = (struct v2v_lessons){.config = config, .psf = psf};
done:
    return rc;
}

static void free_plan(struct v2v_lessons *lessons)
{
    v2v_features_destroy(&lessons->features);
    v2v_fusion_destroy(&lessons->fusion);
    v2v_mem_free(lessons->views);
    v2v_mem_free(lessons->taught);
    v2v_mem_free(lessons->frames);
    v2v_mem_free(lessons->volume);
    v2v_mem_free(lessons->flipped);
    *lessons = (struct v2v_lessons){.config = lessons->config, .psf = lessons->psf};
}

void v2v_lessons_destroy(struct v2v_lessons **lessons)
{
    struct v2v_lessons *self = *lessons;
    *lessons = NULL;
    if (self != NULL) {
        free_plan(self);
        v2v_mem_free(self);
    }
}

static enum v2v_status plan(struct v2v_lessons *self, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file *psf = self->psf;
    const struct v2v_problem problem = {
        .config = self->config, .psf = psf, .height = height, .width = width};
    if (self->height == height && self->width == width) {
        return V2V_OK;
    }
    free_plan(self);
    V2V_TRY(v2v_features_create(&self->features, &problem));
    V2V_TRY(v2v_fusion_create(&self->fusion, self->config->recon.neighbours, psf->views, height,
                              width, 1));
    const struct v2v_torus torus = v2v_features_torus(self->features);
    const int64_t voxels = v2v_mem_product(psf->slices, torus.height, torus.width);
    V2V_TRY(V2V_ALLOC(self->views, "lessons.views", v2v_mem_product(psf->views, height, width)));
    V2V_TRY(V2V_ALLOC(self->taught, "lessons.views", v2v_mem_product(psf->views, height, width)));
    if (self->config->recon.neighbours > 0) {
        V2V_TRY(
            V2V_ALLOC(self->frames, "lessons.views", v2v_mem_product(psf->views, height, width)));
    }
    V2V_TRY(V2V_ALLOC(self->volume, "lessons.volumes", voxels));
    V2V_TRY(V2V_ALLOC(self->flipped, "lessons.volumes", voxels));
    self->height = height;
    self->width = width;
done:
    if (rc != V2V_OK) {
        free_plan(self);
    }
    return rc;
}

/* Mean square of a - b. */
static double mean_square(const float *a, const float *b, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double d = (double)a[i] - (double)b[i];
        sum += d * d;
    }
    return sum / (double)count;
}

/* The error of total variation becomes 1 in the mean square; nothing is made of a dark frame. */
static double normalize(float *images, int64_t slices, int64_t pixels)
{
    const int64_t voxels = slices * pixels, count = v2v_lessons_images(slices) * pixels;
    const double error = sqrt(mean_square(images, images + V2V_FEATURES * voxels, voxels));
    const double factor = error > 0.0 ? 1.0 / error : 1.0;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        images[i] = (float)(images[i] * factor);
    }
    return error;
}

/* Where less was averaged things move, which are mirrored with the volume; views beside each other
 * show them where they were but for parallax. */
static void flip_frames(const struct v2v_lessons *self, const float *frames, unsigned flip)
{
    const int64_t height = self->height, width = self->width;
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < self->psf->views * height; row++) {
        const int64_t v = row / height, y = row % height;
        const float *from =
            frames + (v * height + (flip & V2V_FLIP_Y ? height - 1 - y : y)) * width;
        for (int64_t x = 0; x < width; x++) {
            self->frames[row * width + x] = from[flip & V2V_FLIP_X ? width - 1 - x : x];
        }
    }
}

enum v2v_status v2v_lessons_make(struct v2v_lessons *lessons, float *images,
                                 struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                 int64_t t, int64_t number)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_lessons *self = lessons;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t slices = self->psf->slices, pixels = info->height * info->width;
    const unsigned flip = flips[number % FLIPS];
    struct v2v_tv_noise noise = {0}, again = {0};
    struct v2v_averaging averaging;
    V2V_TRY(plan(self, info->height, info->width));
    V2V_TRY(v2v_fusion_read(self->fusion, self->views, recording, scaling, t));
    struct v2v_estimator *tv = v2v_features_tv(self->features);
    tv->averaging = v2v_fusion_averaging(self->fusion);
    V2V_TRY(v2v_features_of_views(self->features, images, self->volume, &noise, self->views));
    if (noise.deviation == 0.0 && noise.gain == 0.0) {
        v2v_log(V2V_LOG_WARNING, "frame %lld is dark: there is nothing to learn from it",
                (long long)t);
    }
    v2v_features_flip(self->features, self->flipped, self->volume, flip);
    v2v_features_cut(self->features, images + V2V_FEATURES * slices * pixels, self->flipped);
    if (noise.averaging != NULL) {
        flip_frames(self, noise.averaging->frames, flip);
        averaging = *noise.averaging;
        averaging.frames = self->frames;
        tv->averaging = noise.averaging = &averaging;
    }
    v2v_features_simulate(self->features, self->taught, self->flipped, &noise,
                          (uint64_t)self->config->train.seed,
                          v2v_random_fnv1a64("lessons") + (uint64_t)number);
    v2v_blind_take_over(self->taught, self->views, self->psf->views * pixels);
    rc = v2v_features_of_views(self->features, images, NULL, &again, self->taught);
    tv->averaging = NULL;
    V2V_TRY(rc);
    const double error = normalize(images, slices, pixels);
    v2v_log(V2V_LOG_DEBUG,
            "lesson %lld, from frame %lld: noise %.3g, of photons %.3g of the light, error %.3g",
            (long long)number, (long long)t, noise.deviation, noise.gain, error);
done:
    return rc;
}

/* ---- as examples ---- */

enum { STEPS_OF_LESSON = 250 };

static enum v2v_status create_examples(struct v2v_examples *examples)
{
    struct v2v_lessons *lessons = NULL;
    const enum v2v_status rc = v2v_lessons_create(&lessons, examples->config, examples->psf);
    examples->self = lessons;
    examples->inputs = V2V_FEATURES * examples->psf->slices;
    examples->outputs = examples->psf->slices;
    return rc;
}

static void destroy_examples(struct v2v_examples *examples)
{
    struct v2v_lessons *lessons = examples->self;
    v2v_lessons_destroy(&lessons);
}

static enum v2v_status make_example(struct v2v_examples *examples, float *images,
                                    const struct v2v_example_source *source, int64_t t,
                                    int64_t number)
{
    return v2v_lessons_make(examples->self, images, source->recording, &source->scaling, t, number);
}

const struct v2v_examples_ops v2v_examples_lessons = {
    .name = "lessons",
    .mirroring = V2V_MIRROR_IMAGES,
    .estimator = &v2v_estimator_tv,
    .steps_of_one = STEPS_OF_LESSON,
    .create = create_examples,
    .destroy = destroy_examples,
    .make = make_example,
};
