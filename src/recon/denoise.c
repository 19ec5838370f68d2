#include "v2v3d/recon/denoise.h"

#include "recon/tiling.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Pixels of a tile's side, and of its ring that is not kept: networks were taught by crops of about
 * this size, whose edges they know as zeros. */
enum { TILE = 160, MARGIN = 24 };

struct denoiser {
    const struct v2v_denoise_job *job;
    const struct v2v_comm *comm;
    const struct v2v_recording_info *info;
    struct v2v_psf_file views; /* no optics: as many views as the recording has */
    struct v2v_examples *examples;
    struct v2v_network *network;
    struct v2v_tiling of_time, of_rows, of_columns;
    int64_t shares;   /* of the views of a tile in time, for different ranks */
    int64_t most;     /* views of a share */
    float *frames;    /* [n,v,y,x]: of a tile in time, scaled */
    float *images;    /* [input,y,x] */
    float *result;    /* [views of a share,n,y,x] */
    float *tile;      /* [input,rows,columns] */
    float *made;      /* [n,rows,columns] */
    float *clean;     /* [v,y,x]; NULL: there is none */
    double errors[2]; /* sums of squares, before and after */
    double peak;
    struct v2v_recording_writer *writer;
};

/* One tile in time of some of the views. */
struct unit {
    int64_t first;         /* frame of the tile */
    struct v2v_part views; /* none: nothing is to do */
    struct v2v_part kept;  /* frames */
};

static struct unit unit_of(const struct denoiser *self, int64_t number)
{
    const int64_t tile = number / self->shares;
    if (tile >= self->of_time.count) {
        return (struct unit){0};
    }
    return (struct unit){.first = v2v_tiling_start(&self->of_time, tile),
                         .views =
                             v2v_par_part(self->info->views, self->shares, number % self->shares),
                         .kept = v2v_tiling_kept(&self->of_time, tile)};
}

/* ---- plan ---- */

static enum v2v_status check(const struct denoiser *self)
{
    const struct v2v_denoise_job *job = self->job;
    const struct v2v_recording_info *info = self->info;
    if (job->clean == NULL) {
        return V2V_OK;
    }
    const struct v2v_recording_info *clean = v2v_recording_info(job->clean);
    if (clean->frames != info->frames || clean->views != info->views ||
        clean->height != info->height || clean->width != info->width) {
        return V2V_FAIL(V2V_E_INPUT,
                        "the clean recording has %lld frames of %lld x %lld x %lld, the noisy one "
                        "%lld of %lld x %lld x %lld",
                        (long long)clean->frames, (long long)clean->views, (long long)clean->height,
                        (long long)clean->width, (long long)info->frames, (long long)info->views,
                        (long long)info->height, (long long)info->width);
    }
    return V2V_OK;
}

/* Where cameras are, settings tell, or else how many they are: of other views than those of the
 * training that may be wrong. */
static enum v2v_status look_at_cameras(const struct denoiser *self,
                                       const struct v2v_network_ops *ops)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info;
    V2V_TRY(v2v_weights_file_info(&info, self->job->weights));
    if (ops->examples->needs_cameras && info.views > 0 && info.views != self->views.views &&
        v2v_comm_rank(self->comm) == 0) {
        v2v_log(V2V_LOG_WARNING,
                "%s: taught by %lld views, not %lld: are the cameras of these where "
                "synthesis.cameras has them (auto: a square grid)?",
                self->job->weights, (long long)info.views, (long long)self->views.views);
    }
done:
    return rc;
}

static enum v2v_status create_network(struct denoiser *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_denoise_job *job = self->job;
    const struct v2v_network_ops *ops = NULL;
    struct v2v_grid_work work;
    const struct v2v_network_spec spec = {.config = job->config,
                                          .psf = &self->views,
                                          .views = self->views.views,
                                          .slices = self->views.slices,
                                          .outputs = V2V_NETWORK_ALL,
                                          .precision = V2V_PRECISION_F32};
    V2V_TRY(v2v_network_find(&ops, job->config->model.method));
    V2V_ASSERT((ops->traits & V2V_TRAIT_VIEWS) != 0 && ops->examples->inputs_of_view != NULL);
    V2V_TRY(v2v_examples_create(&self->examples, ops->examples, job->config, &self->views));
    V2V_TRY(look_at_cameras(self, ops));
    V2V_TRY(v2v_network_create(&self->network, ops->name, &spec));
    V2V_TRY(v2v_weights_file_read(self->network->weights, job->weights, "weights",
                                  &self->network->schema.fields));
    ops->describe_work(&work, &spec, TILE, TILE);
    const int64_t size = v2v_round_up(TILE, work.unit), n = self->examples->outputs;
    const int64_t height = v2v_round_up(self->info->height, work.unit);
    const int64_t width = v2v_round_up(self->info->width, work.unit);
    self->of_time = v2v_tiling_of(self->info->frames, n, n / 4);
    self->of_rows = v2v_tiling_of(self->info->height, v2v_smaller(size, height), MARGIN);
    self->of_columns = v2v_tiling_of(self->info->width, v2v_smaller(size, width), MARGIN);
    const struct v2v_network_plan plan = {.height = self->of_rows.size,
                                          .width = self->of_columns.size};
    V2V_TRY(ops->plan(self->network, &plan));
    ops->weights_changed(self->network);
done:
    return rc;
}

static enum v2v_status take_memory(struct denoiser *self)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = self->info;
    const int64_t n = self->examples->outputs, inputs = self->examples->inputs;
    const int64_t pixels = v2v_mem_product(info->height, info->width, 1);
    const int64_t in_tile = v2v_mem_product(self->of_rows.size, self->of_columns.size, 1);
    const int64_t ranks = v2v_comm_size(self->comm);
    self->shares = v2v_within(v2v_parts(ranks, self->of_time.count), 1, info->views);
    self->most = v2v_parts(info->views, self->shares);
    V2V_TRY(V2V_ALLOC(self->frames, "denoise.frames", v2v_mem_product(n, info->views, pixels)));
    V2V_TRY(V2V_ALLOC(self->images, "denoise.images", v2v_mem_product(inputs, pixels, 1)));
    V2V_TRY(V2V_ALLOC(self->result, "denoise.frames", v2v_mem_product(self->most, n, pixels)));
    V2V_TRY(V2V_ALLOC(self->tile, "denoise.tiles", v2v_mem_product(inputs, in_tile, 1)));
    V2V_TRY(V2V_ALLOC(self->made, "denoise.tiles", v2v_mem_product(n, in_tile, 1)));
    if (self->job->clean != NULL) {
        V2V_TRY(V2V_ALLOC(self->clean, "denoise.clean", v2v_mem_product(info->views, pixels, 1)));
    }
done:
    return rc;
}

static void fini(struct denoiser *self)
{
    v2v_recording_abandon(&self->writer);
    v2v_network_destroy(&self->network);
    v2v_examples_destroy(&self->examples);
    float *memory[] = {self->frames, self->images, self->result,
                       self->tile,   self->made,   self->clean};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
}

/* ---- a unit ---- */

/* The frames of a tile in time; a recording that is shorter goes on backwards. */
static enum v2v_status read_frames(struct denoiser *self, int64_t first)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = self->info;
    const int64_t samples = info->views * info->height * info->width;
    const int64_t period = v2v_larger(2 * (info->frames - 1), 1);
    for (int64_t i = 0; i < self->examples->outputs; i++) {
        const int64_t at = (first + i) % period;
        const int64_t t = at < info->frames ? at : period - at;
        v2v_watchdog_beat("reading a frame");
        V2V_TRY(v2v_recording_read(self->job->recording, self->frames + i * samples, t));
        v2v_scaling_apply(self->job->scaling, self->frames + i * samples, samples);
    }
done:
    return rc;
}

/* Cut the tile out of the images; past the frame it is mirrored. */
static void cut(struct denoiser *self, int64_t y0, int64_t x0)
{
    const int64_t height = self->info->height, width = self->info->width;
    const int64_t rows = self->of_rows.size, columns = self->of_columns.size;
    const int64_t inside = v2v_smaller(rows, height), across = v2v_smaller(columns, width);
    if (inside == rows && across == columns) {
        for (int64_t row = 0; row < self->examples->inputs * rows; row++) {
            const float *from = self->images + (row / rows * height + y0 + row % rows) * width + x0;
            memcpy(self->tile + row * columns, from, (size_t)columns * sizeof *from);
        }
        return;
    }
    for (int64_t i = 0; i < self->examples->inputs; i++) { /* one that is larger than the frame */
        float *to = self->tile + i * rows * columns;
        const float *image = self->images + i * height * width;
        for (int64_t y = 0; y < rows; y++) {
            const int64_t from_y = y0 + y < height ? y0 + y : 2 * (height - 1) - y0 - y;
            for (int64_t x = 0; x < columns; x++) {
                const int64_t from_x = x0 + x < width ? x0 + x : 2 * (width - 1) - x0 - x;
                to[y * columns + x] = image[v2v_larger(from_y, 0) * width + v2v_larger(from_x, 0)];
            }
        }
    }
}

/* What is kept of the tile, into frames [n,y,x] of a view. */
static void paste(const struct denoiser *self, float *frames, int64_t row, int64_t column)
{
    const int64_t height = self->info->height, width = self->info->width;
    const int64_t rows = self->of_rows.size, columns = self->of_columns.size;
    const int64_t y0 = v2v_tiling_start(&self->of_rows, row);
    const int64_t x0 = v2v_tiling_start(&self->of_columns, column);
    const struct v2v_part ys = v2v_tiling_kept(&self->of_rows, row);
    const struct v2v_part xs = v2v_tiling_kept(&self->of_columns, column);
    for (int64_t i = 0; i < self->examples->outputs; i++) {
        for (int64_t y = ys.first; y < ys.first + ys.count; y++) {
            memcpy(frames + (i * height + y) * width + xs.first,
                   self->made + (i * rows + y - y0) * columns + xs.first - x0,
                   (size_t)xs.count * sizeof *frames);
        }
    }
}

/* All tiles of view v. */
static enum v2v_status make_view(struct denoiser *self, float *frames, int64_t v)
{
    const struct v2v_network *network = self->network;
    float *made[V2V_NETWORK_MOST_OUTPUTS] = {self->made};
    self->examples->ops->inputs_of_view(self->examples, self->images, self->frames, v,
                                        self->info->height, self->info->width);
    for (int64_t row = 0; row < self->of_rows.count; row++) {
        for (int64_t column = 0; column < self->of_columns.count; column++) {
            v2v_watchdog_beat("denoising a tile");
            if (v2v_stop_requested()) {
                return V2V_FAIL(V2V_STOPPED, "stopped on request; nothing is kept");
            }
            cut(self, v2v_tiling_start(&self->of_rows, row),
                v2v_tiling_start(&self->of_columns, column));
            network->ops->forward(self->network, made, self->tile);
            paste(self, frames, row, column);
        }
    }
    return V2V_OK;
}

/* Back to the recording's units. */
static enum v2v_status scale_back(float *x, int64_t count, const struct v2v_scaling *scaling)
{
    const float factor = (float)(1.0 / scaling->gain), offset = (float)scaling->offset;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        x[i] = x[i] * factor + offset;
    }
    return v2v_first_not_finite(x, count) < 0
               ? V2V_OK
               : V2V_FAIL(V2V_E_NUMERIC, "the network made NaN or Inf");
}

/* The views of a unit. Local. */
static enum v2v_status make_unit(struct denoiser *self, const struct unit *unit)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = self->info->height * self->info->width;
    const int64_t a_view = self->examples->outputs * pixels;
    V2V_TRY(V2V_FAULT_POINT("denoise.unit"));
    V2V_TRY(read_frames(self, unit->first));
    for (int64_t i = 0; i < unit->views.count; i++) {
        V2V_TRY(make_view(self, self->result + i * a_view, unit->views.first + i));
    }
    V2V_TRY(scale_back(self->result, unit->views.count * a_view, self->job->scaling));
done:
    return rc;
}

/* ---- what comes of it ---- */

/* @param apart of the zeros of a and b */
static double squares(const float *a, const float *b, int64_t count, double apart)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double difference = (double)a[i] - (double)b[i] - apart;
        sum += difference * difference;
    }
    return sum;
}

/* Frame t of these views, before and after; `after` begins with the first of them, and may be where
 * the frames are. */
static enum v2v_status compare(struct denoiser *self, const float *after, int64_t t,
                               struct v2v_part views)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = self->info->height * self->info->width;
    const int64_t at = views.first * pixels, count = views.count * pixels;
    const double zero = self->job->zero_of_clean, apart = self->job->scaling->offset - zero;
    if (self->clean == NULL || views.count == 0) {
        return V2V_OK;
    }
    V2V_TRY(v2v_recording_read(self->job->clean, self->clean, t));
    self->errors[1] += squares(after, self->clean + at, count, apart);
    for (int64_t i = 0; i < count; i++) {
        self->peak = fmax(self->peak, (double)self->clean[at + i] - zero);
    }
    V2V_TRY(v2v_recording_read(self->job->recording, self->frames, t)); /* read anew, unscaled */
    self->errors[0] += squares(self->frames + at, self->clean + at, count, apart);
done:
    return rc;
}

/* The kept frames of all ranks' units, one after the other. Collective(comm), agreed. */
static enum v2v_status put_unit(struct denoiser *self, const struct unit *unit)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = self->info->height * self->info->width, n = self->examples->outputs;
    for (int64_t i = 0; i < n; i++) {
        const int64_t t = unit->first + i;
        const int is_kept = t >= unit->kept.first && t < unit->kept.first + unit->kept.count;
        const struct v2v_part views = is_kept ? unit->views : (struct v2v_part){0, 0};
        for (int64_t k = 0; k < views.count; k++) { /* the images are free again */
            memcpy(self->frames + k * pixels, self->result + (k * n + i) * pixels,
                   (size_t)pixels * sizeof(float));
        }
        V2V_TRY(v2v_recording_write(self->writer, self->frames, is_kept ? t : 0, views.first,
                                    views.count));
        V2V_TRY(v2v_par_agree(self->comm, compare(self, self->frames, t, views)));
    }
done:
    return rc;
}

/* Collective(comm). */
static void report(struct v2v_denoise_report *report, struct denoiser *self)
{
    const struct v2v_recording_info *info = self->info;
    const double samples =
        (double)(info->frames * info->views) * (double)(info->height * info->width);
    report->psnr_before = report->psnr_after = NAN;
    if (self->job->clean == NULL) {
        return;
    }
    v2v_par_sum_f64(self->comm, self->errors, 2);
    v2v_par_max_f64(self->comm, &self->peak, 1);
    if (self->peak > 0.0) { /* else nothing is clean light */
        const double most = self->peak * self->peak * samples;
        report->psnr_before = 10.0 * log10(most / self->errors[0]);
        report->psnr_after = 10.0 * log10(most / self->errors[1]);
    }
}

/* Rounds of a unit a rank. Collective(comm), agreed. */
static enum v2v_status run_rounds(struct denoiser *self)
{
    enum v2v_status rc = V2V_OK;
    const int64_t ranks = v2v_comm_size(self->comm), units = self->of_time.count * self->shares;
    struct v2v_progress progress;
    v2v_progress_begin(&progress, "denoising", 0, units);
    for (int64_t done = 0; done < units; done += ranks) {
        const struct unit unit = unit_of(self, done + v2v_comm_rank(self->comm));
        const enum v2v_status made = unit.views.count > 0 ? make_unit(self, &unit) : V2V_OK;
        V2V_TRY(v2v_par_agree(self->comm, made));
        V2V_TRY(put_unit(self, &unit));
        v2v_progress_step(&progress, v2v_smaller(done + ranks, units), NULL);
    }
done:
    v2v_progress_end(&progress);
    return rc;
}

/* What is written has the zero that was subtracted; where none was, it stays untold. */
static double zero_of(const struct v2v_denoise_job *job)
{
    const struct v2v_scaling *scaling = job->scaling;
    const int is_stated = !isnan(v2v_recording_info(job->recording)->offset);
    switch (job->config->input.offset.mode) {
    case V2V_NUMBER_GIVEN:
        return scaling->offset;
    case V2V_NUMBER_AUTO:
        return is_stated || scaling->is_guessed ? scaling->offset : (double)NAN;
    default:
        return (double)NAN;
    }
}

enum v2v_status v2v_denoise_run(const struct v2v_denoise_job *job,
                                struct v2v_denoise_report *result, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(job->recording);
    struct denoiser self = {.job = job,
                            .comm = comm,
                            .info = info,
                            .views = {.views = info->views, .slices = 1},
                            .peak = -INFINITY};
    struct v2v_recording_info written = *info;
    const double began = v2v_clock_now();
    *result = (struct v2v_denoise_report){0};
    v2v_stop_heed_ending();
    written.before = written.after = 0;
    written.is_uint16 = 0;
    written.offset = zero_of(job);
    rc = check(&self);
    if (rc == V2V_OK) {
        rc = create_network(&self);
    }
    if (rc == V2V_OK) {
        rc = take_memory(&self);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_recording_create(&self.writer, job->output, &written, comm));
    V2V_TRY(run_rounds(&self));
    report(result, &self);
    V2V_TRY(v2v_recording_finish(&self.writer));
done:
    result->seconds = v2v_clock_now() - began;
    fini(&self);
    return rc;
}
