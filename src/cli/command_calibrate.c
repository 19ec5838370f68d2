#include "cli/steps.h"
#include "cli/unused_settings.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/json.h"
#include "v2v3d/method/calibrate.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/optics/calibration.h"
#include "v2v3d/tensor/saturation.h"
#include "v2v3d/tensor/statistics.h"
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *input, *output;
    int64_t frame;
    int json;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_FILE(struct arguments, input, "input", 1, "recording"),
    V2V_OPTION_OUTPUT(struct arguments, output, "calibration to write, YAML"),
    V2V_OPTION_FRAME(struct arguments, frame, "of the recording that shows the views, from 0"),
    V2V_OPTION_SWITCH(struct arguments, json, "json", "one JSON object instead of text"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    {0}};

/* Of the held-out residual before. */
static const double hardly_lower = 0.99;

/* Of the median of all gains, beyond which a view and its PSF have hardly anything in common. */
static const double hardly_alike = 8.0;

/* Of a view: of 0.2 and 2 % shifts came back within 0.07 and 0.05 pixels, of 30 % within 0.7. */
static const double many_saturated = 0.05;

/* Below, others say little about where a view lies: shifts of three were off by 0.2 to 0.6 pixels
 * where those of five were off by 0.03 (noise of 0.01). */
enum { MANY_VIEWS = 5 };

/* Pixels of a side, below which shifts are found to a pixel or worse: 1.2 pixels off in frames of
 * 48 x 48, 1.6 in those of 32 x 32, of views in register 1.5; 0.2 in those of 64 and more. */
enum { LARGE_FRAME = 64 };

static enum v2v_status median_gain(double *median, const struct v2v_calibration *calibration)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = calibration->views;
    float *gains = NULL;
    V2V_TRY(V2V_ALLOC(gains, "cli.calibration", views));
    for (int64_t v = 0; v < views; v++) {
        gains[v] = (float)calibration->view[v].gain;
    }
    *median = (double)v2v_select(gains, views, views / 2);
done:
    v2v_mem_free(gains);
    return rc;
}

/* Views that have little in common with their PSFs, or with what the others show. */
static enum v2v_status warn_of_views(const struct v2v_calibration *calibration,
                                     const struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    double median = 1.0;
    int64_t odd = report->odd_view;
    V2V_TRY(median_gain(&median, calibration));
    for (int64_t v = 0; v < calibration->views; v++) {
        const double ratio = calibration->view[v].gain / median;
        if (ratio > hardly_alike || ratio < 1.0 / hardly_alike) {
            odd = odd == v ? -1 : odd; /* it is told of here */
            v2v_log(V2V_LOG_WARNING,
                    "view %" PRId64 ": a gain of %.3g beside the others': it shows little of what "
                    "they show, and theirs follow from it; look at it before you use this",
                    calibration->number[v], ratio);
        }
    }
    if (odd >= 0) {
        v2v_log(
            V2V_LOG_WARNING,
            "view %" PRId64 " is predicted much worse than most: it is not its PSF's, or too "
            "far off, which spoils the others (--without-views); look at it before you use this",
            calibration->number[odd]);
    }
done:
    return rc;
}

/* What the calibration as a whole is worth. */
static void warn_of_worth(const struct v2v_calibration *calibration,
                          const struct v2v_calibration_report *report)
{
    if (report->is_in_vain) {
        v2v_log(V2V_LOG_WARNING, "nothing lowers the held-out residual by more than noise does: "
                                 "the views are in register, or too noisy to tell; the "
                                 "calibration leaves them as they are");
    } else if (report->is_gains_alone) {
        v2v_log(V2V_LOG_WARNING, "shifts lower the held-out residual by no more than noise does: "
                                 "the views are in register, or too noisy to tell; the "
                                 "calibration has their gains alone");
    } else if (report->frame_after > hardly_lower * report->frame_before) {
        v2v_log(V2V_LOG_WARNING, "the held-out residual is hardly lower: the views are in register "
                                 "without it, or too few or too noisy to tell");
    } else if (calibration->views < MANY_VIEWS) {
        v2v_log(V2V_LOG_WARNING,
                "%" PRId64
                " views: by so few others a view's shift is found to half a pixel or so; "
                "compare volumes with this calibration and without",
                calibration->views);
    }
    if (!report->is_in_vain && v2v_smaller(calibration->height, calibration->width) < LARGE_FRAME) {
        v2v_log(V2V_LOG_WARNING,
                "%" PRId64 " x %" PRId64 " pixels: by so few a view's shift is found to a pixel or "
                "worse; calibrate frames of %d x %d or more",
                calibration->height, calibration->width, LARGE_FRAME, LARGE_FRAME);
    }
}

/* Of the slope from one view's depth to another's: views in each other's place come within 0.15. */
static const double nearly = 0.3;

/* Has the view a slope that makes its PSF that of another one? */
static int lies_as(const struct v2v_view_calibration *view, const double own[2],
                   const double other[2], int64_t slices)
{
    double way = 0.0, missed = 0.0;
    for (int axis = 0; axis < 2; axis++) {
        const double slope = 0.5 * (double)(slices - 1) * (other[axis] - own[axis]);
        way += slope * slope;
        missed += pow(view->slope[axis] - slope, 2.0);
    }
    return way > 1.0 && missed < nearly * nearly * way;
}

/* @param part of a view, at most */
static void tell_of_saturated(double part)
{
    const int are_many = part > many_saturated;
    if (part > 0.0) {
        v2v_log(are_many ? V2V_LOG_WARNING : V2V_LOG_INFO,
                "saturated samples, up to %.2g %% of a view, are left out: they hide its gain%s",
                100.0 * part,
                are_many ? ", and so many of them where it lies: shifts may be off by most of a "
                           "pixel"
                         : "");
    }
}

/* Two views in each other's place have each other's slopes, where these were found. */
static enum v2v_status warn_of_exchanged(const struct v2v_calibration *calibration,
                                         const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_view_calibration *view = calibration->view;
    double(*parallax)[2] = NULL;
    V2V_TRY(V2V_ALLOC(parallax, "cli.calibration", psf->views));
    v2v_psf_parallax(parallax, psf);
    for (int64_t a = 0; a < psf->views; a++) {
        for (int64_t b = a + 1; b < psf->views; b++) {
            if (lies_as(&view[a], parallax[a], parallax[b], psf->slices) &&
                lies_as(&view[b], parallax[b], parallax[a], psf->slices)) {
                v2v_log(V2V_LOG_WARNING,
                        "views %" PRId64 " and %" PRId64
                        " change with depth as each other's PSFs do: are they in each other's "
                        "place?",
                        calibration->number[a], calibration->number[b]);
            }
        }
    }
done:
    v2v_mem_free(parallax);
    return rc;
}

static void print_text(const struct v2v_calibration *calibration,
                       const struct v2v_calibration_report *report)
{
    printf("view  shift y   shift x      gain   slope y   slope x\n");
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        printf("%4" PRId64 "  %7.2f   %7.2f   %7.3f   %7.2f   %7.2f\n", calibration->number[v],
               view->shift[0], view->shift[1], view->gain, view->slope[0], view->slope[1]);
    }
    printf("slopes with depth %s, shading and distortion %s; %" PRId64 " rounds\n",
           report->has_slopes ? "fitted" : "gain nothing",
           report->has_fields ? "fitted" : "gain nothing", report->rounds);
    printf("held-out residual: %.4f before, %.4f after; in rows %" PRId64 " to %" PRId64
           ", columns %" PRId64 " to %" PRId64 ", which vary most, %.4f before, %.4f after\n",
           report->frame_before, report->frame_after, report->square_rows.first,
           report->square_rows.first + report->square_rows.count - 1, report->square_columns.first,
           report->square_columns.first + report->square_columns.count - 1, report->heldout_before,
           report->heldout_after);
}

static enum v2v_status print_json(const struct v2v_calibration *calibration,
                                  const struct v2v_calibration_report *report)
{
    enum v2v_status rc = V2V_OK;
    double *numbers = NULL;
    const int64_t views = calibration->views;
    const double square[4] = {
        (double)report->square_rows.first, (double)report->square_columns.first,
        (double)report->square_rows.count, (double)report->square_columns.count};
    V2V_TRY(V2V_ALLOC(numbers, "cli.calibration", 6 * views));
    double *const shifts = numbers, *const slopes = numbers + 2 * views,
                  *gains = slopes + 2 * views, *names = gains + views;
    for (int64_t v = 0; v < views; v++) {
        for (int axis = 0; axis < 2; axis++) {
            shifts[2 * v + axis] = calibration->view[v].shift[axis];
            slopes[2 * v + axis] = calibration->view[v].slope[axis];
        }
        gains[v] = calibration->view[v].gain;
        names[v] = (double)calibration->number[v];
    }
    const struct v2v_json_item items[] = {
        v2v_json_number("heldout_before", report->heldout_before),
        v2v_json_number("heldout_after", report->heldout_after),
        v2v_json_number("heldout_frame_before", report->frame_before),
        v2v_json_number("heldout_frame_after", report->frame_after),
        {.name = "square", .values = square, .count = 4},
        {.name = "view_numbers", .values = names, .count = views},
        {.name = "shifts", .values = shifts, .count = 2 * views},
        {.name = "gains", .values = gains, .count = views},
        {.name = "slopes", .values = slopes, .count = 2 * views},
        v2v_json_number("has_slopes", report->has_slopes),
        v2v_json_number("has_fields", report->has_fields),
        v2v_json_number("is_gains_alone", report->is_gains_alone),
        v2v_json_number("is_in_vain", report->is_in_vain),
        v2v_json_number("lambda", report->weight),
        v2v_json_number("rounds", (double)report->rounds)};
    V2V_TRY(v2v_json_print(stdout, items, sizeof items / sizeof *items));
done:
    v2v_mem_free(numbers);
    return rc;
}

/* Rank 0. */
static enum v2v_status write_file(const struct v2v_calibration *calibration, const char *path)
{
    enum v2v_status rc = V2V_OK;
    static const char what[] = "the calibration's text";
    FILE *stream = NULL;
    char *text = NULL;
    size_t bytes = 0;
    V2V_TRY(v2v_text_open(&stream, &text, &bytes, what));
    v2v_calibration_print(calibration, stream);
    V2V_TRY(v2v_text_close(V2V_OK, stream, &text, what));
    V2V_TRY(v2v_file_write_text(path, text));
done:
    free(text);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_recording *recording = NULL;
    struct v2v_scaling scaling;
    struct v2v_calibration calibration = {0};
    struct v2v_calibration_report report;
    float *views = NULL;
    struct v2v_fusion *fusion = NULL; /* of the frame alone */
    int64_t saturated = 0;
    V2V_TRY(v2v_step_output(session, given->output, (const char *const[]){given->psf, given->input},
                            2));
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_command("calibrate", session);
    }
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_step_recording(session, &recording, given->input, &psf));
    V2V_TRY(v2v_step_offset(session, &scaling, recording));
    V2V_TRY(v2v_recording_cut(recording, given->frame, 1));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    const struct v2v_problem problem = {
        .config = &session->config, .psf = &psf, .height = info->height, .width = info->width};
    rc = V2V_ALLOC(views, "cli.calibrate", samples);
    if (rc == V2V_OK) {
        rc = v2v_fusion_create(&fusion, 0, info->views, info->height, info->width, 1);
    }
    if (rc == V2V_OK) {
        rc = v2v_fusion_read(fusion, views, recording, &scaling, 0);
    }
    if (rc == V2V_OK) {
        saturated = v2v_saturated_leave(views, info->views, info->height * info->width);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_scaling_warn(&scaling, given->input, session->world);
    v2v_step_announce(session);
    tell_of_saturated((double)saturated / (double)(info->height * info->width));
    V2V_TRY(v2v_calibrate(&calibration, &report, &problem, views, session->world));
    if (v2v_step_on_root(session)) {
        V2V_TRY(write_file(&calibration, given->output));
        V2V_TRY(warn_of_views(&calibration, &report));
        warn_of_worth(&calibration, &report);
        V2V_TRY(warn_of_exchanged(&calibration, &psf));
        if (given->json) {
            V2V_TRY(print_json(&calibration, &report));
        } else {
            print_text(&calibration, &report);
        }
    }
done:
    v2v_calibration_fini(&calibration);
    v2v_fusion_destroy(&fusion);
    v2v_mem_free(views);
    v2v_recording_close(&recording);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_calibrate = {
    .name = "calibrate",
    .summary = "shift, gain and distortion of each view, by predicting views left out",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run,
};
