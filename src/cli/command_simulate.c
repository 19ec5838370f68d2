#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/sim/recording.h"
#include <inttypes.h>
#include <string.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *volume, *scene, *output, *clean, *truth, *noise, *size;
    int64_t seed, frames;
    double motion;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 0),
    V2V_OPTION_FILE(struct arguments, volume, "volume", 0,
                    "what is seen; integers are read as fractions of their type's maximum"),
    {.name = "scene",
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, scene),
     .value = "KIND",
     .help = "or a scene that is drawn: " V2V_SCENE_KINDS
             "; planes, views of cameras (section synthesis) without PSFs"},
    V2V_OPTION_OUTPUT(struct arguments, output, "recording to write"),
    V2V_OPTION_FILE(struct arguments, clean, "clean", 0, "the recording without noise, to write"),
    V2V_OPTION_FILE(struct arguments, truth, "truth", 0, "the scene's volume, to write"),
    V2V_OPTION_NOISE(struct arguments, noise, "none"),
    {.name = "seed",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, seed),
     .value = "N",
     .help = "of scenes and noise",
     .initial = "1",
     .least = 0,
     .most = 1e15},
    {.name = "frames",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, frames),
     .value = "T",
     .help = "frames to make, the volume's over and over; default: the volume's, of a scene 1",
     .least = 1,
     .most = 1e6},
    V2V_OPTION_SIZE(struct arguments, size),
    {.name = "motion",
     .kind = V2V_OPTION_NUMBER,
     .at = offsetof(struct arguments, motion),
     .value = "UM",
     .help = "of a scene: way of every structure from frame to frame",
     .least = 0,
     .most = 1e6},
    V2V_OPTION_CALIBRATION(struct arguments, calibration),
    V2V_OPTION_NORMALIZE,
    V2V_OPTION_SLICES,
    V2V_OPTIONS_INPUT,
    V2V_OPTIONS_SIZES,
    {0}};

static int is_of_planes(const struct arguments *given)
{
    return given->scene != NULL && strcmp(given->scene, V2V_SCENE_PLANES) == 0;
}

static enum v2v_status check(const struct arguments *given)
{
    const int is_scene = given->scene != NULL;
    if (is_of_planes(given) && (given->psf != NULL || given->truth != NULL ||
                                given->calibration != NULL || given->motion > 0)) {
        return V2V_FAIL(V2V_E_USAGE, "--scene " V2V_SCENE_PLANES " has no volume and stands still: "
                                     "no --psf, --truth, --calibration or --motion");
    }
    if (given->psf == NULL && !is_of_planes(given)) {
        return V2V_FAIL(V2V_E_USAGE, "--psf FILE is missing");
    }
    if (is_scene == (given->volume != NULL)) {
        return V2V_FAIL(V2V_E_USAGE, "give either --volume or --scene");
    }
    static const char *const of_files[] = {"input.slices", "input.channel", "input.dataset"};
    for (size_t i = 0; is_scene && i < sizeof of_files / sizeof of_files[0]; i++) {
        if (v2v_options_set(&given->common, of_files[i])) {
            return V2V_FAIL(V2V_E_USAGE, "%s says how a --volume is read; a --scene is drawn",
                            of_files[i]);
        }
    }
    if (!is_scene && (given->truth != NULL || given->size != NULL || given->motion > 0)) {
        return V2V_FAIL(V2V_E_USAGE, "--truth, --size and --motion are for a --scene");
    }
    return V2V_OK;
}

static enum v2v_status check_outputs(const struct arguments *given,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const char *const outputs[] = {given->output, given->clean, given->truth};
    const char *const inputs[] = {given->psf, given->volume, given->calibration};
    for (size_t i = 0; i < sizeof outputs / sizeof outputs[0]; i++) {
        if (outputs[i] != NULL) {
            V2V_TRY(v2v_step_output(session, outputs[i], inputs,
                                    (int64_t)(sizeof inputs / sizeof inputs[0])));
        }
        for (size_t k = 0; k < i; k++) {
            if (outputs[i] != NULL && outputs[k] != NULL && strcmp(outputs[i], outputs[k]) == 0) {
                V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: named for two outputs", outputs[i]));
            }
        }
    }
done:
    return rc;
}

/* Record the volume or scene. */
static enum v2v_status record(struct v2v_simulation *simulation, const struct v2v_session *session,
                              const struct v2v_psf_file *psf, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_simulator *simulator = NULL;
    const struct v2v_calibration *calibration =
        session->calibration.views > 0 ? &session->calibration : NULL;
    V2V_TRY(v2v_simulator_create(&simulator, psf, height, width, calibration, session->world));
    V2V_TRY(v2v_simulator_record(simulator, simulation));
    v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " frames of %" PRId64 " views, noise level %g",
            simulation->output, simulation->frames, psf->views, simulation->noise.level);
done:
    v2v_simulator_destroy(&simulator);
    return rc;
}

static enum v2v_status of_volume(struct v2v_simulation *simulation, const struct arguments *given,
                                 const struct v2v_session *session, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_step_volume(session, &simulation->volume, given->volume, psf));
    const struct v2v_volume_info *info = v2v_volume_info(simulation->volume);
    const struct v2v_recording_info recording = v2v_step_recording_of(info, psf);
    simulation->pixel_size_um = recording.pixel_size_um;
    simulation->frame_interval_s = recording.frame_interval_s;
    simulation->frames = given->frames > 0 ? given->frames : info->frames;
    V2V_TRY(record(simulation, session, psf, info->height, info->width));
done:
    v2v_volume_close(&simulation->volume);
    return rc;
}

static enum v2v_status of_scene(struct v2v_simulation *simulation, const struct arguments *given,
                                const struct v2v_session *session, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scene scene = {.motion_um = given->motion, .seed = (uint64_t)given->seed};
    V2V_TRY(v2v_scene_find(&scene.kind, given->scene));
    V2V_TRY(v2v_step_scene(&scene, simulation, session, psf, given->size));
    V2V_TRY(v2v_scene_check(&scene));
    simulation->scene = &scene;
    simulation->frames = given->frames > 0 ? given->frames : 1;
    V2V_TRY(record(simulation, session, psf, scene.height, scene.width));
done:
    return rc;
}

/* Cameras are in the place of PSFs. */
static enum v2v_status of_planes(struct v2v_simulation *simulation, const struct arguments *given,
                                 const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_synthesis_settings *settings = &session->config.synthesis;
    struct v2v_scene size;
    struct v2v_cameras cameras = {0};
    V2V_TRY(v2v_par_agree(session->world,
                          v2v_cameras_init(&cameras, settings, session->config.input.views)));
    const struct v2v_psf_file of_cameras = {.views = cameras.views};
    V2V_TRY(v2v_step_scene(&size, simulation, session, &of_cameras, given->size));
    const struct v2v_planes planes = {.cameras = &cameras,
                                      .nearest = settings->nearest,
                                      .farthest = settings->farthest,
                                      .height = size.height,
                                      .width = size.width,
                                      .seed = (uint64_t)given->seed};
    simulation->planes = &planes;
    simulation->frames = given->frames > 0 ? given->frames : 1;
    V2V_TRY(record(simulation, session, &of_cameras, size.height, size.width));
done:
    v2v_cameras_fini(&cameras);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_simulation simulation = {.seed = (uint64_t)given->seed,
                                        .output = given->output,
                                        .clean = given->clean,
                                        .truth = given->truth};
    V2V_TRY(check(given));
    V2V_TRY(v2v_noise_parse(&simulation.noise, given->noise));
    V2V_TRY(check_outputs(given, session));
    if (is_of_planes(given)) {
        V2V_TRY(of_planes(&simulation, given, session));
        goto done;
    }
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(given->scene != NULL ? of_scene(&simulation, given, session, &psf)
                                 : of_volume(&simulation, given, session, &psf));
done:
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_simulate = {.name = "simulate",
                                                 .summary = "noisy recording of a volume or scene",
                                                 .options = options,
                                                 .bytes = sizeof(struct arguments),
                                                 .run = run};
