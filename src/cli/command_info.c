#include "cli/content.h"
#include "cli/steps.h"

#include "v2v3d/io/tiff.h"
#include <inttypes.h>

struct arguments {
    struct v2v_common common;
    const char *path;
};

static const struct v2v_option options[] = {
    {.name = "file",
     .kind = V2V_OPTION_OPERAND,
     .at = offsetof(struct arguments, path),
     .value = "FILE",
     .help = "recording, volume, PSFs, weights; HDF5 or TIFF",
     .required = 1},
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    {0}};

static void print_length(const char *name, double value, const char *unit)
{
    if (value > 0.0) {
        printf("%s %g %s\n", name, value, unit);
    }
}

static enum v2v_status tiff(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *file = NULL;
    if (!v2v_step_on_root(session)) {
        return V2V_OK;
    }
    V2V_TRY(v2v_tiff_open(&file, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(file);
    printf("%s: TIFF, %" PRId64 " pages of %" PRId64 " x %" PRId64 " pixels, %s, %d bits\n", path,
           info->pages, info->height, info->width, info->is_float ? "float" : "integer",
           info->bits);
    printf("%" PRId64 " channels, %" PRId64 " slices, %" PRId64 " frames\n", info->channels,
           info->slices, info->frames);
    print_length("pixel size", info->pixel_size_um, "um");
    print_length("slice spacing", info->slice_spacing_um, "um");
    print_length("frame interval", info->frame_interval_s, "s");
done:
    v2v_tiff_close(&file);
    return rc;
}

static enum v2v_status volume(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *file = NULL;
    V2V_TRY(v2v_volume_open(&file, path, &session->config.input, session->world));
    const struct v2v_volume_info *info = v2v_volume_info(file);
    if (v2v_step_on_root(session)) {
        printf("%s: volume, %" PRId64 " frames, %" PRId64 " slices of %" PRId64 " x %" PRId64
               " pixels\n",
               path, info->frames, info->slices, info->height, info->width);
        print_length("pixel size", info->pixel_size_um, "um");
        print_length("slice spacing", info->slice_spacing_um, "um");
        print_length("frame interval", info->frame_interval_s, "s");
    }
done:
    v2v_volume_close(&file);
    return rc;
}

static enum v2v_status recording(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *file = NULL;
    V2V_TRY(v2v_recording_open(&file, path, &session->config.input, session->world));
    const struct v2v_recording_info *info = v2v_recording_info(file);
    if (v2v_step_on_root(session)) {
        printf("%s: recording, %" PRId64 " frames, %" PRId64 " views of %" PRId64 " x %" PRId64
               " pixels\n",
               path, info->frames, info->views, info->height, info->width);
        print_length("pixel size", info->pixel_size_um, "um");
        print_length("frame interval", info->frame_interval_s, "s");
    }
done:
    v2v_recording_close(&file);
    return rc;
}

static enum v2v_status psf(const char *path, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file file = {0};
    V2V_TRY(v2v_psf_file_read(&file, path, session->world));
    if (v2v_step_on_root(session)) {
        printf("%s: PSFs, %" PRId64 " views, %" PRId64 " slices of %" PRId64 " x %" PRId64
               " pixels (more: v2v3d psf info)\n",
               path, file.views, file.slices, file.height, file.width);
        print_length("pixel size", file.pixel_size_um, "um");
        print_length("slice spacing", file.slice_spacing_um, "um");
    }
done:
    v2v_psf_file_fini(&file);
    return rc;
}

static enum v2v_status weights(const char *path, const struct v2v_session *session)
{
    return v2v_step_print_weights(session, path);
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    static enum v2v_status (*const print[])(const char *, const struct v2v_session *) = {
        [V2V_CONTENT_VOLUME] = volume,
        [V2V_CONTENT_RECORDING] = recording,
        [V2V_CONTENT_PSF] = psf,
        [V2V_CONTENT_WEIGHTS] = weights,
        [V2V_CONTENT_TIFF] = tiff};
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    enum v2v_content content = V2V_CONTENT_AUTO;
    V2V_TRY(v2v_content_of(&content, given->path, session));
    /* neither says whether it has views or slices */
    const int is_open = content == V2V_CONTENT_TIFF ||
                        (content == V2V_CONTENT_VOLUME && session->config.input.dataset[0] != '\0');
    if (is_open && session->config.input.views > 0) {
        content = V2V_CONTENT_RECORDING;
    }
    V2V_TRY(print[content](given->path, session));
done:
    return rc;
}

const struct v2v_command v2v_command_info = {.name = "info",
                                             .summary = "what is in a file",
                                             .options = options,
                                             .bytes = sizeof(struct arguments),
                                             .run = run};
