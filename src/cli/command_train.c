#include "cli/steps.h"
#include "cli/unused_settings.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/eval/settle.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/train/train.h"
#include <inttypes.h>
#include <string.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *weights, *folder;
    struct v2v_words inputs, truths;
    int resume;
    double max_time_s;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 0),
    {.name = "input",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, inputs),
     .value = "FILE...",
     .help = "recordings to learn from",
     .required = 1},
    {.name = "truth",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, truths),
     .value = "FILE...",
     .help = "vcdnet: the recordings' true volumes, in their order; of one frame: that of all"},
    {.name = "output",
     .letter = 'o',
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, folder),
     .value = "FOLDER",
     .help = "of the run: weights.h5, metrics.jsonl, config.yaml",
     .required = 1},
    V2V_OPTION_FILE(struct arguments, weights, "weights", 0,
                    "start from these; they decide on the network"),
    V2V_OPTION_CALIBRATION(struct arguments, calibration),
    V2V_OPTION_SWITCH(struct arguments, resume, "resume",
                      "go on where the run in FOLDER stopped, without -c by its config.yaml"),
    {.name = "max-time",
     .kind = V2V_OPTION_DURATION,
     .at = offsetof(struct arguments, max_time_s),
     .value = "TIME",
     .help = "stop with a checkpoint (exit code 85) after 90s, 20m, 3h of this attempt; with "
             "train.schedule linear: end there"},
    V2V_OPTION_SET("steps", "train.steps", "N", "steps in all"),
    V2V_OPTION_SET("seed", "train.seed", "N", "of crops and fresh weights"),
    V2V_OPTION_SET("reproducible", "parallel.reproducible", NULL,
                   "the same bits at any rank count and grid; one thread a rank unless told"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    {0}};

/* A resumed run keeps its network even when it was started from --weights; a checkpoint that
 * cannot be read is left to training, which knows the older generation. */
static enum v2v_status adopt_checkpoint(int *is_there, const struct arguments *given,
                                        struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info = {0};
    if (v2v_step_on_root(session)) {
        static const char *const generations[] = {V2V_RUN_WEIGHTS, V2V_RUN_WEIGHTS_BEFORE};
        for (int i = 0; i < 2 && info.views == 0; i++) {
            char path[V2V_PATH_BYTES];
            rc = v2v_text_format(path, sizeof path, "%s/%s", given->folder, generations[i]);
            if (rc == V2V_OK && v2v_file_exists(path) &&
                v2v_weights_file_info(&info, path) != V2V_OK) {
                info.views = 0;
            }
        }
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, &info, (int64_t)sizeof info, 0);
    *is_there = info.views > 0;
    if (*is_there) {
        const struct v2v_network_ops *ops = NULL;
        V2V_TRY(v2v_network_of_weights(&ops, &info, given->folder));
        V2V_TRY(v2v_step_adopt(session, &info, ops, given->folder));
    }
done:
    return rc;
}

/* What is learnt from. */
struct material {
    struct v2v_psf_file psf; /* of a network without optics: the number of views alone */
    struct v2v_recording **recordings;
    struct v2v_volume **truths;
    int64_t count;
};

/* Does the command line give what the network takes? Local: the same on all ranks. */
static enum v2v_status check_network(const struct arguments *given,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    V2V_TRY(v2v_network_find(&ops, session->config.model.method));
    const int takes_truth = ops->examples != NULL && ops->examples->needs_truth;
    if (given->psf == NULL && !(ops->traits & V2V_TRAIT_VIEWS)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--psf FILE is missing"));
    }
    if (takes_truth && given->truths.count != given->inputs.count) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "the network '%s' learns from true volumes: --truth FILE, one for each of "
                         "%" PRId64 " recordings, not %" PRId64,
                         ops->name, given->inputs.count, given->truths.count));
    }
    if (!takes_truth && given->truths.count > 0) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--truth: the network '%s' learns from recordings alone",
                         ops->name));
    }
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_training(ops, session);
    }
done:
    return rc;
}

/* Recordings, and their volumes where there are some. Collective. */
static enum v2v_status open_material(struct material *material, const struct arguments *given,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_session of_truths = *session;
    of_truths.config.input.dataset[0] = '\0'; /* which is the recordings' */
    rc = V2V_ALLOC(material->recordings, "train.recordings", given->inputs.count);
    if (rc == V2V_OK && given->truths.count > 0) {
        rc = V2V_ALLOC(material->truths, "train.recordings", given->truths.count);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    material->count = given->inputs.count;
    for (int64_t i = 0; i < given->inputs.count; i++) {
        V2V_TRY(v2v_step_recording(session, &material->recordings[i], given->inputs.item[i],
                                   &material->psf));
        if (given->psf == NULL) {
            material->psf.views = v2v_recording_info(material->recordings[0])->views;
            material->psf.slices = 1;
        }
    }
    for (int64_t i = 0; i < given->truths.count; i++) {
        V2V_TRY(v2v_step_volume(&of_truths, &material->truths[i], given->truths.item[i],
                                &material->psf));
    }
done:
    return rc;
}

/* What the method that examples are made by leaves to a recording: to the first. Collective. */
static enum v2v_status settle(const struct material *material, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *first = material->recordings[0];
    const struct v2v_recording_info *info = v2v_recording_info(first);
    const struct v2v_problem problem = {.config = &session->config,
                                        .psf = &material->psf,
                                        .height = info->height,
                                        .width = info->width,
                                        .precision = V2V_PRECISION_F32};
    const struct v2v_network_ops *ops = NULL;
    struct v2v_scaling scaling;
    V2V_TRY(v2v_network_find(&ops, session->config.model.method));
    const struct v2v_estimator_ops *maker = ops->examples != NULL ? ops->examples->estimator : NULL;
    if (maker == NULL ||
        !v2v_estimator_is_open(maker, &session->config)) { /* no need of the scaling */
        goto done;
    }
    const struct v2v_input_settings input = v2v_estimator_input(maker, &session->config);
    V2V_TRY(v2v_scaling_decide(&scaling, first, &input, session->world));
    V2V_TRY(
        v2v_settle_by_frame(&session->config, maker, &problem, first, &scaling, session->world));
done:
    return rc;
}

/* Starting anew forgets the run that was there, which these weights may be of. Collective. */
static enum v2v_status keep_weights(const struct arguments *given,
                                    const struct v2v_session *session)
{
    static const char *const forgotten[] = {V2V_RUN_WEIGHTS, V2V_RUN_WEIGHTS_BEFORE};
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    const int is_forgotten = session->force && !given->resume && v2v_step_on_root(session);
    for (int i = 0; i < 2 && is_forgotten && rc == V2V_OK; i++) {
        rc = v2v_text_format(path, sizeof path, "%s/%s", given->folder, forgotten[i]);
        if (rc == V2V_OK && v2v_file_exists(path)) {
            rc = v2v_file_check_output(path, 1, &given->weights, 1);
        }
    }
    return v2v_par_agree(session->world, rc);
}

static void close_material(struct material *material)
{
    for (int64_t i = 0; i < material->count; i++) {
        v2v_recording_close(&material->recordings[i]);
        if (material->truths != NULL) {
            v2v_volume_close(&material->truths[i]);
        }
    }
    v2v_mem_free(material->recordings);
    v2v_mem_free(material->truths);
    v2v_psf_file_fini(&material->psf);
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct material material = {0};
    struct v2v_train_report report = {0};
    struct v2v_weights_info info;
    int is_there = 0; /* a checkpoint to go on from */
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    if (given->psf != NULL) {
        V2V_TRY(v2v_step_psf(session, &material.psf, given->psf));
    }
    if (given->resume) {
        V2V_TRY(adopt_checkpoint(&is_there, given, session));
    }
    if (given->weights != NULL && !is_there) {
        V2V_TRY(keep_weights(given, session));
        V2V_TRY(v2v_step_weights_info(session, &info, given->weights, &material.psf));
    }
    V2V_TRY(check_network(given, session));
    V2V_TRY(open_material(&material, given, session));
    V2V_TRY(settle(&material, session));
    struct v2v_train_job job = {.config = &session->config,
                                .psf = &material.psf,
                                .recordings = material.recordings,
                                .truths = material.truths,
                                .recording_count = given->inputs.count,
                                .folder = given->folder,
                                .weights = given->weights,
                                .resume = given->resume,
                                .force = session->force,
                                .max_time_s = given->max_time_s};
    v2v_step_announce(session);
    V2V_TRY(v2v_train_run(&job, &report, session->world));
    if (report.now > 0) {
        v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " steps, total loss %g, %.1f s", given->folder,
                report.steps, report.last_total, report.seconds);
    } else {
        v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " steps are done, %" PRId64 " were asked for",
                given->folder, report.steps, session->config.train.steps);
    }
done:
    close_material(&material);
    return rc;
}

/* A run goes on as it began. */
static int usual_config(char *path, size_t bytes, const void *arguments)
{
    const struct arguments *given = arguments;
    return given->resume &&
           v2v_text_format(path, bytes, "%s/%s", given->folder, V2V_RUN_CONFIG) == V2V_OK &&
           v2v_file_exists(path);
}

const struct v2v_command v2v_command_train = {
    .name = "train",
    .summary = "fit a network to recordings: view to view, or as the method says",
    .options = options,
    .bytes = sizeof(struct arguments),
    .usual_config = usual_config,
    .run = run};
