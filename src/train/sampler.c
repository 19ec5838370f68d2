#include "train/sampler.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/optics/shifts.h"
#include "v2v3d/tensor/pad.h"

#include <math.h>
#include <string.h>

/* Frames kept in memory: recordings up to this many bytes are read once. */
#define KEPT_BYTES ((int64_t)2 << 30)

enum { AXES = 2 };
enum { DRAW_FRAME, DRAW_Y, DRAW_X, DRAW_FLIP_Y, DRAW_FLIP_X, DRAWS };
enum { DRAW_TRANSPOSE = DRAWS + DRAW_FRAME }; /* of the second candidate, which is of that frame */

struct corner {
    int64_t y, x; /* upper left pixel of a crop */
};

struct v2v_sampler {
    const struct v2v_train_settings *settings;
    struct v2v_sources sources;
    struct v2v_examples *examples; /* kept and drawn from instead of frames; NULL: frames */
    int64_t a_frame;               /* how many are made of a frame; of frames: 1 */
    int64_t images;                /* of a sample: views, or those of an example */
    int64_t height, width;         /* of a sample */
    int is_whole;                  /* bool: samples are frames, padded; else crops */
    int flip[AXES];                /* y, x: physical and wanted */
    int64_t moves[AXES];           /* of what should come out, when it is mirrored, pixels */
    int can_transpose;             /* bool: y and x may change places */
    int32_t *partner[AXES];        /* [image] */
    float **slot;                  /* kept frames [v,y,x], scaled, or examples; NULL until read */
    int64_t *slot_number;          /* of the frame or example that a slot holds, -1 none */
    int64_t slots, next_slot;
    float *scratch; /* [v,height,width] */
    float *image;   /* of the largest frame, where every frame has a level of its own; else NULL */
};

/* Images of a sample that go in; the others should come out. */
static int64_t inputs_of(const struct v2v_sampler *sampler)
{
    return sampler->examples != NULL ? sampler->examples->inputs : sampler->images;
}

/* A crop that is left open has the network's sides, or the most multiples of the unit that are in
 * every frame; where the halo leaves nothing of such a one, frames are taken whole. */
static enum v2v_status choose_sides(struct v2v_sampler *sampler, struct v2v_sample_sides sides)
{
    const struct v2v_recording_info *first = v2v_source_info(&sampler->sources.list[0]);
    const int64_t crop = sampler->settings->crop, twice = 2 * sampler->settings->halo;
    const int64_t most = crop == V2V_WHOLE_AUTO ? sides.crop : crop;
    int64_t height = most, width = most;
    if (most > 0 && most <= twice) {
        return V2V_FAIL(V2V_E_CONFIG, "train.halo: %lld leaves nothing of a train.crop of %lld",
                        (long long)sampler->settings->halo, (long long)most);
    }
    for (int64_t i = 0; i < sampler->sources.count && crop == V2V_WHOLE_AUTO; i++) {
        const struct v2v_recording_info *info = v2v_source_info(&sampler->sources.list[i]);
        height = v2v_smaller(height, info->height / sides.unit * sides.unit);
        width = v2v_smaller(width, info->width / sides.unit * sides.unit);
    }
    sampler->is_whole = v2v_smaller(height, width) <= twice;
    sampler->height = sampler->is_whole ? v2v_round_up(first->height, sides.unit) : height;
    sampler->width = sampler->is_whole ? v2v_round_up(first->width, sides.unit) : width;
    return V2V_OK;
}

static enum v2v_status check_sides(const struct v2v_sampler *sampler)
{
    const struct v2v_recording_info *first = v2v_source_info(&sampler->sources.list[0]);
    const int64_t crop = sampler->settings->crop;
    for (int64_t i = 0; i < sampler->sources.count; i++) {
        const struct v2v_recording_info *info = v2v_source_info(&sampler->sources.list[i]);
        if (crop > 0 && (info->height < crop || info->width < crop)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "recording %lld has frames of %lld x %lld, smaller than train.crop = "
                            "%lld; auto, as it is by itself, takes what fits",
                            (long long)i + 1, (long long)info->height, (long long)info->width,
                            (long long)crop);
        }
        if (sampler->is_whole && (info->height != first->height || info->width != first->width)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "train.crop = 0, and auto of frames smaller than a crop, take "
                            "recordings of one frame size; recording %lld has another than the "
                            "first",
                            (long long)i + 1);
        }
    }
    return V2V_OK;
}

/* Views trade places when they are mirrored, where the PSFs allow it; other images are mirrored as
 * such. */
static enum v2v_status plan_flips(struct v2v_sampler *sampler, const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    const int mirroring =
        sampler->examples != NULL ? sampler->examples->ops->mirroring : V2V_MIRROR_VIEWS;
    const int wanted = sampler->settings->flips && !sampler->is_whole;
    for (int axis = 0; axis < AXES; axis++) {
        V2V_TRY(V2V_ALLOC(sampler->partner[axis], "sampler.flips", sampler->images));
        for (int64_t i = 0; i < sampler->images; i++) {
            sampler->partner[axis][i] = (int32_t)i;
        }
        sampler->flip[axis] =
            wanted && (mirroring == V2V_MIRROR_IMAGES ||
                       v2v_shifts_flip_partner(sampler->partner[axis], job->psf, axis,
                                               sampler->settings->flip_tolerance));
        if (sampler->flip[axis] && inputs_of(sampler) < sampler->images &&
            mirroring == V2V_MIRROR_VIEWS) {
            sampler->moves[axis] = v2v_shifts_flip_moves(job->psf, axis);
        }
    }
    sampler->can_transpose =
        wanted && mirroring == V2V_MIRROR_IMAGES && sampler->height == sampler->width;
    v2v_log(V2V_LOG_INFO, "samples of %lld x %lld, flips: y %s, x %s", (long long)sampler->height,
            (long long)sampler->width, sampler->flip[0] ? "yes" : "no",
            sampler->flip[1] ? "yes" : "no");
done:
    return rc;
}

/* Frames or examples that there are to draw from, if memory holds them. */
static int64_t count_numbers(const struct v2v_sampler *sampler)
{
    const int64_t steps_of_one =
        sampler->examples != NULL ? sampler->examples->ops->steps_of_one : 0;
    return steps_of_one > 0
               ? v2v_parts(sampler->settings->steps, steps_of_one) * sampler->settings->batch
               : sampler->sources.frames * sampler->a_frame;
}

static enum v2v_status take_memory(struct v2v_sampler *sampler, const struct v2v_train_job *job,
                                   const struct v2v_examples_ops *kind)
{
    enum v2v_status rc = V2V_OK;
    sampler->images = job->psf->views;
    sampler->a_frame = 1;
    if (kind != NULL) {
        sampler->images = sampler->examples->inputs + sampler->examples->outputs;
        sampler->a_frame = kind->is_of_view ? job->psf->views : 1;
    }
    const int64_t bytes =
        v2v_mem_product(sampler->images, sampler->sources.frame_pixels, sizeof(float));
    size_t most = (size_t)KEPT_BYTES;
    if (v2v_mem_room() / 2 < most) { /* the rest is for the network */
        most = v2v_mem_room() / 2;
    }
    int64_t fit = (int64_t)most / bytes;
    sampler->slots = v2v_within(fit, 1, count_numbers(sampler));
    if (kind != NULL && kind->steps_of_one > 0 && sampler->slots < count_numbers(sampler)) {
        v2v_log(V2V_LOG_INFO, "lessons: %lld of %.2f GB each, not %lld: %.2f GB hold no more",
                (long long)sampler->slots, 1e-9 * (double)bytes, (long long)count_numbers(sampler),
                1e-9 * (double)most);
    }
    V2V_TRY(V2V_ALLOC(sampler->slot, "sampler.frames", sampler->slots));
    V2V_TRY(V2V_ALLOC(sampler->slot_number, "sampler.frames", sampler->slots));
    V2V_TRY(V2V_ALLOC(sampler->scratch, "sampler.scratch",
                      v2v_mem_product(sampler->images, sampler->height, sampler->width)));
    if (job->config->model.homogeneous && kind == NULL) {
        V2V_TRY(V2V_ALLOC(sampler->image, "sampler.scratch", sampler->sources.frame_pixels));
    }
    for (int64_t i = 0; i < sampler->slots; i++) {
        sampler->slot_number[i] = -1;
    }
    V2V_TRY(plan_flips(sampler, job));
done:
    return rc;
}

enum v2v_status v2v_sampler_create(struct v2v_sampler **sampler, const struct v2v_train_job *job,
                                   struct v2v_sample_sides sides,
                                   const struct v2v_examples_ops *kind, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_sampler *self = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(self, "sampler", 1)));
    self->settings = &job->config->train;
    if (kind != NULL) {
        V2V_TRY(
            v2v_par_agree(comm, v2v_examples_create(&self->examples, kind, job->config, job->psf)));
    }
    V2V_TRY(v2v_sources_init(&self->sources, job, self->examples, comm));
    V2V_TRY(v2v_par_agree(comm, choose_sides(self, sides)));
    V2V_TRY(v2v_par_agree(comm, check_sides(self)));
    V2V_TRY(v2v_par_agree(comm, take_memory(self, job, kind)));
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
    v2v_mem_free(self->slot_number);
    v2v_mem_free(self->scratch);
    v2v_mem_free(self->image);
    v2v_mem_free(self->partner[0]);
    v2v_mem_free(self->partner[1]);
    v2v_sources_fini(&self->sources);
    v2v_examples_destroy(&self->examples);
    v2v_mem_free(self);
    *sampler = NULL;
}

int64_t v2v_sampler_room(const struct v2v_sampler *sampler)
{
    return sampler->slots * sampler->images * sampler->sources.frame_pixels;
}

const struct v2v_sources *v2v_sampler_sources(const struct v2v_sampler *sampler)
{
    return &sampler->sources;
}

int64_t v2v_sampler_images(const struct v2v_sampler *sampler)
{
    return sampler->images;
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
    const struct v2v_recording_info *info = v2v_source_info(&sampler->sources.list[0]);
    int64_t halo = sampler->settings->halo;
    if (sampler->is_whole) {
        return (struct v2v_window){0, info->height, 0, info->width};
    }
    return (struct v2v_window){halo, sampler->height - halo, halo, sampler->width - halo};
}

/* What a sample is a crop of: a frame, or an example of it. */
struct choice {
    int64_t frame;  /* among all recordings' frames */
    int64_t number; /* what it is kept under */
    int64_t within; /* the example's number, for who makes it */
};

/* The frame, scaled, or the example made of it. */
static enum v2v_status make(struct v2v_sampler *sampler, float *data, const struct choice *choice)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_source *source = v2v_sources_of(&sampler->sources, choice->frame);
    const struct v2v_recording_info *info = v2v_source_info(source);
    const int64_t t = choice->frame - source->first;
    if (sampler->examples != NULL) {
        return sampler->examples->ops->make(sampler->examples, data, &source->of, t,
                                            choice->within);
    }
    V2V_TRY(v2v_scaling_read_dark(&source->of.scaling, source->of.recording, data, NULL, t));
    if (sampler->image != NULL) {
        (void)v2v_scaling_level(data, sampler->image, info->views, info->height, info->width);
    }
done:
    return rc;
}

/* The same, made when it is not kept. */
static enum v2v_status keep(struct v2v_sampler *sampler, const float **data,
                            const struct choice *choice)
{
    enum v2v_status rc = V2V_OK;
    for (int64_t i = 0; i < sampler->slots; i++) {
        if (sampler->slot_number[i] == choice->number) {
            *data = sampler->slot[i];
            return V2V_OK;
        }
    }
    int64_t slot = sampler->next_slot;
    sampler->next_slot = (slot + 1) % sampler->slots;
    sampler->slot_number[slot] = -1;
    if (sampler->slot[slot] == NULL) {
        V2V_TRY(V2V_ALLOC(sampler->slot[slot], "sampler.frames",
                          sampler->images * sampler->sources.frame_pixels));
    }
    V2V_TRY(make(sampler, sampler->slot[slot], choice));
    sampler->slot_number[slot] = choice->number;
    *data = sampler->slot[slot];
done:
    return rc;
}

static void copy_crop(float *out, const float *frame, const struct v2v_recording_info *info,
                      int64_t images, struct corner corner, int64_t height, int64_t width)
{
    for (int64_t row = 0; row < images * height; row++) {
        int64_t i = row / height, y = corner.y + row % height;
        memcpy(out + row * width, frame + (i * info->height + y) * info->width + corner.x,
               (size_t)width * sizeof *out);
    }
}

/* Sum of all images over a crop. */
static double brightness(const float *frame, const struct v2v_recording_info *info, int64_t images,
                         struct corner corner, int64_t height, int64_t width)
{
    double sum = 0.0;
    for (int64_t row = 0; row < images * height; row++) {
        int64_t i = row / height, y = corner.y + row % height;
        const float *from = frame + (i * info->height + y) * info->width + corner.x;
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
                           ? brightness(frame, info, sampler->images, corner, height, width)
                           : 0.0;
        if (light > most) {
            most = light;
            best = corner;
        }
    }
    return best;
}

/* Which flips the sample has; none that would bring in what is beyond the frame.
 * @return the corner of what should come out */
static struct corner choose_flips(const struct v2v_sampler *sampler, int flips[AXES],
                                  struct corner corner, const struct v2v_recording_info *info,
                                  uint64_t stream)
{
    const uint64_t seed = (uint64_t)sampler->settings->seed;
    const int64_t last[AXES] = {info->height - sampler->height, info->width - sampler->width};
    int64_t at[AXES] = {corner.y, corner.x};
    for (int axis = 0; axis < AXES; axis++) {
        const int64_t moved = at[axis] + sampler->moves[axis];
        flips[axis] = sampler->flip[axis] && moved >= 0 && moved <= last[axis] &&
                      v2v_random_below(seed, stream, (uint64_t)(DRAW_FLIP_Y + axis), 2) == 1;
        at[axis] = flips[axis] ? moved : at[axis];
    }
    return (struct corner){at[0], at[1]};
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

static void transpose(float *image, int64_t side)
{
    for (int64_t y = 1; y < side; y++) {
        for (int64_t x = 0; x < y; x++) {
            const float pixel = image[y * side + x];
            image[y * side + x] = image[x * side + y];
            image[x * side + y] = pixel;
        }
    }
}

/* One of those that take time to make: one more at a time, of those with which this sample of every
 * step begins, so that ranks make none that others make. */
static struct choice choose_of_known(const struct v2v_sampler *sampler, uint64_t stream,
                                     int64_t step, int64_t index)
{
    const int64_t steps_of_one = sampler->examples->ops->steps_of_one;
    const int64_t rows = v2v_smaller(sampler->settings->batch, sampler->slots);
    const int64_t known = v2v_smaller(step / steps_of_one + 1, sampler->slots / rows);
    const uint64_t seed = (uint64_t)sampler->settings->seed;
    const int64_t number = rows * v2v_random_below(seed, stream, DRAW_FRAME, known) + index % rows;
    const uint64_t of_frame = v2v_random_fnv1a64("lessons") + (uint64_t)number;
    return (struct choice){
        .frame = v2v_random_below(seed, of_frame, DRAW_FRAME, sampler->sources.frames),
        .number = number,
        .within = number};
}

static struct choice choose(const struct v2v_sampler *sampler, uint64_t stream, int64_t step,
                            int64_t index)
{
    if (sampler->examples != NULL && sampler->examples->ops->steps_of_one > 0) {
        return choose_of_known(sampler, stream, step, index);
    }
    const int64_t number = v2v_random_below((uint64_t)sampler->settings->seed, stream, DRAW_FRAME,
                                            sampler->sources.frames * sampler->a_frame);
    return (struct choice){
        .frame = number / sampler->a_frame, .number = number, .within = number % sampler->a_frame};
}

enum v2v_status v2v_sampler_draw(struct v2v_sampler *sampler, float *images, int64_t step,
                                 int64_t index)
{
    enum v2v_status rc = V2V_OK;
    const float *data = NULL;
    const struct v2v_train_settings *settings = sampler->settings;
    uint64_t seed = (uint64_t)settings->seed;
    uint64_t stream = (uint64_t)(step * settings->batch + index);
    int64_t height = sampler->height, width = sampler->width;
    int flips[AXES] = {0};
    const struct choice choice = choose(sampler, stream, step, index);
    const struct v2v_recording_info *info =
        v2v_source_info(v2v_sources_of(&sampler->sources, choice.frame));
    V2V_TRY(keep(sampler, &data, &choice));
    if (sampler->is_whole) {
        v2v_pad_reflect(images, data, sampler->images, info->height, info->width, height, width);
    } else {
        const int64_t inputs = inputs_of(sampler), pixels = info->height * info->width;
        const struct corner corner = choose_corner(sampler, data, info, stream);
        const struct corner known = choose_flips(sampler, flips, corner, info, stream);
        copy_crop(images, data, info, inputs, corner, height, width);
        copy_crop(images + inputs * height * width, data + inputs * pixels, info,
                  sampler->images - inputs, known, height, width);
    }
    for (int axis = 0; axis < AXES; axis++) {
        if (flips[axis]) {
            flip(sampler->scratch, images, sampler->partner[axis], axis, sampler->images, height,
                 width);
            memcpy(images, sampler->scratch,
                   (size_t)(sampler->images * height * width) * sizeof *images);
        }
    }
    if (sampler->can_transpose && v2v_random_below(seed, stream, DRAW_TRANSPOSE, 2) == 1) {
        for (int64_t i = 0; i < sampler->images; i++) {
            transpose(images + i * height * width, width);
        }
    }
done:
    return rc;
}
