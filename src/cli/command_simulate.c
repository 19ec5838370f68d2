#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/sim/recording.h"
#include <inttypes.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *volume, *output, *noise;
    int64_t seed, frames;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    V2V_OPTION_FILE(struct arguments, volume, "volume", 1,
                    "scene; integers are read as fractions of their type's maximum"),
    V2V_OPTION_OUTPUT(struct arguments, output, "recording to write"),
    {.name = "noise",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, noise),
     .value = "KIND",
     .help = "none; gaussian:S, S times the level (99.5th percentile of the clean views); "
             "poisson:N, N photons at the level",
     .initial = "none"},
    {.name = "seed",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, seed),
     .value = "N",
     .help = "of the noise",
     .initial = "1",
     .least = 0,
     .most = 1e15},
    {.name = "frames",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, frames),
     .value = "T",
     .help = "frames to make, the volume's over and over; default: the volume's",
     .least = 1,
     .most = 1e6},
    V2V_OPTION_CALIBRATION(struct arguments, calibration),
    V2V_OPTION_NORMALIZE,
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_volume *volume = NULL;
    struct v2v_noise noise;
    V2V_TRY(v2v_noise_parse(&noise, given->noise));
    V2V_TRY(v2v_step_output(session, given->output,
                            (const char *const[]){given->psf, given->volume, given->calibration},
                            3));
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_step_volume(session, &volume, given->volume, &psf));
    int64_t frames = given->frames > 0 ? given->frames : v2v_volume_info(volume)->frames;
    V2V_TRY(v2v_simulate_recording(
        given->output, volume, &psf, &noise, (uint64_t)given->seed, frames,
        session->calibration.views > 0 ? &session->calibration : NULL, session->world));
    v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " frames of %" PRId64 " views, noise %s, level %g",
            given->output, frames, psf.views, given->noise, noise.level);
done:
    v2v_volume_close(&volume);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_simulate = {.name = "simulate",
                                                 .summary = "noisy recording of a volume",
                                                 .options = options,
                                                 .bytes = sizeof(struct arguments),
                                                 .run = run};
