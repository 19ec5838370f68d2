#include "cli/picture.h"
#include "cli/steps.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/eval/preview.h"
#include "v2v3d/io/apng.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"
#include <inttypes.h>
#include <math.h>

struct arguments {
    struct v2v_common common;
    const char *volume, *output;
    const char *frame, *frames; /* FIRST:COUNT; NULL: `frame` alone */
    const char *low, *high;     /* numbers, likewise */
    int kind;                   /* enum v2v_preview_kind */
    int64_t z_zoom;
};

static const struct v2v_option options[] = {
    V2V_OPTION_NAMELESS(struct arguments, volume, "VOLUME", "HDF5 or TIFF"),
    V2V_OPTION_OUTPUT(struct arguments, output, "picture to write, .png (animated with --frames)"),
    {.name = "frame",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, frame),
     .value = "T",
     .help = "counted from 0; default: the first that is finished"},
    V2V_OPTION_FRAMES(struct arguments, frames,
                      "these instead, as an animated PNG in one grey range; fewer where they end"),
    {.name = "kind",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct arguments, kind),
     .value = "projections|montage|depth",
     .help = "maxima along z, x and y; slices side by side; maximum along z, coloured by its depth",
     .initial = "projections"},
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTION_SLICE_SPACING,
    {.name = "z-zoom",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, z_zoom),
     .value = "N",
     .help = "of projections: pixels a slice; default: as the voxel size says, else 2",
     .least = 1,
     .most = 64},
    {.name = "low",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, low),
     .value = "X",
     .help = "drawn black (default 0)"},
    {.name = "high",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, high),
     .value = "X",
     .help = "drawn white; default: the 99.9th percentile"},
    {0}};

enum { FRAMES_PER_SECOND = 8 };

/* What rank 0 draws while the others hear its beats. */
struct film {
    const char *output;
    struct v2v_volume *volume;
    struct v2v_part frames;
    struct v2v_preview preview;
    float *voxels; /* [z,y,x] of frame `held` */
    int64_t held;  /* -1: none */
};

/* Frame t, which one picture alone takes twice. */
static enum v2v_status hold(struct film *film, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    if (film->held != t) {
        film->held = -1;
        V2V_TRY(v2v_volume_read(film->volume, film->voxels, t, 0, film->preview.slices));
        film->held = t;
    }
done:
    return rc;
}

/* One grey range for all frames, as far as it isn't given. */
static enum v2v_status settle_range(struct film *film)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_preview *preview = &film->preview;
    const int is_given = !isnan(preview->high);
    preview->low = is_given && isnan(preview->low) ? 0.0 : preview->low;
    for (int64_t i = 0; i < film->frames.count && !is_given; i++) {
        v2v_watchdog_beat("preview: the range of a frame");
        V2V_TRY(hold(film, film->frames.first + i));
        V2V_TRY(v2v_preview_widen(preview, film->voxels));
    }
done:
    return rc;
}

static enum v2v_status draw(struct film *film)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_canvas canvas = {0};
    struct v2v_apng *apng = NULL;
    if (film->frames.count > 1) {
        V2V_TRY(v2v_apng_create(&apng, film->output, film->frames.count, FRAMES_PER_SECOND));
    }
    for (int64_t i = 0; i < film->frames.count; i++) {
        v2v_watchdog_beat("preview: a frame");
        V2V_TRY(hold(film, film->frames.first + i));
        V2V_TRY(v2v_preview_draw(&canvas, &film->preview, film->voxels));
        V2V_TRY(apng != NULL
                    ? v2v_apng_put(apng, &canvas)
                    : v2v_png_write(film->output, canvas.rgb, canvas.height, canvas.width, 3));
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

static enum v2v_status make(void *context)
{
    enum v2v_status rc = V2V_OK;
    struct film *film = context;
    const struct v2v_preview *preview = &film->preview;
    V2V_TRY(V2V_ALLOC(film->voxels, "preview.volume",
                      v2v_mem_product(preview->slices, preview->height, preview->width)));
    V2V_TRY(settle_range(film));
    V2V_TRY(draw(film));
done:
    v2v_mem_free(film->voxels);
    return rc;
}

/* NaN where it isn't given. */
static enum v2v_status parse_grey(double *value, const char *text, const char *option)
{
    *value = NAN;
    return text == NULL ? V2V_OK : v2v_text_to_f64(value, text, -1e30, 1e30, option, V2V_E_USAGE);
}

/* What the words ask for. Local. */
static enum v2v_status parse(struct film *film, const struct arguments *given)
{
    enum v2v_status rc = V2V_OK;
    *film = (struct film){.output = given->output, .frames = {0, 1}, .held = -1};
    if (given->frame != NULL && given->frames != NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--frame and --frames do not go together"));
    }
    if (given->z_zoom > 0 && given->kind != V2V_PREVIEW_PROJECTIONS) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--z-zoom is of --kind projections alone: others draw no "
                                      "slice from its side"));
    }
    if (given->frame != NULL) {
        V2V_TRY(v2v_text_to_i64(&film->frames.first, given->frame, 0, INT64_MAX, "--frame",
                                V2V_E_USAGE));
    }
    if (given->frames != NULL) {
        V2V_TRY(v2v_step_frames(&film->frames, given->frames));
    }
    V2V_TRY(parse_grey(&film->preview.low, given->low, "--low"));
    V2V_TRY(parse_grey(&film->preview.high, given->high, "--high"));
    if ((given->low != NULL ? film->preview.low : 0.0) >= film->preview.high) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--high %s is not above --low %s: there is nothing between",
                         given->high, given->low != NULL ? given->low : "0"));
    }
done:
    return rc;
}

/* What of it the open volume has. Local. */
static enum v2v_status meet(struct film *film, const struct arguments *given)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = v2v_volume_info(film->volume);
    struct v2v_preview *preview = &film->preview;
    const int is_any = given->frame == NULL && given->frames == NULL;
    for (int64_t t = 0; t < info->frames && is_any; t++) { /* of evaluate --uncertainty: some */
        if (v2v_volume_has(film->volume, t)) {
            film->frames.first = t;
            break;
        }
    }
    if (film->frames.first >= info->frames) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s %" PRId64 ": %s has frames 0 .. %" PRId64,
                         given->frames != NULL ? "--frames from" : "--frame", film->frames.first,
                         given->volume, info->frames - 1));
    }
    film->frames.count = v2v_smaller(film->frames.count, info->frames - film->frames.first);
    preview->kind = (enum v2v_preview_kind)given->kind;
    preview->slices = info->slices;
    preview->height = info->height;
    preview->width = info->width;
    preview->z_zoom = given->z_zoom > 0 ? (int)given->z_zoom : v2v_picture_z_zoom(info);
    preview->slice_spacing_um = info->slice_spacing_um;
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct film film = {0};
    V2V_TRY(v2v_picture_check_name(given->output));
    V2V_TRY(parse(&film, given));
    V2V_TRY(v2v_step_output(session, given->output, &given->volume, 1));
    V2V_TRY(v2v_volume_open(&film.volume, given->volume, &session->config.input, session->world));
    V2V_TRY(meet(&film, given));
    V2V_TRY(v2v_agreement_alone(session->world, make, &film));
    v2v_log(V2V_LOG_INFO, "%s: frame %" PRId64 "%s of %s", given->output, film.frames.first,
            film.frames.count > 1 ? " and those after it" : "", given->volume);
done:
    v2v_volume_close(&film.volume);
    return rc;
}

const struct v2v_command v2v_command_preview = {
    .name = "preview",
    .summary = "pictures of a volume: projections, slices, depth; of frames, a film",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
