#include "io/h5_common.h"
#include "io/stack.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/hot_pixels.h"
#include "v2v3d/tensor/warp.h"

#include <math.h>
#include <string.h>

/* A view with distortion and without, and what taking it out needs. */
enum { UNDISTORTING = 4 };

struct v2v_recording {
    struct v2v_recording_info info;
    struct v2v_stack stack;
    int64_t recorded;                          /* views of a frame .. */
    struct v2v_kept_views kept;                /* .. and those of them that are read */
    int64_t first_page;                        /* the first frame's first view */
    int64_t stride;                            /* pages from frame to frame */
    const struct v2v_calibration *calibration; /* NULL: none */
    float *as_recorded; /* [UNDISTORTING,height,width]; NULL: no view has distortion */
    double sharpness;   /* of the PSFs */
    float *samples;     /* [V2V_HOT_PIXELS_SCRATCH]; NULL: hot pixels are kept */
    uint8_t *marks;     /* [v,height,width]; NULL: not yet asked for */
    int has_told;       /* bool: of hot pixels */
};

/* Views of a frame: what the file states, which must be what is asked for; else that. A TIFF with
 * channels has the views as channels or, of the channel that is chosen, as slices; one axis alone
 * is a row of pages, but frames alone are frames where this program wrote them. */
static enum v2v_status count_views(struct v2v_recording_info *info, const struct v2v_stack *stack,
                                   const struct v2v_input_settings *settings)
{
    const int64_t asked = settings->views;
    const struct v2v_stack_axes *axes = &stack->axes;
    const int in_channels = axes->channels > 1;
    const int in_slices = axes->slices > 1 && axes->frames > 1;
    info->views = asked > 0 ? asked : stack->pages;
    if (in_channels && axes->slices > 1) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: has %lld channels and %lld slices: --channel K (from 1) takes one "
                        "channel, whose slices are the views",
                        stack->path, (long long)axes->channels, (long long)axes->slices);
    }
    if (stack->is_own && asked == 0 && axes->frames > 1 && !in_channels && !in_slices) {
        info->views = 1;
        return V2V_OK;
    }
    if (stack->is_tiff && !in_channels && !in_slices) {
        info->is_one_row = asked == 0 && stack->folder == NULL; /* a folder's layout tells them */
        return V2V_OK;
    }
    const int64_t stated = in_channels ? axes->channels : axes->slices;
    if (asked > 0 && asked != stated) {
        const char *what = in_channels ? "channels" : stack->is_tiff ? "slices" : "views";
        const int are_left = settings->without_views[0] != '\0';
        return V2V_FAIL(V2V_E_INPUT, "%s: %s has %lld %s, but %lld are asked for%s%s", stack->path,
                        stack->is_tiff ? "a frame" : stack->kind->dataset, (long long)stated, what,
                        (long long)asked, are_left ? ", those of --without-views among them" : "",
                        in_channels ? " as views; --channel K (from 1) takes one channel" : "");
    }
    info->views = stated;
    return V2V_OK;
}

/* Cut the row of pages into frames. */
static enum v2v_status lay_out(struct v2v_recording *recording,
                               const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_stack *stack = &recording->stack;
    V2V_ASSERT(settings->first_view >= 0);
    V2V_TRY(count_views(&recording->info, stack, settings));
    const int64_t views = recording->info.views;
    const int64_t stride = settings->stride > 0 ? settings->stride : views;
    const int64_t pages = stack->pages - settings->first_view;
    if (pages < views) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %lld pages, the first %lld left out, hold no frame of %lld views",
                         stack->path, (long long)stack->pages, (long long)settings->first_view,
                         (long long)views));
    }
    if (stride == views && pages % views != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %lld pages, the first %lld left out, are %lld frames of %lld views "
                         "and %lld pages more",
                         stack->path, (long long)stack->pages, (long long)settings->first_view,
                         (long long)(pages / views), (long long)views, (long long)(pages % views)));
    }
    recording->first_page = settings->first_view;
    recording->stride = stride;
    recording->info.frames = (pages - views) / stride + 1;
    recording->info.apart = v2v_parts(views, stride);
    recording->info.height = stack->height;
    recording->info.width = stack->width;
    recording->recorded = views;
    V2V_TRY(v2v_kept_views_init(&recording->kept, settings->without_views, views));
    recording->info.views = recording->kept.count;
done:
    return rc;
}

/* Pixel size, offset, and the time between frames: the file states the time between its own steps,
 * which a stride cuts or stretches. */
static enum v2v_status read_metadata(struct v2v_recording *recording,
                                     const struct v2v_input_settings *settings)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording_info *info = &recording->info;
    const struct v2v_stack *stack = &recording->stack;
    const hid_t set = stack->array.set;
    int64_t pages_per_step = stack->images;
    int has_offset = 0;
    if (stack->is_tiff) {
        info->pixel_size_um = stack->pixel_size_um;
        info->frame_interval_s = stack->frame_interval_s;
        pages_per_step = stack->axes.channels * stack->axes.slices;
    } else {
        V2V_TRY(v2v_h5_get_length(&info->pixel_size_um, set, stack->path, "pixel_size_um"));
        V2V_TRY(v2v_h5_get_length(&info->frame_interval_s, set, stack->path, "frame_interval_s"));
        V2V_TRY(v2v_h5_get_numbers(&info->offset, &has_offset, set, stack->path, "offset", 1));
    }
    info->offset = has_offset ? info->offset : (double)NAN;
    /* Of a row of slices alone the interval is that of frames which the row does not show. */
    const int is_known = recording->stride == pages_per_step || stack->axes.frames > 1;
    info->frame_interval_s *= is_known ? (double)recording->stride / (double)pages_per_step : 0.0;
    v2v_stack_told(&info->pixel_size_um, settings->pixel_size_um);
    v2v_stack_told(&info->frame_interval_s, settings->frame_interval_s);
done:
    return rc;
}

enum v2v_status v2v_recording_open(struct v2v_recording **recording, const char *path,
                                   const struct v2v_input_settings *settings,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *fresh = NULL;
    *recording = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.recording", 1)));
    V2V_TRY(v2v_stack_open(&fresh->stack, path, &v2v_h5_views, settings, comm));
    rc = lay_out(fresh, settings);
    if (rc == V2V_OK) {
        rc = read_metadata(fresh, settings);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    *recording = fresh;
    fresh = NULL;
done:
    v2v_recording_close(&fresh);
    return rc;
}

const char *v2v_recording_path(const struct v2v_recording *recording)
{
    return recording->stack.path;
}

const struct v2v_recording_info *v2v_recording_info(const struct v2v_recording *recording)
{
    return &recording->info;
}

enum v2v_status v2v_recording_has_frame(const struct v2v_recording *recording, int64_t t)
{
    const int64_t frames = recording->info.frames;
    return t < frames ? V2V_OK
                      : V2V_FAIL(V2V_E_INPUT, "%s: there is no frame %lld: it has %lld, from 0",
                                 recording->stack.path, (long long)t, (long long)frames);
}

enum v2v_status v2v_recording_cut(struct v2v_recording *recording, int64_t first, int64_t count)
{
    struct v2v_recording_info *info = &recording->info;
    V2V_ASSERT(first >= 0 && count > 0);
    const enum v2v_status rc = v2v_recording_has_frame(recording, first);
    if (rc == V2V_OK) {
        const int64_t rest = info->frames - first;
        info->frames = count < rest ? count : rest;
        info->before += first;
        info->after += rest - info->frames;
    }
    return rc;
}

/* Pages of a TIFF file into views `first` .. of frame t. The file knows nothing of frames and
 * views: what is wrong with a page is said in both terms. */
static enum v2v_status read_pages(struct v2v_recording *recording, float *views, int64_t page,
                                  int64_t first, int64_t count, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = recording->info.height * recording->info.width;
    for (int64_t i = 0; i < count && rc == V2V_OK; i++) {
        rc = v2v_stack_read(&recording->stack, views + (first + i) * pixels, page + i, 1);
        if (rc == V2V_E_INPUT) {
            rc =
                V2V_FAIL(rc, "%s; the page is frame %lld, view %lld (from 0)", v2v_status_message(),
                         (long long)t, (long long)recording->kept.view[first + i]);
        }
    }
    return rc;
}

static enum v2v_status read_views(struct v2v_recording *recording, float *views, int64_t page,
                                  int64_t first, int64_t count, int64_t t)
{
    if (recording->stack.is_tiff) {
        return read_pages(recording, views, page, first, count, t);
    }
    const int64_t pixels = recording->info.height * recording->info.width;
    return v2v_stack_read(&recording->stack, views + first * pixels, page, count);
}

enum v2v_status v2v_recording_calibrate(struct v2v_recording *recording,
                                        const struct v2v_calibration *calibration)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = &recording->info;
    V2V_ASSERT(recording->calibration == NULL);
    V2V_TRY(v2v_calibration_check(calibration, info->views, info->height, info->width,
                                  recording->stack.path));
    if (v2v_calibration_has_distortion(calibration)) {
        V2V_TRY(V2V_ALLOC(recording->as_recorded, "io.calibration",
                          v2v_mem_product(UNDISTORTING, info->height, info->width)));
    }
    recording->calibration = calibration;
done:
    return rc;
}

const struct v2v_calibration *v2v_recording_calibration(const struct v2v_recording *recording)
{
    return recording->calibration;
}

enum v2v_status v2v_recording_mend(struct v2v_recording *recording, double sharpness)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(recording->samples == NULL);
    V2V_TRY(V2V_ALLOC(recording->samples, "io.recording", V2V_HOT_PIXELS_SCRATCH));
    recording->sharpness = sharpness;
done:
    return rc;
}

/* Of the samples, one in so many hot ones is more than cameras have. */
enum { MANY_HOT = 200 };

static void mend(struct v2v_recording *recording, float *views, int64_t t)
{
    const struct v2v_recording_info *info = &recording->info;
    const int64_t samples = info->views * info->height * info->width;
    const struct v2v_mended mended = v2v_hot_pixels_mend(
        views, recording->samples, info->views, info->height, info->width, recording->sharpness);
    if (mended.hot + mended.cold > 0 && !recording->has_told) {
        v2v_log(V2V_LOG_INFO,
                "%s: frame %lld has %lld pixels that no light through the PSFs makes so bright, "
                "and %lld darker than the dark: such pixels, here and in other frames, are taken "
                "from their neighbours%s",
                recording->stack.path, (long long)t, (long long)mended.hot, (long long)mended.cold,
                mended.hot > samples / MANY_HOT
                    ? "; did counts below zero become the largest there are?"
                    : "");
        recording->has_told = 1;
    }
}

/* A view without its distortion. Samples that blind ones have a part in are marked, and stay as
 * they were. @return how many
 * @param marks NULL: there are none @param undistorted V2V_BLIND where a marked one has a part */
static int64_t take_undistorted(float *view, uint8_t *marks, const float *undistorted,
                                int64_t pixels)
{
    int64_t blind = 0;
    for (int64_t i = 0; i < pixels; i++) {
        const int is_blind = marks != NULL && undistorted[i] == V2V_BLIND;
        view[i] = is_blind ? view[i] : undistorted[i];
        if (marks != NULL) {
            marks[i] = (uint8_t)is_blind;
        }
        blind += is_blind;
    }
    return blind;
}

/* @return how many samples are marked since */
static int64_t undo_distortion(const struct v2v_recording *recording, float *views, uint8_t *marks)
{
    const struct v2v_recording_info *info = &recording->info;
    const int64_t pixels = info->height * info->width;
    float *const before = recording->as_recorded, *const after = before + pixels;
    int64_t blind = 0;
    for (int64_t v = 0; v < info->views; v++) {
        const struct v2v_view_calibration *calibration = &recording->calibration->view[v];
        float *view = views + v * pixels;
        uint8_t *own = marks != NULL ? marks + v * pixels : NULL;
        memcpy(before, view, (size_t)pixels * sizeof *before);
        if (own != NULL) {
            v2v_blind_leave(before, own, pixels);
        }
        v2v_unwarp_image(after, before, after + pixels, info->height, info->width,
                         calibration->distortion_y, calibration->distortion_x);
        blind += take_undistorted(view, own, after, pixels);
    }
    return blind;
}

/* Of view `i` of frame t. The first page of a sliding window shows some view; the views before it
 * come at the window's end. */
static int64_t page_of(const struct v2v_recording *recording, int64_t i, int64_t t)
{
    const int64_t views = recording->recorded, pages = t * recording->stride;
    const int64_t first = recording->stride < views ? pages % views : 0;
    return recording->first_page + pages + (recording->kept.view[i] - first + views) % views;
}

/* Is distortion, which a calibration says views have, undone as they are read? */
enum distortion { UNDONE, LEFT };

/* As v2v_recording_read_marked. */
static enum v2v_status read_frame(struct v2v_recording *recording, float *views, uint8_t *marks,
                                  double zero, int64_t *blind, int64_t t,
                                  enum distortion distortion)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = &recording->info;
    V2V_ASSERT(t >= -info->before && t < info->frames + info->after);
    t += info->before;
    *blind = 0;
    for (int64_t i = 0, count = 0; i < info->views; i += count) {
        const int64_t page = page_of(recording, i, t);
        count = 1;
        while (i + count < info->views && page_of(recording, i + count, t) == page + count) {
            count++;
        }
        V2V_TRY(read_views(recording, views, page, i, count, t));
    }
    if (recording->samples != NULL) {
        mend(recording, views, t);
    }
    if (marks != NULL) {
        *blind = v2v_blind_find(marks, views, zero, info->views, info->height, info->width);
    }
    if (recording->as_recorded != NULL && distortion == UNDONE) {
        *blind = undo_distortion(recording, views, *blind > 0 ? marks : NULL);
    }
done:
    return rc;
}

enum v2v_status v2v_recording_read_marked(struct v2v_recording *recording, float *views,
                                          uint8_t *marks, double zero, int64_t *blind, int64_t t)
{
    return read_frame(recording, views, marks, zero, blind, t, UNDONE);
}

enum v2v_status v2v_recording_read(struct v2v_recording *recording, float *views, int64_t t)
{
    int64_t none = 0;
    return v2v_recording_read_marked(recording, views, NULL, 0.0, &none, t);
}

/* As v2v_recording_read_seen. */
static enum v2v_status read_seen(struct v2v_recording *recording, float *views, double zero,
                                 int64_t *blind, int64_t t, enum distortion distortion)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = &recording->info;
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    int64_t found = 0;
    if (recording->marks == NULL) {
        V2V_TRY(V2V_ALLOC(recording->marks, "io.recording", samples));
    }
    V2V_TRY(read_frame(recording, views, recording->marks, zero, &found, t, distortion));
    if (found > 0) {
        v2v_blind_leave(views, recording->marks, samples);
    }
done:
    if (blind != NULL) {
        *blind = found;
    }
    return rc;
}

enum v2v_status v2v_recording_read_seen(struct v2v_recording *recording, float *views, double zero,
                                        int64_t *blind, int64_t t)
{
    return read_seen(recording, views, zero, blind, t, UNDONE);
}

enum v2v_status v2v_recording_read_distorted(struct v2v_recording *recording, float *views,
                                             double zero, int64_t *blind, int64_t t)
{
    return read_seen(recording, views, zero, blind, t, LEFT);
}

void v2v_recording_close(struct v2v_recording **recording)
{
    if (*recording != NULL) {
        v2v_stack_fini(&(*recording)->stack);
        v2v_kept_views_fini(&(*recording)->kept);
        v2v_mem_free((*recording)->as_recorded);
        v2v_mem_free((*recording)->samples);
        v2v_mem_free((*recording)->marks);
        v2v_mem_free(*recording);
        *recording = NULL;
    }
}
