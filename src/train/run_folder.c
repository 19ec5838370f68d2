#include "train/run_folder.h"

#include "train/checkpoint.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/json.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LOCK "lock"

static enum v2v_status path_in(char *path, const struct v2v_run_folder *folder, const char *name)
{
    return v2v_text_format(path, V2V_PATH_BYTES, "%s/%s", folder->path, name);
}

/* The kernel drops the lock with the process, however it ends. */
static enum v2v_status lock(struct v2v_run_folder *folder)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    V2V_TRY(path_in(path, folder, LOCK));
    rc = v2v_file_lock(&folder->lock, path);
    if (rc == V2V_E_BUSY) {
        rc = V2V_FAIL(rc, "%s: another run works in this folder", folder->path);
    }
done:
    return rc;
}

static enum v2v_status enter_on_main_rank(struct v2v_run_folder *folder,
                                          const struct v2v_train_job *job)
{
    enum v2v_status rc = V2V_OK;
    if (v2v_file_exists(job->folder) && !v2v_file_is_folder(job->folder)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: is a file, not a folder", job->folder));
    }
    folder->is_new = !v2v_file_exists(job->folder);
    V2V_TRY(v2v_file_make_folder(job->folder));
    V2V_TRY(lock(folder));
    if (v2v_checkpoint_exists(job->folder) && !job->resume && !job->force) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "%s: holds a run already; --resume goes on with it, --force starts anew",
                         job->folder));
    }
    V2V_TRY(v2v_config_text(&folder->config_text, job->config, NULL, 0));
done:
    return rc;
}

enum v2v_status v2v_run_folder_enter(struct v2v_run_folder *folder, const struct v2v_train_job *job,
                                     const struct v2v_comm *comm)
{
    enum v2v_status mine = V2V_OK;
    *folder = (struct v2v_run_folder){
        .path = job->folder, .resumes = job->resume, .config = job->config, .lock = -1};
    if (v2v_comm_rank(comm) == 0) {
        mine = enter_on_main_rank(folder, job);
    }
    return v2v_par_agree(comm, mine);
}

/* Of steps. */
static int has_log(const struct v2v_run_folder *folder)
{
    char path[V2V_PATH_BYTES];
    struct stat state;
    return path_in(path, folder, V2V_RUN_METRICS) == V2V_OK && stat(path, &state) == 0 &&
           state.st_size > 0;
}

/* Lines of two texts of one form, whose sections begin without indentation. */
static void tell_lines(const char *path, const char *before, const char *now)
{
    char section[64] = "";
    while (*before != '\0' && *now != '\0') {
        const int was = (int)strcspn(before, "\n"), is = (int)strcspn(now, "\n");
        if (*now != ' ') {
            snprintf(section, sizeof section, "%.*s", (int)strcspn(now, ":\n"), now);
        } else if (was != is || memcmp(before, now, (size_t)is) != 0) {
            v2v_log(V2V_LOG_WARNING, "%s: goes on with %s.%.*s, which was %.*s until here", path,
                    section, is - 2, now + 2, was - 2, before + 2);
        }
        before += was + (before[was] != '\0');
        now += is + (now[is] != '\0');
    }
}

/* What is set otherwise than until here, but for how many steps there are and what ranks do. */
static enum v2v_status tell_changes(const struct v2v_run_folder *folder, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config before;
    char *text = NULL;
    v2v_config_defaults(&before);
    if (!v2v_file_exists(path) || v2v_config_load(&before, path) != V2V_OK) {
        return V2V_OK; /* lost, or of another version */
    }
    before.parallel = folder->config->parallel;
    before.train.steps = folder->config->train.steps;
    V2V_TRY(v2v_config_text(&text, &before, NULL, 0));
    tell_lines(folder->path, text, folder->config_text);
done:
    free(text);
    return rc;
}

/* A run that was to go on and has nothing to go on from: job scripts begin so, and so does a run
 * that lost its checkpoints. */
static void tell_of_nothing(const struct v2v_run_folder *folder)
{
    const int is_lost = has_log(folder);
    v2v_log(is_lost ? V2V_LOG_WARNING : V2V_LOG_INFO, "%s: %sno checkpoint: begins anew",
            folder->path, is_lost ? "has a log of steps and " : "");
}

enum v2v_status v2v_run_folder_start(struct v2v_run_folder *folder, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    if (folder->lock < 0 || step >= folder->config->train.steps) {
        goto done; /* not rank 0, or no step is left that could be of these settings */
    }
    if (step == 0 && folder->resumes) {
        tell_of_nothing(folder);
    }
    if (step == 0) {
        V2V_TRY(v2v_checkpoint_forget(folder->path));
    }
    V2V_TRY(path_in(path, folder, V2V_RUN_CONFIG));
    if (step > 0) {
        V2V_TRY(tell_changes(folder, path));
    }
    V2V_TRY(v2v_file_write_text(path, folder->config_text));
    V2V_TRY(path_in(path, folder, V2V_RUN_METRICS));
    V2V_TRY(v2v_json_lines_cut(path, step));
    folder->log = fopen(path, "ae");
    if (folder->log == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno)));
    }
done:
    return rc;
}

enum v2v_status v2v_run_folder_log(struct v2v_run_folder *folder, int64_t step,
                                   const struct v2v_step_result *result,
                                   const struct v2v_par_time *began)
{
    struct v2v_par_time now = v2v_par_time_now();
    struct v2v_json_item items[V2V_LOSS_TERMS + 4];
    int64_t count = 0;
    if (folder->log == NULL) {
        return V2V_OK;
    }
    items[count++] = v2v_json_number("step", (double)step);
    for (int t = 0; t < V2V_LOSS_TERMS; t++) {
        items[count++] = v2v_json_number(v2v_loss_name(t), result->terms[t]);
    }
    items[count++] = v2v_json_number("grad_norm", result->grad_norm);
    items[count++] = v2v_json_number("seconds", now.clock - began->clock);
    items[count++] = v2v_json_number("communication", v2v_par_spent_between(began, &now));
    return v2v_json_print(folder->log, items, count);
}

static int is_empty(const struct v2v_run_folder *folder)
{
    return !has_log(folder) && !v2v_checkpoint_exists(folder->path);
}

static void discard(const struct v2v_run_folder *folder)
{
    static const char *const names[] = {V2V_RUN_CONFIG, V2V_RUN_METRICS, LOCK};
    char path[V2V_PATH_BYTES];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        if (path_in(path, folder, names[i]) == V2V_OK) {
            unlink(path);
        }
    }
    rmdir(folder->path); /* fails, and should, when there is more in it */
}

void v2v_run_folder_leave(struct v2v_run_folder *folder, int has_failed)
{
    if (folder->log != NULL) {
        (void)fclose(folder->log);
    }
    if (has_failed && folder->is_new && folder->lock >= 0 && is_empty(folder)) {
        discard(folder);
    }
    if (folder->lock >= 0) {
        (void)close(folder->lock);
    }
    free(folder->config_text); /* of v2v_config_text */
    *folder = (struct v2v_run_folder){.lock = -1};
}
