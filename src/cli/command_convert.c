#include "cli/content.h"
#include "cli/origin.h"
#include "cli/steps.h"
#include "cli/storage.h"
#include "cli/weights_conversion.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/bdv.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"

#include <math.h>

struct arguments {
    struct v2v_common common;
    const char *input, *output, *frames; /* FIRST:COUNT; NULL: all */
    int kind;                            /* enum v2v_content */
    struct v2v_storage_options storage;  /* of volumes */
};

static const struct v2v_option options[] = {
    V2V_OPTION_FILE(struct arguments, input, "input", 1, "volume, recording, PSFs or weights"),
    V2V_OPTION_OUTPUT(struct arguments, output,
                      "file to write: .h5; .tif (ImageJ), .ome.tif; NAME.xml (BigDataViewer, with "
                      "NAME.bdv.h5 beside it, uint16); .safetensors"),
    {.name = "kind",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct arguments, kind),
     .value = "auto|volume|recording|psf|weights",
     .help = "of the content; a TIFF stack with --views, or with channels and no slices, is a "
             "recording, else a volume",
     .initial = "auto"},
    V2V_OPTION_FRAMES(struct arguments, frames,
                      "these of a volume or recording, from 0; fewer where they end"),
    V2V_OPTIONS_STORAGE(struct arguments, storage),
    V2V_OPTIONS_PAGES,
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

/* The frames that are asked for. Collective(world). @param first out: of them */
static enum v2v_status open_volume(struct v2v_volume **volume, int64_t *first,
                                   const struct arguments *given, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_part frames;
    V2V_TRY(v2v_step_frames(&frames, given->frames));
    V2V_TRY(v2v_volume_open(volume, given->input, &session->config.input, session->world));
    V2V_TRY(v2v_volume_cut(*volume, frames.first, frames.count));
    *first = frames.first;
    for (int64_t t = 0; t < v2v_volume_info(*volume)->frames; t++) {
        if (!v2v_volume_has(*volume, t)) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: frame %lld was never finished; --frames FIRST:COUNT takes others",
                             given->input, (long long)(frames.first + t)));
        }
    }
done:
    return rc;
}

/* What rank 0 converts while the others hear its beats. */
struct bdv {
    const char *output;
    struct v2v_volume *volume;
    struct v2v_volume_storage storage;
};

static enum v2v_status write_bdv(void *context)
{
    const struct bdv *bdv = context;
    return v2v_bdv_write(bdv->output, bdv->volume, &bdv->storage);
}

/* A volume for BigDataViewer: rank 0 reads and writes. */
static enum v2v_status convert_to_bdv(const struct arguments *given,
                                      const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct bdv bdv = {.output = given->output};
    int64_t first = 0;
    char data[V2V_PATH_BYTES];
    V2V_TRY(v2v_bdv_data_name(data, given->output));
    V2V_TRY(v2v_storage_settle(&bdv.storage, &given->storage, given->output));
    V2V_TRY(v2v_step_output(session, data, &given->input, 1));
    V2V_TRY(open_volume(&bdv.volume, &first, given, session));
    V2V_TRY(v2v_agreement_alone(session->world, write_bdv, &bdv));
done:
    v2v_volume_close(&bdv.volume);
    return rc;
}

static enum v2v_status convert_volume(const struct arguments *given,
                                      const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_volume_writer *writer = NULL;
    float *slices = NULL;
    struct v2v_origin origin;
    int64_t first = 0;
    struct v2v_attribute attributes[2 + V2V_ORIGIN_ATTRIBUTES] = {
        {.name = "program", .text = "v2v3d " V2V_VERSION},
        {.name = "command_line", .text = session->command_line}};
    if (v2v_bdv_is_name(given->output)) {
        return convert_to_bdv(given, session);
    }
    V2V_TRY(open_volume(&volume, &first, given, session));
    V2V_TRY(v2v_origin_read(&origin, given->input, session));
    origin.first_frame += origin.first_frame >= 0 ? first : 0;
    const int64_t described = 2 + v2v_origin_attributes(attributes + 2, &origin);
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    struct v2v_volume_info written = *info;
    V2V_TRY(v2v_storage_settle(&written.storage, &given->storage, given->output));
    struct v2v_part mine =
        v2v_par_part(info->slices, v2v_comm_size(session->world), v2v_comm_rank(session->world));
    rc =
        V2V_ALLOC(slices, "convert.slices", v2v_mem_product(mine.count, info->height, info->width));
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_volume_create(&writer, given->output, &written, 1u << V2V_VOLUME_MEAN, attributes,
                              described, session->world));
    for (int64_t t = 0; t < info->frames; t++) {
        v2v_watchdog_beat("convert: a frame");
        rc = v2v_volume_read(volume, slices, t, mine.first, mine.count);
        V2V_TRY(v2v_par_agree(session->world, rc));
        V2V_TRY(v2v_step_write_slices(session, writer, slices, t, mine));
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    v2v_mem_free(slices);
    v2v_volume_close(&volume);
    return rc;
}

/* Likewise. */
struct recording_tiff {
    const char *output;
    struct v2v_recording *recording;
    float *views; /* of one frame */
};

/* The frames of a recording as an ImageJ hyperstack, views as channels. */
static enum v2v_status recording_to_tiff(void *context)
{
    enum v2v_status rc = V2V_OK;
    const struct recording_tiff *given = context;
    struct v2v_tiff_writer *writer = NULL;
    const struct v2v_recording_info *info = v2v_recording_info(given->recording);
    int64_t pixels = info->height * info->width;
    struct v2v_tiff_info tiff = {.pages = info->frames * info->views,
                                 .height = info->height,
                                 .width = info->width,
                                 .channels = info->views,
                                 .slices = 1,
                                 .frames = info->frames,
                                 .bits = 32,
                                 .is_float = 1,
                                 .is_ome = v2v_tiff_is_ome_name(given->output),
                                 .type_max = 1.0,
                                 .pixel_size_um = info->pixel_size_um,
                                 .frame_interval_s = info->frame_interval_s};
    V2V_TRY(v2v_tiff_create(&writer, given->output, &tiff));
    for (int64_t t = 0; t < info->frames; t++) {
        v2v_watchdog_beat("convert: a frame");
        V2V_TRY(v2v_recording_read(given->recording, given->views, t));
        for (int64_t v = 0; v < info->views; v++) {
            V2V_TRY(v2v_tiff_write_page(writer, given->views + v * pixels));
        }
    }
    V2V_TRY(v2v_tiff_finish(&writer));
done:
    v2v_tiff_abandon(&writer);
    return rc;
}

/* Frames go round the ranks; those without one in a round write nothing. */
static enum v2v_status recording_to_hdf5(const char *output, struct v2v_recording *recording,
                                         float *views, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording_writer *writer = NULL;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    int64_t ranks = v2v_comm_size(session->world);
    V2V_TRY(v2v_recording_create(&writer, output, info, session->world));
    for (int64_t first = 0; first < info->frames; first += ranks) {
        int64_t t = first + v2v_comm_rank(session->world);
        int is_mine = t < info->frames;
        v2v_watchdog_beat("convert: a frame");
        if (is_mine) {
            rc = v2v_recording_read(recording, views, t);
        }
        V2V_TRY(v2v_par_agree(session->world, rc));
        V2V_TRY(v2v_recording_write(writer, views, is_mine ? t : 0, 0, is_mine ? info->views : 0));
    }
    V2V_TRY(v2v_recording_finish(&writer));
done:
    v2v_recording_abandon(&writer);
    return rc;
}

static enum v2v_status convert_recording(const struct arguments *given,
                                         const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *recording = NULL;
    float *views = NULL;
    struct v2v_part frames;
    V2V_TRY(v2v_step_frames(&frames, given->frames));
    if (v2v_bdv_is_name(given->output)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: only volumes are written for BigDataViewer (.xml)",
                         given->output));
    }
    V2V_TRY(v2v_recording_open(&recording, given->input, &session->config.input, session->world));
    V2V_TRY(v2v_recording_cut(recording, frames.first, frames.count));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    rc = V2V_ALLOC(views, "convert.views", v2v_mem_product(info->views, info->height, info->width));
    V2V_TRY(v2v_par_agree(session->world, rc));
    if (v2v_file_kind_of_name(given->output) == V2V_FILE_HDF5) {
        V2V_TRY(recording_to_hdf5(given->output, recording, views, session));
    } else {
        struct recording_tiff tiff = {given->output, recording, views};
        V2V_TRY(v2v_agreement_alone(session->world, recording_to_tiff, &tiff));
        if (isfinite(info->offset) && info->offset != 0.0 && v2v_step_on_root(session)) {
            v2v_log(V2V_LOG_WARNING, "%s cannot say that its zero is %g: read it with --offset %g",
                    given->output, info->offset, info->offset);
        }
    }
done:
    v2v_mem_free(views);
    v2v_recording_close(&recording);
    return rc;
}

static enum v2v_status convert_psf(const struct arguments *given, const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    const struct v2v_input_settings *settings = &session->config.input;
    if (v2v_file_kind_of_name(given->output) != V2V_FILE_HDF5) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: PSFs are written as HDF5 (.h5) only", given->output));
    }
    V2V_TRY(v2v_psf_file_read(&psf, given->input, settings->without_views, session->world));
    if (settings->pixel_size_um > 0.0) {
        psf.pixel_size_um = settings->pixel_size_um;
    }
    if (settings->slice_spacing_um > 0.0) {
        psf.slice_spacing_um = settings->slice_spacing_um;
    }
    if (v2v_step_on_root(session)) {
        rc = v2v_psf_file_write(&psf, given->output);
    }
done:
    v2v_psf_file_fini(&psf);
    return v2v_par_agree(session->world, rc);
}

/* Whether a TIFF stack has the views of a recording: as many are asked for, or it has channels,
 * none of which is chosen, and no slices, as recordings are written. Collective(world). */
static enum v2v_status has_views(int64_t *has, const struct arguments *given,
                                 const struct v2v_session *session)
{
    const struct v2v_input_settings *input = &session->config.input;
    const int may = input->channel == 0 && input->slices == 0 && !v2v_bdv_is_name(given->output);
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    *has = input->views > 0;
    if (v2v_step_on_root(session) && !*has && may) {
        rc = v2v_tiff_open(&tiff, given->input);
        *has = rc == V2V_OK && v2v_tiff_info(tiff)->channels > 1 && v2v_tiff_info(tiff)->slices < 2;
        if (*has) {
            v2v_log(V2V_LOG_INFO,
                    "%s: its %lld channels are a recording's views; --channel K takes "
                    "one of them, as a volume",
                    given->input, (long long)v2v_tiff_info(tiff)->channels);
        }
        v2v_tiff_close(&tiff);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_max_i64(session->world, has, 1);
done:
    return rc;
}

/* What an option is of; folders: it says how their files make a volume, too. */
enum { OF_VOLUMES = 1, OF_RECORDINGS = 2, OF_PSFS = 4, OF_WEIGHTS = 8, OF_FOLDERS = 16 };

/* Options of contents that this one isn't would do nothing. */
static enum v2v_status refuse_others(const struct arguments *given, enum v2v_content content)
{
    enum { BOTH = OF_VOLUMES | OF_RECORDINGS };
    static const struct {
        const char *key, *option, *owners;
        int of;
    } inputs[] = {
        {"input.views", "--views", "recordings and weights",
         OF_RECORDINGS | OF_WEIGHTS | OF_FOLDERS},
        {"input.layout", "--layout", "recordings", OF_RECORDINGS | OF_FOLDERS},
        {"input.first_view", "--first-view", "recordings", OF_RECORDINGS},
        {"input.without_views", "--without-views", "recordings and PSFs", OF_RECORDINGS | OF_PSFS},
        {"input.stride", "--stride", "recordings", OF_RECORDINGS},
        {"input.slices", "--slices", "volumes and weights", OF_VOLUMES | OF_WEIGHTS},
        {"input.channel", "--channel", "volumes and recordings", BOTH},
        {"input.dataset", "--dataset", "volumes and recordings", BOTH},
        {"input.pixel_size_um", "--pixel-size", "images", BOTH | OF_PSFS},
        {"input.slice_spacing_um", "--slice-spacing", "volumes", OF_VOLUMES | OF_PSFS},
        {"input.frame_interval_s", "--frame-interval", "volumes and recordings", BOTH}};
    static const struct {
        int of;
        const char *name;
    } contents[] = {[V2V_CONTENT_VOLUME] = {OF_VOLUMES, "a volume (--kind recording)"},
                    [V2V_CONTENT_RECORDING] = {OF_RECORDINGS, "a recording (--kind volume)"},
                    [V2V_CONTENT_PSF] = {OF_PSFS, "PSFs"},
                    [V2V_CONTENT_WEIGHTS] = {OF_WEIGHTS, "weights"}};
    enum v2v_status rc = V2V_OK;
    const int is_known = content > V2V_CONTENT_AUTO && content <= V2V_CONTENT_WEIGHTS;
    const int is_folder = content == V2V_CONTENT_VOLUME && v2v_file_is_folder(given->input);
    for (size_t i = 0; i < sizeof inputs / sizeof *inputs && is_known; i++) {
        const int taken = contents[content].of | (is_folder ? OF_FOLDERS : 0);
        if (v2v_options_set(&given->common, inputs[i].key) && (inputs[i].of & taken) == 0) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s is of %s, and %s is taken for %s", inputs[i].option,
                             inputs[i].owners, given->input, contents[content].name));
        }
    }
    if (content != V2V_CONTENT_RECORDING && content != V2V_CONTENT_VOLUME &&
        given->frames != NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--frames: %s has none", given->input));
    }
    if (content != V2V_CONTENT_VOLUME) {
        V2V_TRY(v2v_storage_refuse(&given->storage, given->input));
    }
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    enum v2v_content content = (enum v2v_content)given->kind;
    const enum v2v_file_kind output = v2v_file_kind_of_name(given->output);
    if (output != V2V_FILE_HDF5 && output != V2V_FILE_TIFF && output != V2V_FILE_SAFETENSORS &&
        !v2v_bdv_is_name(given->output)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "%s: the output's name must end in .h5, .tif, .xml or .safetensors",
                         given->output));
    }
    V2V_TRY(v2v_step_output(session, given->output, &given->input, 1));
    if (content == V2V_CONTENT_AUTO && session->config.input.dataset[0] != '\0') {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--dataset needs --kind volume or recording: what it is"));
    }
    if (content == V2V_CONTENT_AUTO) {
        V2V_TRY(v2v_content_of(&content, given->input, session));
    }
    if (content != V2V_CONTENT_WEIGHTS && output == V2V_FILE_SAFETENSORS) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: safetensors hold weights, which %s are not",
                         given->output, given->input));
    }
    if (content == V2V_CONTENT_TIFF) {
        int64_t is_recording = 0;
        V2V_TRY(has_views(&is_recording, given, session));
        content = is_recording ? V2V_CONTENT_RECORDING : V2V_CONTENT_VOLUME;
    }
    V2V_TRY(refuse_others(given, content));
    switch (content) {
    case V2V_CONTENT_VOLUME:
        V2V_TRY(convert_volume(given, session));
        break;
    case V2V_CONTENT_RECORDING:
        V2V_TRY(convert_recording(given, session));
        break;
    case V2V_CONTENT_PSF:
        V2V_TRY(convert_psf(given, session));
        break;
    case V2V_CONTENT_WEIGHTS:
    case V2V_CONTENT_AUTO:
        V2V_TRY(v2v_convert_weights(session, given->input, given->output));
        break;
    case V2V_CONTENT_TIFF: /* became one of the others */
    case V2V_CONTENT_YAML:
    case V2V_CONTENT_RUN:
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: has no other format", given->input));
    }
    v2v_log(V2V_LOG_INFO, "%s: written", given->output);
done:
    return rc;
}

const struct v2v_command v2v_command_convert = {
    .name = "convert",
    .summary =
        "TIFF <-> HDF5: volumes, recordings; PSFs to HDF5; volumes for BigDataViewer; weights",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
