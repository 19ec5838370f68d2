#include "v2v3d/io/scaling.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/level.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/tensor/warp.h"

#include <float.h>
#include <math.h>

/* REFERENCE.md 1: cameras that store signed counts as unsigned ones put their zero here. The
 * reference subtracts it whenever the maximum is above; here the mean must be above too, or a
 * recording that merely uses all of its 16 bits (mean 6000, maximum 62835) would become negative
 * almost everywhere; and none may be above 16 bits, as in recordings of other units. */
#define SIGNED_ZERO 32767.0
#define LARGEST_COUNT 65535.0
#define TARGET_MEAN 0.2

/* Of the brightest light, that dark signed counts may lie below their zero, as they do where a
 * background was subtracted. */
#define MOST_BELOW 0.1

/* A mean that is less than this part of the samples' root mean square is what a subtracted
 * background left: rounding would decide its sign. Light in a millionth of dark samples, less than
 * the PSFs of one point take of a frame, is as much. */
#define LEAST_MEAN_OF_SAMPLES 1e-3

struct statistics {
    double mean, squares, largest; /* squares: mean of x^2 */
    double pedestal;               /* of the first frame */
};

enum { SEEN, SUM, SQUARES, SUMS }; /* of a frame: samples, and what they and their squares sum to */

/* What the first frame has at least where it sees something: the zero of the camera that would
 * tell where that is isn't known. */
static enum v2v_status find_pedestal(double *pedestal, float *views, float *scratch,
                                     struct v2v_recording *recording)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    V2V_TRY(v2v_recording_read_seen(recording, views, (double)NAN, NULL, 0));
    *pedestal = v2v_dark_of_images(scratch, views, info->views, info->height, info->width).above;
done:
    return rc;
}

static void add_samples(double sums[SUMS], float *largest, const float *views, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        const int is_seen = views[i] != V2V_BLIND;
        const double x = is_seen ? (double)views[i] : 0.0;
        sums[SEEN] += is_seen;
        sums[SUM] += x;
        sums[SQUARES] += x * x;
        *largest = views[i] > *largest ? views[i] : *largest;
    }
}

/* Sums by frame, added in the order of the frames: the same bits at any rank count. */
static enum v2v_status measure(struct statistics *statistics, struct v2v_recording *recording,
                               double offset, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t image = v2v_mem_product(info->height, info->width, 1);
    const int64_t count = v2v_mem_product(info->views, image, 1);
    const struct v2v_part part =
        v2v_par_part(info->frames, v2v_comm_size(comm), v2v_comm_rank(comm));
    double *sums = NULL, seen = 0.0; /* [frame,SUMS] */
    float *views = NULL, *scratch = NULL;
    float largest = 0.0f;
    rc = V2V_ALLOC(sums, "io.scaling", v2v_mem_product(info->frames, SUMS, 1));
    if (rc == V2V_OK) {
        rc = V2V_ALLOC(views, "io.scaling", count);
    }
    if (rc == V2V_OK && part.first == 0) {
        rc = V2V_ALLOC(scratch, "io.scaling", count);
    }
    for (int64_t t = part.first; rc == V2V_OK && t < part.first + part.count; t++) {
        v2v_watchdog_beat("a frame's mean and noise");
        rc = v2v_recording_read_seen(recording, views, offset, NULL, t);
        if (rc == V2V_OK) {
            add_samples(sums + SUMS * t, &largest, views, count);
        }
        if (rc == V2V_OK && t == 0) {
            rc = find_pedestal(&statistics->pedestal, views, scratch, recording);
        }
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_sum_f64(comm, sums, SUMS * info->frames);
    statistics->largest = (double)largest;
    v2v_par_max_f64(comm, &statistics->largest, 1);
    v2v_par_max_f64(comm, &statistics->pedestal, 1);
    statistics->mean = statistics->squares = 0.0;
    for (int64_t t = 0; t < info->frames; t++) {
        const double *of_frame = sums + SUMS * t;
        if (of_frame[SEEN] > 0.0) {
            statistics->mean += of_frame[SUM] / of_frame[SEEN];
            statistics->squares += of_frame[SQUARES] / of_frame[SEEN];
            seen += 1.0;
        }
    }
    statistics->mean /= fmax(seen, 1.0);
    statistics->squares /= fmax(seen, 1.0);
done:
    v2v_mem_free(scratch);
    v2v_mem_free(views);
    v2v_mem_free(sums);
    return rc;
}

/* What is that far below their zero was never dark. */
static int are_signed(const struct statistics *statistics)
{
    const double brightest = statistics->largest - SIGNED_ZERO, dark = statistics->pedestal;
    const int is_far_below = dark > 0.0 && SIGNED_ZERO - dark > MOST_BELOW * brightest;
    return statistics->mean > SIGNED_ZERO && statistics->largest <= LARGEST_COUNT && !is_far_below;
}

enum v2v_status v2v_scaling_decide(struct v2v_scaling *scaling, struct v2v_recording *recording,
                                   const struct v2v_input_settings *settings,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct statistics statistics = {0};
    *scaling = (struct v2v_scaling){.calibration = v2v_recording_calibration(recording)};
    const double stated = v2v_recording_info(recording)->offset;
    const int is_auto = settings->offset.mode == V2V_NUMBER_AUTO, guess = is_auto && isnan(stated);
    scaling->offset = settings->offset.mode == V2V_NUMBER_GIVEN ? settings->offset.value
                      : is_auto && !guess                       ? stated
                                                                : 0.0;
    scaling->gain = settings->gain.mode == V2V_NUMBER_GIVEN ? settings->gain.value : 1.0;
    if (guess || settings->gain.mode == V2V_NUMBER_AUTO) {
        V2V_TRY(measure(&statistics, recording, scaling->offset, comm));
    }
    scaling->is_guessed = guess && are_signed(&statistics);
    if (scaling->is_guessed) {
        scaling->offset = SIGNED_ZERO;
    } else if (guess) {
        scaling->pedestal = statistics.pedestal;
    }
    if (settings->gain.mode == V2V_NUMBER_AUTO) {
        const double mean = statistics.mean - scaling->offset;
        const double offset = scaling->offset; /* E (x - o)^2 = E x^2 - o (2 E x - o) */
        const double squares = statistics.squares - offset * (2.0 * statistics.mean - offset);
        if (!(mean > LEAST_MEAN_OF_SAMPLES * sqrt(fmax(squares, 0.0)) &&
              TARGET_MEAN / mean <= FLT_MAX)) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: the recording's mean is %g after subtracting the offset %g: no "
                             "gain makes it %g; set input.offset or input.gain",
                             v2v_recording_path(recording), mean, offset, TARGET_MEAN));
        }
        scaling->gain = TARGET_MEAN / mean;
    }
done:
    return rc;
}

void v2v_scaling_warn(const struct v2v_scaling *scaling, const char *recording,
                      const struct v2v_comm *comm)
{
    if (v2v_comm_rank(comm) != 0) {
        return;
    }
    if (scaling->is_guessed) {
        v2v_log(V2V_LOG_WARNING,
                "%s: %g is subtracted, the zero of signed counts, which most are above; "
                "--offset none says that it is light",
                recording, scaling->offset);
    }
    if (scaling->pedestal > 0.0) {
        v2v_log(V2V_LOG_WARNING,
                "%s is hardly anywhere darker than %.4g: if that is the camera's zero, subtract it "
                "(--offset %.4g); --offset none says that it is light",
                recording, scaling->pedestal, scaling->pedestal);
    }
}

void v2v_scaling_apply(const struct v2v_scaling *scaling, float *x, int64_t count)
{
    const float offset = (float)scaling->offset, gain = (float)scaling->gain;
    const struct v2v_calibration *calibration = scaling->calibration;
    for (int64_t i = 0; i < count; i++) {
        x[i] = x[i] != V2V_BLIND ? (x[i] - offset) * gain : V2V_BLIND;
    }
    for (int64_t v = 0; calibration != NULL && v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        if (!v2v_field_is_zero(view->shading)) {
            v2v_shade_image(x + v * (count / calibration->views), calibration->height,
                            calibration->width, view->shading, -1.0);
        }
    }
}

enum v2v_status v2v_scaling_read_dark(const struct v2v_scaling *scaling,
                                      struct v2v_recording *recording, float *x, int64_t *blind,
                                      int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    V2V_TRY(v2v_recording_read_seen(recording, x, scaling->offset, blind, t));
    v2v_scaling_apply(scaling, x, samples);
    v2v_blind_darken(x, samples);
done:
    return rc;
}

/* In double precision: what levels a frame of tiny numbers is none that float32 holds. */
double v2v_scaling_level(float *x, float *scratch, int64_t views, int64_t height, int64_t width)
{
    const int64_t pixels = height * width;
    double sum = 0.0, noise = 0.0;
    for (int64_t v = 0; v < views; v++) {
        for (int64_t i = 0; i < pixels; i++) {
            sum += x[v * pixels + i];
        }
    }
    if (!isfinite(sum)) {
        return 1.0;
    }
    for (int64_t v = 0; v < views; v++) {
        noise += v2v_noise_of_images(scratch, x + v * pixels, 1, height, width) / (double)views;
    }
    const double level = fmax(fabs(sum / (double)(views * pixels)), V2V_LEVEL_LEAST_MEAN * noise);
    if (!(level > 0.0 && isfinite(level))) {
        return 1.0;
    }
    for (int64_t i = 0; i < views * pixels; i++) {
        x[i] = (float)(x[i] * (TARGET_MEAN / level));
    }
    return TARGET_MEAN / level;
}
