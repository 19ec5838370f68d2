#include "cli/steps.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/train/train.h"
#include <inttypes.h>
#include <sys/stat.h>
#include <unistd.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *weights, *folder;
    struct v2v_words inputs;
    int resume;
    double max_time_s;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 1),
    {.name = "input",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, inputs),
     .value = "FILE...",
     .help = "recordings to learn from",
     .required = 1},
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
    V2V_OPTION_SWITCH(struct arguments, resume, "resume", "go on where the run in FOLDER stopped"),
    {.name = "max-time",
     .kind = V2V_OPTION_DURATION,
     .at = offsetof(struct arguments, max_time_s),
     .value = "TIME",
     .help = "checkpoint and stop (exit code 85) after 90s, 20m, 3h"},
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
static enum v2v_status adopt_checkpoint(const struct arguments *given, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info = {0};
    if (v2v_step_on_root(session)) {
        static const char *const generations[] = {"weights.h5", "weights.prev.h5"};
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
    if (info.views > 0) {
        V2V_TRY(v2v_network_adopt(&session->config, &info, given->folder));
    }
done:
    return rc;
}

/* Rank 0: a run that failed before its first step leaves no folder behind that was not there. */
static void discard_empty_run(const char *folder)
{
    static const char *const names[] = {"config.yaml", "metrics.jsonl", "lock"};
    char path[V2V_PATH_BYTES];
    struct stat state;
    if (v2v_text_format(path, sizeof path, "%s/metrics.jsonl", folder) != V2V_OK ||
        (stat(path, &state) == 0 && state.st_size > 0)) {
        return;
    }
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (v2v_text_format(path, sizeof path, "%s/%s", folder, names[i]) == V2V_OK) {
            unlink(path);
        }
    }
    rmdir(folder); /* fails, and should, when there is more in it */
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_recording **recordings = NULL;
    struct v2v_train_report report = {0};
    struct v2v_weights_info info;
    int is_new_folder = v2v_step_on_root(session) && !v2v_file_exists(given->folder);
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    if (given->weights != NULL) {
        V2V_TRY(v2v_step_weights_info(session, &info, given->weights, &psf));
    }
    if (given->resume) {
        V2V_TRY(adopt_checkpoint(given, session));
    }
    rc = V2V_ALLOC(recordings, "train.recordings", given->inputs.count);
    V2V_TRY(v2v_par_agree(session->world, rc));
    for (int64_t i = 0; i < given->inputs.count; i++) {
        V2V_TRY(v2v_step_recording(session, &recordings[i], given->inputs.item[i], &psf));
    }
    struct v2v_train_job job = {.config = &session->config,
                                .psf = &psf,
                                .recordings = recordings,
                                .recording_count = given->inputs.count,
                                .folder = given->folder,
                                .weights = given->weights,
                                .resume = given->resume,
                                .force = session->force,
                                .max_time_s = given->max_time_s};
    v2v_step_announce(session);
    rc = v2v_train_run(&job, &report, session->world);
    v2v_watchdog_beat("the end of training");
    if (rc != V2V_OK && is_new_folder) {
        discard_empty_run(given->folder);
    }
    V2V_TRY(rc);
    v2v_log(V2V_LOG_INFO, "%s: %" PRId64 " steps, total loss %g, %.1f s", given->folder,
            report.steps, report.last_total, report.seconds);
done:
    for (int64_t i = 0; recordings != NULL && i < given->inputs.count; i++) {
        v2v_recording_close(&recordings[i]);
    }
    v2v_mem_free(recordings);
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_train = {
    .name = "train",
    .summary = "fit the network to noisy recordings, view to view",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
