#include "cli/steps.h"
#include "cli/unused_settings.h"

#include "v2v3d/base/log.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/recon/denoise.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

struct arguments {
    struct v2v_common common;
    const char *weights, *input, *clean, *output;
};

static const struct v2v_option options[] = {
    V2V_OPTION_FILE(struct arguments, weights, "weights", 1,
                    "of a network that makes views: deepcad, synthesis"),
    V2V_OPTION_FILE(struct arguments, input, "input", 1, "recording"),
    V2V_OPTION_OUTPUT(struct arguments, output, "recording to write, for any method"),
    V2V_OPTION_FILE(struct arguments, clean, "clean", 0,
                    "the recording without noise: tells the PSNR of both"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    {0}};

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    const struct v2v_psf_file any = {0};
    const struct v2v_network_ops *network = NULL;
    const char *const inputs[] = {given->weights, given->input, given->clean};
    struct v2v_recording *recording = NULL, *clean = NULL;
    struct v2v_scaling scaling, of_clean = {0};
    struct v2v_input_settings clean_input = session->config.input; /* whose gain doesn't matter */
    struct v2v_denoise_report report;
    V2V_TRY(v2v_step_output(session, given->output, inputs,
                            (int64_t)(sizeof inputs / sizeof inputs[0])));
    V2V_TRY(v2v_step_network(session, &network, given->weights, 1));
    V2V_TRY(v2v_step_recording(session, &recording, given->input, &any));
    V2V_TRY(v2v_scaling_decide(&scaling, recording, &session->config.input, session->world));
    if (given->clean != NULL) {
        V2V_TRY(v2v_step_recording(session, &clean, given->clean, &any));
        clean_input.gain.mode = V2V_NUMBER_NONE;
        if (!isnan(v2v_recording_info(clean)->offset)) { /* it has a zero of its own */
            clean_input.offset.mode = V2V_NUMBER_AUTO;
        }
        V2V_TRY(v2v_scaling_decide(&of_clean, clean, &clean_input, session->world));
    }
    v2v_scaling_warn(&scaling, given->input, session->world);
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_command("denoise", session);
    }
    const struct v2v_denoise_job job = {.config = &session->config,
                                        .weights = given->weights,
                                        .recording = recording,
                                        .scaling = &scaling,
                                        .clean = clean,
                                        .zero_of_clean = of_clean.offset,
                                        .output = given->output};
    v2v_step_announce(session);
    V2V_TRY(v2v_denoise_run(&job, &report, session->world));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " frames of %" PRId64 " views in %.1f s", given->output,
            info->frames, info->views, report.seconds);
    if (clean != NULL && v2v_step_on_root(session)) {
        printf("PSNR of the views: %.2f dB before, %.2f dB after\n", report.psnr_before,
               report.psnr_after);
    }
done:
    v2v_recording_close(&clean);
    v2v_recording_close(&recording);
    return rc;
}

const struct v2v_command v2v_command_denoise = {
    .name = "denoise",
    .summary = "recording of less noise by a network of views, before any other method",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
