#include "cli/picture.h"
#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include <inttypes.h>

struct arguments {
    struct v2v_common common;
    const char *volume, *output;
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
    V2V_OPTION_OUTPUT(struct arguments, output, "picture to write, .png"),
    {.name = "frame",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, frame),
     .value = "T",
     .help = "counted from 0",
     .initial = "0",
     .least = 0,
     .most = 1e9},
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

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_canvas canvas = {0};
    V2V_TRY(v2v_step_output(session, given->output, &given->volume, 1));
    V2V_TRY(v2v_volume_open(&volume, given->volume, &session->config.input, session->world));
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    if (given->frame >= info->frames) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--frame %" PRId64 ": %s has frames 0 .. %" PRId64,
                         given->frame, given->volume, info->frames - 1));
    }
    if (v2v_step_on_root(session)) {
        int zoom = given->z_zoom > 0 ? (int)given->z_zoom : v2v_picture_z_zoom(info);
        rc = v2v_picture_frame(&canvas, volume, given->frame, zoom, given->low, given->high);
        if (rc == V2V_OK) {
            rc = v2v_png_write(given->output, canvas.rgb, canvas.height, canvas.width, 3);
        }
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_log(V2V_LOG_INFO, "%s: frame %" PRId64 " of %s", given->output, given->frame,
            given->volume);
done:
    v2v_canvas_fini(&canvas);
    v2v_volume_close(&volume);
    return rc;
}

const struct v2v_command v2v_command_preview = {.name = "preview",
                                                .summary =
                                                    "maximum projections along z, y, x in one PNG",
                                                .options = options,
                                                .bytes = sizeof(struct arguments),
                                                .run = run};
