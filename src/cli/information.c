#include "cli/information.h"

#include "cli/steps.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/attributes.h"
#include "v2v3d/io/level.h"
#include "v2v3d/io/tiff.h"
#include <inttypes.h>
#include <math.h>

static enum v2v_status check_frame(const char *path, int64_t frame, int64_t frames)
{
    return frame < frames || frames == 0
               ? V2V_OK
               : V2V_FAIL(V2V_E_USAGE, "--frame %" PRId64 ": %s has frames 0 .. %" PRId64, frame,
                          path, frames - 1);
}

static void add_text(void *report, const char *name, const char *text)
{
    v2v_report_text(report, name, text);
}

static void add_number(void *report, const char *name, double number)
{
    v2v_report_number(report, name, number, "");
}

static void add_lengths(struct v2v_report *report, double pixel_size_um, double slice_spacing_um,
                        double frame_interval_s)
{
    v2v_report_length(report, "pixel size", pixel_size_um, "um");
    v2v_report_length(report, "slice spacing", slice_spacing_um, "um");
    v2v_report_length(report, "frame interval", frame_interval_s, "s");
}

/* ---- volumes ---- */

/* Slice by slice: a frame may be larger than the memory. */
static enum v2v_status figures_of_volume(struct v2v_figures *figures, struct v2v_volume *volume,
                                         int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    const int64_t pixels = v2v_mem_product(info->height, info->width, 1);
    float *slice = NULL;
    V2V_TRY(V2V_ALLOC(slice, "info.slice", pixels));
    for (int64_t z = 0; z < info->slices; z++) {
        V2V_TRY(v2v_volume_read(volume, slice, t, z, 1));
        v2v_figures_add(figures, slice, pixels);
    }
done:
    v2v_mem_free(slice);
    return rc;
}

static enum v2v_status describe_volume(struct v2v_report *report, const char *path,
                                       struct v2v_volume *volume, int64_t frame)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    const struct v2v_attribute_reader reader = {report, add_text, add_number};
    struct v2v_figures figures = {0};
    struct v2v_volume_left left;
    int64_t done = 0;
    V2V_TRY(check_frame(path, frame, info->frames));
    v2v_report_headline(report,
                        "volume, %" PRId64 " frames, %" PRId64 " slices of %" PRId64 " x %" PRId64
                        " pixels",
                        info->frames, info->slices, info->height, info->width);
    v2v_report_count(report, "frames", info->frames);
    v2v_report_count(report, "slices", info->slices);
    v2v_report_count(report, "height", info->height);
    v2v_report_count(report, "width", info->width);
    add_lengths(report, info->pixel_size_um, info->slice_spacing_um, info->frame_interval_s);
    for (int64_t t = 0; t < info->frames; t++) {
        done += v2v_volume_has(volume, t);
    }
    v2v_report_number(report, "frames done", (double)done, "");
    if (v2v_volume_left(&left, path, NULL) != V2V_OK) {
        v2v_log(V2V_LOG_WARNING, "%s", v2v_status_message());
    } else if (left.done > 0) {
        v2v_report_number(report, "frames of an interrupted run", (double)left.done, "");
    }
    if (info->frames > 0 && v2v_volume_has(volume, frame)) {
        V2V_TRY(figures_of_volume(&figures, volume, frame));
        v2v_report_number(report, "frame", (double)frame, "");
        v2v_report_figures(report, "values", &figures);
    }
    if (v2v_file_is_hdf5(path)) {
        V2V_TRY(v2v_attributes_read(path, &reader));
    }
done:
    return rc;
}

enum v2v_status v2v_inform_volume(struct v2v_report *report, const char *path, int64_t frame,
                                  const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *file = NULL;
    V2V_TRY(v2v_volume_open(&file, path, &session->config.input, session->world));
    if (v2v_step_on_root(session)) {
        rc = describe_volume(report, path, file, frame);
    }
done:
    v2v_volume_close(&file);
    return rc;
}

/* ---- recordings ---- */

static enum v2v_status figures_of_recording(struct v2v_report *report,
                                            struct v2v_recording *recording, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    struct v2v_figures figures = {0};
    double level[V2V_LEVEL_FIGURES];
    float *views = NULL, *scratch = NULL;
    V2V_TRY(V2V_ALLOC(views, "info.views", samples));
    V2V_TRY(V2V_ALLOC(scratch, "info.views", samples));
    V2V_TRY(v2v_recording_read(recording, views, t));
    v2v_figures_add(&figures, views, samples);
    v2v_report_number(report, "frame", (double)t, "");
    v2v_report_figures(report, "values", &figures);
    v2v_level_of_frame(level, scratch, views, info->views, info->height, info->width);
    for (int f = V2V_LEVEL_PEAK; f <= V2V_LEVEL_NOISE; f++) { /* not known of dark frames */
        if (isfinite(level[f])) {
            v2v_report_number(report, v2v_level_name((enum v2v_level)f), level[f], "");
        }
    }
done:
    v2v_mem_free(views);
    v2v_mem_free(scratch);
    return rc;
}

enum v2v_status v2v_inform_recording(struct v2v_report *report, const char *path, int64_t frame,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *file = NULL;
    V2V_TRY(v2v_recording_open(&file, path, &session->config.input, session->world));
    const struct v2v_recording_info *info = v2v_recording_info(file);
    V2V_TRY(check_frame(path, frame, info->frames));
    if (!v2v_step_on_root(session)) {
        goto done;
    }
    v2v_report_headline(report,
                        "recording, %" PRId64 " frames, %" PRId64 " views of %" PRId64 " x %" PRId64
                        " pixels",
                        info->frames, info->views, info->height, info->width);
    v2v_report_count(report, "frames", info->frames);
    v2v_report_count(report, "views", info->views);
    v2v_report_count(report, "height", info->height);
    v2v_report_count(report, "width", info->width);
    add_lengths(report, info->pixel_size_um, 0.0, info->frame_interval_s);
    if (!isnan(info->offset)) {
        v2v_report_number(report, "offset", info->offset, "");
    }
    V2V_TRY(figures_of_recording(report, file, frame));
done:
    v2v_recording_close(&file);
    return rc;
}

/* ---- PSFs ---- */

static void sums_of_views(struct v2v_report *report, const struct v2v_psf_file *psf)
{
    const int64_t count = v2v_mem_product(psf->slices, psf->height, psf->width);
    double least = INFINITY, most = -INFINITY;
    struct v2v_figures all = {0};
    for (int64_t v = 0; v < psf->views; v++) {
        struct v2v_figures figures = {0};
        v2v_figures_add(&figures, psf->data + v * count, count);
        v2v_figures_add(&all, psf->data + v * count, count);
        least = fmin(least, figures.sum);
        most = fmax(most, figures.sum);
    }
    v2v_report_range(report, "sum of a view", least, most, "");
    v2v_report_figures(report, "values", &all);
}

enum v2v_status v2v_inform_psf(struct v2v_report *report, const char *path, int64_t frame,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file file = {0};
    (void)frame;
    V2V_TRY(v2v_psf_file_read(&file, path, session->config.input.without_views, session->world));
    if (v2v_step_on_root(session)) {
        v2v_report_headline(report,
                            "PSFs, %" PRId64 " views, %" PRId64 " slices of %" PRId64 " x %" PRId64
                            " pixels (more: v2v3d psf info)",
                            file.views, file.slices, file.height, file.width);
        v2v_report_count(report, "views", file.views);
        v2v_report_count(report, "slices", file.slices);
        v2v_report_count(report, "height", file.height);
        v2v_report_count(report, "width", file.width);
        add_lengths(report, file.pixel_size_um, file.slice_spacing_um, 0.0);
        sums_of_views(report, &file);
    }
done:
    v2v_psf_file_fini(&file);
    return rc;
}

/* ---- TIFF stacks ---- */

/* Of a stack that doesn't say what it is, a frame is a page. */
enum v2v_status v2v_inform_tiff(struct v2v_report *report, const char *path, int64_t frame,
                                const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *file = NULL;
    struct v2v_figures figures = {0};
    float *page = NULL;
    if (!v2v_step_on_root(session)) {
        return V2V_OK;
    }
    V2V_TRY(v2v_tiff_open(&file, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(file);
    V2V_TRY(check_frame(path, frame, info->pages));
    v2v_report_headline(
        report,
        "TIFF, %" PRId64 " pages of %" PRId64 " x %" PRId64 " pixels, %s, %d bits: %" PRId64
        " channels, %" PRId64 " slices, %" PRId64 " frames",
        info->pages, info->height, info->width, info->is_float ? "float" : "integer", info->bits,
        info->channels, info->slices, info->frames);
    v2v_report_count(report, "pages", info->pages);
    v2v_report_count(report, "height", info->height);
    v2v_report_count(report, "width", info->width);
    v2v_report_count(report, "bits", info->bits);
    v2v_report_count(report, "channels", info->channels);
    v2v_report_count(report, "slices", info->slices);
    v2v_report_count(report, "frames", info->frames);
    add_lengths(report, info->pixel_size_um, info->slice_spacing_um, info->frame_interval_s);
    if (info->scale != 0.0) {
        v2v_report_number(report, "value of a sample of 0", info->zero, "");
        v2v_report_number(report, "step between values", info->scale, "");
    }
    if (info->is_curved) {
        v2v_report_text(report, "ImageJ's calibration of values", "no straight line, not used");
    }
    if (info->told.task[0] != '\0') {
        v2v_report_text(report, V2V_VOLUME_TASK, info->told.task);
    }
    if (info->told.first_frame[0] != '\0') {
        v2v_report_text(report, V2V_VOLUME_FIRST_FRAME, info->told.first_frame);
    }
    if (frame < info->pages) {
        V2V_TRY(V2V_ALLOC(page, "info.page", v2v_mem_product(info->height, info->width, 1)));
        V2V_TRY(v2v_tiff_read(file, page, frame, 1));
        v2v_figures_add(&figures, page, v2v_mem_product(info->height, info->width, 1));
        v2v_report_number(report, "page", (double)frame + 1.0, "");
        v2v_report_figures(report, "values", &figures);
    }
done:
    v2v_mem_free(page);
    v2v_tiff_close(&file);
    return rc;
}

/* ---- YAML ---- */

static double largest(double so_far, const double *terms)
{
    for (int i = 0; i < V2V_FIELD_TERMS; i++) {
        so_far = fmax(so_far, fabs(terms[i]));
    }
    return so_far;
}

static void describe_calibration(struct v2v_report *report,
                                 const struct v2v_calibration *calibration)
{
    double least = INFINITY, most = -INFINITY, shift = 0.0, slope = 0.0;
    double distortion = 0.0, shading = 0.0;
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        least = fmin(least, view->gain);
        most = fmax(most, view->gain);
        shift = fmax(shift, hypot(view->shift[0], view->shift[1]));
        slope = fmax(slope, hypot(view->slope[0], view->slope[1]));
        distortion = largest(largest(distortion, view->distortion_y), view->distortion_x);
        shading = largest(shading, view->shading);
    }
    v2v_report_headline(
        report, "calibration of %" PRId64 " views, of frames of %" PRId64 " x %" PRId64 " pixels",
        calibration->views, calibration->height, calibration->width);
    v2v_report_count(report, "views", calibration->views);
    v2v_report_count(report, "height", calibration->height);
    v2v_report_count(report, "width", calibration->width);
    v2v_report_range(report, "gain", least, most, "");
    v2v_report_number(report, "largest shift", shift, "pixels");
    v2v_report_number(report, "largest change of it with depth", slope, "pixels");
    v2v_report_number(report, "largest term of the distortion", distortion, "pixels");
    v2v_report_number(report, "largest term of the shading", shading, "");
}

enum v2v_status v2v_inform_yaml(struct v2v_report *report, const char *path, int64_t frame,
                                const struct v2v_session *session)
{
    struct v2v_calibration calibration = {0};
    struct v2v_config config;
    char message[V2V_MESSAGE_BYTES];
    (void)frame;
    if (!v2v_step_on_root(session)) {
        return V2V_OK;
    }
    v2v_config_defaults(&config);
    if (v2v_config_load(&config, path) == V2V_OK) {
        v2v_report_headline(report, "settings (all of them: v2v3d init -c %s)", path);
        v2v_report_text(report, "model.method", config.model.method);
        v2v_report_text(report, "deconv.method", config.deconv.method);
        return V2V_OK;
    }
    snprintf(message, sizeof message, "%s", v2v_status_message());
    const enum v2v_status rc = v2v_calibration_read(&calibration, path);
    if (rc == V2V_OK) {
        describe_calibration(report, &calibration);
    }
    v2v_calibration_fini(&calibration);
    return rc == V2V_OK ? rc
                        : V2V_FAIL(rc, "as settings: %.400s; as a calibration: %.400s", message,
                                   v2v_status_message());
}
