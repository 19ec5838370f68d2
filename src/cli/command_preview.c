#include "cli/picture.h"
#include "cli/steps.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/preview.h"
#include "v2v3d/io/apng.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"
#include <inttypes.h>

struct arguments {
    struct v2v_common common;
    const char *volume, *output;
    const char *frames; /* FIRST:COUNT; NULL: `frame` alone */
    int kind;           /* enum v2v_preview_kind */
    int64_t frame, z_zoom;
    double low, high;
};

static const struct v2v_option options[] = {
    {.name = "volume",
     .kind = V2V_OPTION_OPERAND,
     .at = offsetof(struct arguments, volume),
     .value = "VOLUME",
     .help = "HDF5 or TIFF",
     .required = 1},
    V2V_OPTION_OUTPUT(struct arguments, output, "picture to write, .png (animated with --frames)"),
    {.name = "frame",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, frame),
     .value = "T",
     .help = "counted from 0",
     .initial = "0",
     .least = 0,
     .most = 1e9},
    {.name = "frames",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, frames),
     .value = "FIRST:COUNT",
     .help = "these instead, as an animated PNG in one grey range; fewer where they end"},
    {.name = "kind",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct arguments, kind),
     .value = "projections|montage|depth",
     .help = "maxima along z, x and y; slices side by side; maximum along z, coloured by its depth",
     .initial = "projections"},
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {.name = "z-zoom",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, z_zoom),
     .value = "N",
     .help = "pixels a slice; default: as the voxel size says, else 2",
     .least = 1,
     .most = 64},
    {.name = "low",
     .kind = V2V_OPTION_NUMBER,
     .at = offsetof(struct arguments, low),
     .value = "X",
     .help = "drawn black (default 0)",
     .least = -1e30,
     .most = 1e30},
    {.name = "high",
     .kind = V2V_OPTION_NUMBER,
     .at = offsetof(struct arguments, high),
     .value = "X",
     .help = "drawn white; default: the 99.9th percentile",
     .least = -1e30,
     .most = 1e30},
    {0}};

enum { FRAMES_PER_SECOND = 8 };

/* One grey range for all frames, unless it is given. Local. */
static enum v2v_status settle_range(struct v2v_preview *preview, struct v2v_volume *volume,
                                    struct v2v_part frames, float *voxels)
{
    enum v2v_status rc = V2V_OK;
    if (preview->low != 0.0 || preview->high != 0.0) {
        return V2V_OK;
    }
    for (int64_t t = frames.first; t < frames.first + frames.count; t++) {
        v2v_watchdog_beat("preview: the range of a frame");
        V2V_TRY(v2v_volume_read(volume, voxels, t, 0, preview->slices));
        V2V_TRY(v2v_preview_widen(preview, voxels));
    }
done:
    return rc;
}

/* Local. */
static enum v2v_status draw(const struct v2v_preview *preview, struct v2v_volume *volume,
                            struct v2v_part frames, float *voxels, const char *output)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_canvas canvas = {0};
    struct v2v_apng *apng = NULL;
    if (frames.count > 1) {
        V2V_TRY(v2v_apng_create(&apng, output, frames.count, FRAMES_PER_SECOND));
    }
    for (int64_t t = frames.first; t < frames.first + frames.count; t++) {
        v2v_watchdog_beat("preview: a frame");
        V2V_TRY(v2v_volume_read(volume, voxels, t, 0, preview->slices));
        V2V_TRY(v2v_preview_draw(&canvas, preview, voxels));
        V2V_TRY(apng != NULL ? v2v_apng_put(apng, &canvas)
                             : v2v_png_write(output, canvas.rgb, canvas.height, canvas.width, 3));
        v2v_canvas_fini(&canvas);
    }
    if (apng != NULL) {
        V2V_TRY(v2v_apng_finish(&apng));
    }
done:
    v2v_apng_abandon(&apng);
    v2v_canvas_fini(&canvas);
    return rc;
}

/* What rank 0 draws while the others hear its beats. */
struct film {
    const struct arguments *given;
    struct v2v_volume *volume;
    struct v2v_part frames;
};

static enum v2v_status preview(void *context)
{
    enum v2v_status rc = V2V_OK;
    const struct film *film = context;
    const struct arguments *given = film->given;
    const struct v2v_volume_info *info = v2v_volume_info(film->volume);
    struct v2v_preview preview = {.kind = (enum v2v_preview_kind)given->kind,
                                  .slices = info->slices,
                                  .height = info->height,
                                  .width = info->width,
                                  .z_zoom = given->z_zoom > 0 ? (int)given->z_zoom
                                                              : v2v_picture_z_zoom(info),
                                  .low = given->low,
                                  .high = given->high,
                                  .slice_spacing_um = info->slice_spacing_um};
    float *voxels = NULL;
    V2V_TRY(V2V_ALLOC(voxels, "preview.volume",
                      v2v_mem_product(info->slices, info->height, info->width)));
    V2V_TRY(settle_range(&preview, film->volume, film->frames, voxels));
    V2V_TRY(draw(&preview, film->volume, film->frames, voxels, given->output));
done:
    v2v_mem_free(voxels);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_part frames = {given->frame, 1};
    if (given->frames != NULL) {
        V2V_TRY(v2v_step_frames(&frames, given->frames));
    }
    V2V_TRY(v2v_step_output(session, given->output, &given->volume, 1));
    V2V_TRY(v2v_volume_open(&volume, given->volume, &session->config.input, session->world));
    const int64_t there = v2v_volume_info(volume)->frames;
    if (frames.first >= there) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--frame %" PRId64 ": %s has frames 0 .. %" PRId64,
                         frames.first, given->volume, there - 1));
    }
    frames.count = v2v_smaller(frames.count, there - frames.first);
    struct film film = {given, volume, frames};
    V2V_TRY(v2v_agreement_alone(session->world, preview, &film));
    v2v_log(V2V_LOG_INFO, "%s: frame %" PRId64 "%s of %s", given->output, frames.first,
            frames.count > 1 ? " and those after it" : "", given->volume);
done:
    v2v_volume_close(&volume);
    return rc;
}

const struct v2v_command v2v_command_preview = {
    .name = "preview",
    .summary = "pictures of a volume: projections, slices, depth; of frames, a film",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
