#include "cli/content.h"
#include "cli/information.h"
#include "cli/steps.h"

struct arguments {
    struct v2v_common common;
    const char *path;
    int64_t frame;
    int json;
};

static const struct v2v_option options[] = {
    V2V_OPTION_NAMELESS(struct arguments, path, "FILE",
                        "recording, volume, PSFs, weights, calibration, settings, run folder"),
    V2V_OPTION_FRAME(struct arguments, frame, "whose numbers are looked at"),
    V2V_OPTION_SWITCH(struct arguments, json, "json", "print one JSON object"),
    V2V_OPTIONS_PAGES,
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    {0}};

static enum v2v_status inform(const struct arguments *given, enum v2v_content content,
                              const struct v2v_session *session)
{
    static const struct {
        const char *kind;
        v2v_informer *inform;
        int has_frames; /* bool */
    } kinds[] = {[V2V_CONTENT_VOLUME] = {"volume", v2v_inform_volume, 1},
                 [V2V_CONTENT_RECORDING] = {"recording", v2v_inform_recording, 1},
                 [V2V_CONTENT_PSF] = {"psf", v2v_inform_psf},
                 [V2V_CONTENT_WEIGHTS] = {"weights", v2v_inform_weights},
                 [V2V_CONTENT_TIFF] = {"tiff", v2v_inform_tiff, 1},
                 [V2V_CONTENT_YAML] = {"yaml", v2v_inform_yaml},
                 [V2V_CONTENT_RUN] = {"run", v2v_inform_run}};
    enum v2v_status rc = V2V_OK;
    struct v2v_report report = {0};
    if (given->frame > 0 && !kinds[content].has_frames) {
        return V2V_FAIL(V2V_E_USAGE, "--frame: %s has none", given->path);
    }
    V2V_TRY(v2v_par_agree(session->world, v2v_report_init(&report, kinds[content].kind)));
    rc = kinds[content].inform(&report, given->path, given->frame, session);
    V2V_TRY(v2v_par_agree(session->world, rc));
    if (v2v_step_on_root(session)) {
        rc = v2v_report_print(&report, given->path, stdout, given->json);
    }
done:
    v2v_report_fini(&report);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    const struct v2v_input_settings *input = &session->config.input;
    enum v2v_status rc = V2V_OK;
    enum v2v_content content = V2V_CONTENT_AUTO;
    V2V_TRY(v2v_content_of(&content, given->path, session));
    /* neither says whether it has views or slices */
    const int is_open =
        content == V2V_CONTENT_TIFF || (content == V2V_CONTENT_VOLUME && input->dataset[0] != '\0');
    if (is_open && input->views > 0) {
        content = V2V_CONTENT_RECORDING;
    } else if (is_open && (input->slices > 0 || input->channel > 0)) {
        content = V2V_CONTENT_VOLUME;
    }
    V2V_TRY(inform(given, content, session));
done:
    return rc;
}

const struct v2v_command v2v_command_info = {.name = "info",
                                             .summary = "what is in a file",
                                             .options = options,
                                             .bytes = sizeof(struct arguments),
                                             .run = run};

static const struct v2v_option weights_options[] = {
    V2V_OPTION_NAMELESS(struct arguments, path, "FILE", "weights"),
    V2V_OPTION_SWITCH(struct arguments, json, "json", "print one JSON object"),
    V2V_OPTION_SLICES,
    {0}};

static enum v2v_status run_weights(const void *arguments, struct v2v_session *session)
{
    return inform(arguments, V2V_CONTENT_WEIGHTS, session);
}

const struct v2v_command v2v_command_weights_info = {.name = "weights info",
                                                     .summary = "what is in a weight file",
                                                     .options = weights_options,
                                                     .bytes = sizeof(struct arguments),
                                                     .run = run_weights};
