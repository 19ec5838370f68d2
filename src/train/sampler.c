#include "train/sampler.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/optics/shifts.h"
#include "v2v3d/tensor/pad.h"

#include <math.h>
#include <string.h>

/* Frames kept in memory: recordings up to this many bytes are read once. */
#define KEPT_BYTES ((int64_t)2 << 30)

enum { AXES = 2 };
enum { DRAW_FRAME, DRAW_Y, DRAW_X, DRAW_FLIP_Y, DRAW_FLIP_X, DRAWS };

struct source {
    struct v2v_recording *recording; /* borrowed */
    struct v2v_scaling scaling;
    int64_t first; /* frame number of its frame 0 among all recordings' frames */
};

struct corner {
    int64_t y, x; /* upper left pixel of a crop */
};

struct v2v_sampler {
    const struct v2v_train_settings *settings;
    struct source *source;
    int64_t source_count;
    int64_t frames, views;
    int64_t height, width;  /* of a sample */
    int64_t frame_pixels;   /* of the largest frame */
    int flip[AXES];         /* y, x: physical and wanted */
    int32_t *partner[AXES]; /* [v] */
    float **slot;           /* kept frames [v,y,x], scaled; NULL until read */
    int64_t *slot_frame;    /* which frame a slot holds, -1 none */
    int64_t slots, next_slot;
    float *scratch; /* [v,height,width] */
};

static const struct v2v_recording_info *info_of(const struct source *source)
{
    return v2v_recording_info(source->recording);
}

static enum v2v_status check_sizes(const struct v2v_sampler *sampler, int64_t psf_views)
{
    const struct v2v_recording_info *first = info_of(&sampler->source[0]);
    int64_t crop = sampler->settings->crop;
    for (int64_t i = 0; i < sampler->source_count; i++) {
        const struct v2v_recording_info *info = info_of(&sampler->source[i]);
        if (info->views != psf_views) {
            return V2V_FAIL(V2V_E_INPUT, "recording %lld has %lld views, the PSF set %lld",
                            (long long)i + 1, (long long)info->views, (long long)psf_views);
        }
        if (crop > 0 && (info->height < crop || info->width < crop)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "recording %lld has frames of %lld x %lld, smaller than train.crop = "
                            "%lld",
                            (long long)i + 1, (long long)info->height, (long long)info->width,
                            (long long)crop);
        }
        if (crop == 0 && (info->height != first->height || info->width != first->width)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "train.crop = 0 takes recordings of one frame size; recording %lld "
                            "has another than the first",
                            (long long)i + 1);
        }
    }
    return V2V_OK;
}

static enum v2v_status add_sources(struct v2v_sampler *sampler, const struct v2v_train_job *job,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(
        v2v_par_agree(comm, V2V_ALLOC(sampler->source, "sampler.sources", job->recording_count)));
    sampler->source_count = job->recording_count;
    for (int64_t i = 0; i < job->recording_count; i++) {
        struct source *source = &sampler->source[i];
        source->recording = job->recordings[i];
        source->first = sampler->frames;
        V2V_TRY(v2v_scaling_decide(&source->scaling, source->recording, &job->config->input, comm));
        const struct v2v_recording_info *info = info_of(source);
        int64_t pixels = info->height * info->width;
        sampler->frames += info->frames;
        sampler->frame_pixels = pixels > sampler->frame_pixels ? pixels : sampler->frame_pixels;
        v2v_log(V2V_LOG_INFO, "recording %lld: %lld frames of %lld x %lld, offset %g, gain %g",
                (long long)i + 1, (long long)info->frames, (long long)info->height,
                (long long)info->width, source->scaling.offset, source->scaling.gain);
    }
    V2V_TRY(v2v_par_agree(comm, check_sizes(sampler, job->psf->views)));
done:
    return rc;
}

static enum v2v_status take_memory(struct v2v_sampler *sampler, const struct v2v_train_job *job,
                                   int64_t unit)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = info_of(&sampler->source[0]);
    int64_t crop = sampler->settings->crop;
    sampler->views = job->psf->views;
    sampler->height = crop > 0 ? crop : v2v_pad_size(info->height, unit);
    sampler->width = crop > 0 ? crop : v2v_pad_size(info->width, unit);
    int64_t bytes = sampler->views * sampler->frame_pixels * (int64_t)sizeof(float);
    int64_t fit = KEPT_BYTES / bytes;
    sampler->slots = fit < 1 ? 1 : fit < sampler->frames ? fit : sampler->frames;
    V2V_TRY(V2V_ALLOC(sampler->slot, "sampler.frames", sampler->slots));
    V2V_TRY(V2V_ALLOC(sampler->slot_frame, "sampler.frames", sampler->slots));
    V2V_TRY(V2V_ALLOC(sampler->scratch, "sampler.scratch",
                      v2v_mem_product(sampler->views, sampler->height, sampler->width)));
    for (int64_t i = 0; i < sampler->slots; i++) {
        sampler->slot_frame[i] = -1;
    }
    for (int axis = 0; axis < AXES; axis++) {
        V2V_TRY(V2V_ALLOC(sampler->partner[axis], "sampler.flips", sampler->views));
        sampler->flip[axis] = sampler->settings->flips && crop > 0 &&
                              v2v_shifts_flip_partner(sampler->partner[axis], job->psf, axis,
                                                      sampler->settings->flip_tolerance);
    }
    v2v_log(V2V_LOG_INFO, "samples of %lld x %lld, flips: y %s, x %s", (long long)sampler->height,
            (long long)sampler->width, sampler->flip[0] ? "yes" : "no",
            sampler->flip[1] ? "yes" : "no");
done:
    return rc;
}

enum v2v_status v2v_sampler_create(struct v2v_sampler **sampler, const struct v2v_train_job *job,
                                   int64_t unit, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_sampler *self = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(self, "sampler", 1)));
    self->settings = &job->config->train;
    V2V_TRY(add_sources(self, job, comm));
    V2V_TRY(v2v_par_agree(comm, take_memory(self, job, unit)));
done:
    if (rc != V2V_OK) {
        v2v_sampler_destroy(&self);
    }
    *sampler = self;
    return rc;
}

void v2v_sampler_destroy(struct v2v_sampler **sampler)
{
    struct v2v_sampler *self = *sampler;
    if (self == NULL) {
        return;
    }
    for (int64_t i = 0; i < self->slots && self->slot != NULL; i++) {
        v2v_mem_free(self->slot[i]);
    }
    v2v_mem_free(self->slot);
    v2v_mem_free(self->slot_frame);
    v2v_mem_free(self->scratch);
    v2v_mem_free(self->partner[0]);
    v2v_mem_free(self->partner[1]);
    v2v_mem_free(self->source);
    v2v_mem_free(self);
    *sampler = NULL;
}

int64_t v2v_sampler_room(const struct v2v_sampler *sampler)
{
    return sampler->slots * sampler->views * sampler->frame_pixels;
}

int64_t v2v_sampler_height(const struct v2v_sampler *sampler)
{
    return sampler->height;
}

int64_t v2v_sampler_width(const struct v2v_sampler *sampler)
{
    return sampler->width;
}

struct v2v_window v2v_sampler_window(const struct v2v_sampler *sampler)
{
    const struct v2v_recording_info *info = info_of(&sampler->source[0]);
    int64_t halo = sampler->settings->halo;
    if (sampler->settings->crop == 0) {
        return (struct v2v_window){0, info->height, 0, info->width};
    }
    return (struct v2v_window){halo, sampler->height - halo, halo, sampler->width - halo};
}

/* The frame with this number among all recordings' frames, scaled; read when it is not kept. */
static enum v2v_status keep_frame(struct v2v_sampler *sampler, const struct source *source,
                                  int64_t frame, const float **data)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = info_of(source);
    int64_t count = info->views * info->height * info->width;
    for (int64_t i = 0; i < sampler->slots; i++) {
        if (sampler->slot_frame[i] == frame) {
            *data = sampler->slot[i];
            return V2V_OK;
        }
    }
    int64_t slot = sampler->next_slot;
    sampler->next_slot = (slot + 1) % sampler->slots;
    sampler->slot_frame[slot] = -1;
    if (sampler->slot[slot] == NULL) {
        V2V_TRY(V2V_ALLOC(sampler->slot[slot], "sampler.frames",
                          sampler->views * sampler->frame_pixels));
    }
    V2V_TRY(v2v_recording_read(source->recording, sampler->slot[slot], frame - source->first));
    v2v_scaling_apply(&source->scaling, sampler->slot[slot], count);
    sampler->slot_frame[slot] = frame;
    *data = sampler->slot[slot];
done:
    return rc;
}

static const struct source *source_of(const struct v2v_sampler *sampler, int64_t frame)
{
    const struct source *source = &sampler->source[0];
    for (int64_t i = 1; i < sampler->source_count && sampler->source[i].first <= frame; i++) {
        source = &sampler->source[i];
    }
    return source;
}

static void copy_crop(float *out, const float *frame, const struct v2v_recording_info *info,
                      int64_t y0, int64_t x0, int64_t height, int64_t width)
{
    for (int64_t row = 0; row < info->views * height; row++) {
        int64_t v = row / height, y = y0 + row % height;
        memcpy(out + row * width, frame + (v * info->height + y) * info->width + x0,
               (size_t)width * sizeof *out);
    }
}

/* Sum of all views over a crop. */
static double brightness(const float *frame, const struct v2v_recording_info *info,
                         struct corner corner, int64_t height, int64_t width)
{
    double sum = 0.0;
    for (int64_t row = 0; row < info->views * height; row++) {
        int64_t v = row / height, y = corner.y + row % height;
        const float *from = frame + (v * info->height + y) * info->width + corner.x;
        float line = 0.0f;
#pragma omp simd reduction(+ : line)
        for (int64_t x = 0; x < width; x++) {
            line += from[x];
        }
        sum += line;
    }
    return sum;
}

/* The brightest of the candidates: most crops of a sparse scene hold background only. */
static struct corner choose_corner(const struct v2v_sampler *sampler, const float *frame,
                                   const struct v2v_recording_info *info, uint64_t stream)
{
    uint64_t seed = (uint64_t)sampler->settings->seed;
    int64_t height = sampler->height, width = sampler->width;
    struct corner best = {0, 0};
    double most = -INFINITY;
    for (int64_t i = 0; i < sampler->settings->candidates; i++) {
        uint64_t draw = (uint64_t)(i * DRAWS);
        struct corner corner = {
            v2v_random_below(seed, stream, draw + DRAW_Y, info->height - height + 1),
            v2v_random_below(seed, stream, draw + DRAW_X, info->width - width + 1)};
        double light = sampler->settings->candidates > 1
                           ? brightness(frame, info, corner, height, width)
                           : 0.0;
        if (light > most) {
            most = light;
            best = corner;
        }
    }
    return best;
}

/* View v, mirrored, becomes its partner. */
static void flip(float *out, const float *in, const int32_t *partner, int axis, int64_t views,
                 int64_t height, int64_t width)
{
    for (int64_t row = 0; row < views * height; row++) {
        int64_t v = row / height, y = row % height;
        int64_t to_y = axis == 0 ? height - 1 - y : y;
        const float *from = in + row * width;
        float *to = out + (partner[v] * height + to_y) * width;
        for (int64_t x = 0; x < width; x++) {
            to[axis == 1 ? width - 1 - x : x] = from[x];
        }
    }
}

enum v2v_status v2v_sampler_draw(struct v2v_sampler *sampler, float *views, int64_t step,
                                 int64_t index)
{
    enum v2v_status rc = V2V_OK;
    const float *data = NULL;
    uint64_t seed = (uint64_t)sampler->settings->seed;
    uint64_t stream = (uint64_t)(step * sampler->settings->batch + index);
    int64_t height = sampler->height, width = sampler->width;
    int64_t frame = v2v_random_below(seed, stream, DRAW_FRAME, sampler->frames);
    const struct source *source = source_of(sampler, frame);
    const struct v2v_recording_info *info = info_of(source);
    V2V_TRY(keep_frame(sampler, source, frame, &data));
    if (sampler->settings->crop == 0) {
        v2v_pad_reflect(views, data, info->views, info->height, info->width, height, width);
    } else {
        struct corner corner = choose_corner(sampler, data, info, stream);
        copy_crop(views, data, info, corner.y, corner.x, height, width);
    }
    for (int axis = 0; axis < AXES; axis++) {
        if (sampler->flip[axis] &&
            v2v_random_below(seed, stream, (uint64_t)(DRAW_FLIP_Y + axis), 2) == 1) {
            flip(sampler->scratch, views, sampler->partner[axis], axis, info->views, height, width);
            memcpy(views, sampler->scratch, (size_t)(info->views * height * width) * sizeof *views);
        }
    }
done:
    return rc;
}
