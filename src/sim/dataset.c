#include "v2v3d/sim/dataset.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/json.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char *const parts[] = {"train", "validation", "test"};
enum { PARTS = sizeof parts / sizeof parts[0] };

/* The folder while it is worked in; rank 0 alone fills it. */
struct workplace {
    char settings_path[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    char *settings; /* one line; free() */
    int lock;
    int is_new;    /* the folder is this run's */
    int has_begun; /* so is what lies in it */
};

static const char *part_of(int64_t n)
{
    const int64_t digit = n % 10;
    return parts[digit == 9 ? 2 : digit == 8 ? 1 : 0];
}

static enum v2v_status path_of(char path[V2V_PATH_BYTES], const struct v2v_dataset *dataset,
                               int64_t n, const char *what)
{
    return v2v_text_format(path, V2V_PATH_BYTES, "%s/%s/%06lld_%s.h5", dataset->folder, part_of(n),
                           (long long)n, what);
}

/* What the data depend on but for their number, as a line of JSON. */
static enum v2v_status print_settings(char **line, const struct v2v_dataset *dataset,
                                      const struct v2v_psf_file *psf)
{
    static const char what[] = "the data set's settings";
    enum v2v_status rc = V2V_OK;
    FILE *stream = NULL;
    size_t bytes = 0, length = 0;
    char scenes[512] = "";
    const struct v2v_scene *scene = &dataset->scene;
    for (int64_t i = 0; i < dataset->kind_count && length < sizeof scenes; i++) {
        length += (size_t)snprintf(scenes + length, sizeof scenes - length, "%s%s",
                                   i > 0 ? " " : "", v2v_scene_name(dataset->kinds[i]));
    }
    const struct v2v_json_item items[] = {
        {.name = "scenes", .text = scenes},
        {.name = "noise", .text = dataset->noise},
        {.name = "seed", .number = (double)dataset->seed},
        {.name = "views", .number = (double)psf->views},
        {.name = "slices", .number = (double)scene->slices},
        {.name = "height", .number = (double)scene->height},
        {.name = "width", .number = (double)scene->width},
        {.name = "pixel_size_um", .number = scene->pixel_um},
        {.name = "slice_spacing_um", .number = scene->slice_um},
        {.name = "psf_crc32c", .number = v2v_psf_file_sum(psf)},
    };
    V2V_TRY(v2v_text_open(&stream, line, &bytes, what));
    rc = v2v_json_print(stream, items, (int64_t)(sizeof items / sizeof items[0]));
    rc = v2v_text_close(rc, stream, line, what);
done:
    return rc;
}

/* May the run go on in a folder with these settings? */
static enum v2v_status compare_settings(const struct workplace *workplace,
                                        const struct v2v_dataset *dataset)
{
    char line[2048] = "";
    FILE *stream = fopen(workplace->settings_path, "re");
    const int is_read = stream != NULL && fgets(line, sizeof line, stream) != NULL;
    if (stream != NULL) {
        (void)fclose(stream);
    }
    if (!is_read || strcmp(line, workplace->settings) != 0) {
        return V2V_FAIL(V2V_E_USAGE, "%s: holds a data set of other settings: %.*s",
                        dataset->folder, is_read ? (int)strcspn(line, "\n") : 0, line);
    }
    return V2V_OK;
}

/* A scene's files are NNNNNN_truth.h5 and so on. */
static const char *const whats[] = {"truth", "clean", "noisy"};
enum { WHATS = sizeof whats / sizeof whats[0] };

static int is_scene_file(const char *name)
{
    const size_t digits = strspn(name, "0123456789");
    int is_one = 0;
    for (size_t i = 0; i < WHATS; i++) {
        const size_t length = strlen(whats[i]);
        is_one |= digits >= 6 && name[digits] == '_' &&
                  strncmp(name + digits + 1, whats[i], length) == 0 &&
                  strcmp(name + digits + 1 + length, ".h5") == 0;
    }
    return is_one;
}

/* Rank-0: scene files of a part of the data set: counted, and removed if asked. */
static enum v2v_status go_through(int64_t *count, const struct v2v_dataset *dataset,
                                  const char *part, int remove_them)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    DIR *folder = NULL;
    V2V_TRY(v2v_text_format(path, sizeof path, "%s/%s", dataset->folder, part));
    folder = opendir(path);
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;) {
        if (!is_scene_file(entry->d_name)) {
            continue;
        }
        *count += 1;
        V2V_TRY(
            v2v_text_format(path, sizeof path, "%s/%s/%s", dataset->folder, part, entry->d_name));
        if (remove_them && unlink(path) != 0) {
            V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: can't be removed: %s", path, strerror(errno)));
        }
    }
done:
    if (folder != NULL) {
        (void)closedir(folder);
    }
    return rc;
}

static enum v2v_status go_through_all(int64_t *count, const struct v2v_dataset *dataset,
                                      int remove_them)
{
    enum v2v_status rc = V2V_OK;
    *count = 0;
    for (size_t i = 0; i < PARTS && rc == V2V_OK; i++) {
        rc = go_through(count, dataset, parts[i], remove_them);
    }
    return rc;
}

/* Rank-0: may this run work on what the folder holds? */
static enum v2v_status check_content(const struct workplace *workplace,
                                     const struct v2v_dataset *dataset)
{
    enum v2v_status rc = V2V_OK;
    int64_t scenes = 0;
    if (dataset->force) {
        return V2V_OK;
    }
    if (v2v_file_exists(workplace->settings_path)) {
        if (!dataset->resume) {
            V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                             "%s: holds a data set already; --resume goes on with it, --force "
                             "makes it anew",
                             dataset->folder));
        }
        V2V_TRY(compare_settings(workplace, dataset));
        return V2V_OK;
    }
    V2V_TRY(go_through_all(&scenes, dataset, 0));
    if (scenes > 0) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "%s: holds scenes of unknown settings: there is no dataset.json; --force "
                         "removes them",
                         dataset->folder));
    }
done:
    return rc;
}

/* Is the scene to be made? What a data set with these settings has of it is complete. */
static enum v2v_status check_missing(int *is_missing, const struct v2v_dataset *dataset, int64_t n)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    *is_missing = 0;
    for (size_t i = 0; i < WHATS; i++) {
        V2V_TRY(path_of(path, dataset, n, whats[i]));
        *is_missing |= !v2v_file_exists(path);
    }
done:
    return rc;
}

/* Rank-0: has the disk room for the scenes that are missing? */
static enum v2v_status check_room(const struct workplace *workplace,
                                  const struct v2v_dataset *dataset, int64_t views)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_scene *scene = &dataset->scene;
    const int64_t images = scene->slices + 2 * views;
    const int64_t each =
        v2v_mem_product(images, scene->height, scene->width * (int64_t)sizeof(float));
    int64_t count = 0;
    for (int64_t n = 0; n < dataset->count; n++) {
        int is_missing = 0;
        V2V_TRY(check_missing(&is_missing, dataset, n));
        count += is_missing || dataset->force;
    }
    V2V_TRY(v2v_file_check_room(workplace->settings_path, v2v_mem_product(each, count, 1)));
done:
    return rc;
}

/* Rank-0: lock the folder, and see what it holds. */
static enum v2v_status enter(struct workplace *workplace, const struct v2v_dataset *dataset,
                             const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    if (v2v_file_exists(dataset->folder) && !v2v_file_is_folder(dataset->folder)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "%s: is a file, not a folder", dataset->folder));
    }
    V2V_TRY(v2v_text_format(workplace->settings_path, sizeof workplace->settings_path,
                            "%s/dataset.json", dataset->folder));
    V2V_TRY(print_settings(&workplace->settings, dataset, psf));
    workplace->is_new = !v2v_file_exists(dataset->folder);
    V2V_TRY(v2v_file_make_folder(dataset->folder));
    rc = v2v_file_lock_output(&workplace->lock, workplace->lock_name, workplace->settings_path);
    if (rc == V2V_E_BUSY) {
        rc = V2V_FAIL(rc, "%s: another run works in this folder", dataset->folder);
    }
    V2V_TRY(rc);
    V2V_TRY(check_content(workplace, dataset));
    V2V_TRY(check_room(workplace, dataset, psf->views));
done:
    return rc;
}

/* Rank-0: from here on the folder is this data set's. Scenes of another one go before its settings
 * do: at no time are there scenes under settings that are not theirs. */
static enum v2v_status begin(const struct workplace *workplace, const struct v2v_dataset *dataset)
{
    enum v2v_status rc = V2V_OK;
    char path[V2V_PATH_BYTES];
    int64_t removed = 0;
    if (dataset->force) {
        V2V_TRY(go_through_all(&removed, dataset, 1));
    }
    for (size_t i = 0; i < PARTS; i++) {
        V2V_TRY(v2v_text_format(path, sizeof path, "%s/%s", dataset->folder, parts[i]));
        V2V_TRY(v2v_file_make_folder(path));
    }
    V2V_TRY(v2v_file_write_text(workplace->settings_path, workplace->settings));
done:
    return rc;
}

/* Rank-0, which holds the lock: after a failure, what holds no scene goes. Folders that are not
 * empty stay. */
static void leave(struct workplace *workplace, const struct v2v_dataset *dataset, int has_failed)
{
    char path[V2V_PATH_BYTES];
    int64_t scenes = 0;
    const int is_empty = has_failed && workplace->lock >= 0 &&
                         go_through_all(&scenes, dataset, 0) == V2V_OK && scenes == 0;
    if (is_empty && workplace->has_begun) {
        unlink(workplace->settings_path);
        for (size_t i = 0; i < PARTS; i++) {
            if (v2v_text_format(path, sizeof path, "%s/%s", dataset->folder, parts[i]) == V2V_OK) {
                rmdir(path);
            }
        }
    }
    v2v_file_unlock_output(&workplace->lock, workplace->lock_name);
    if (is_empty && workplace->is_new) {
        rmdir(dataset->folder);
    }
}

static const char go_on[] = "stopped on request; go on with --resume";

/* Local. */
static enum v2v_status make_scene(struct v2v_simulator *simulator,
                                  const struct v2v_dataset *dataset, int64_t n)
{
    enum v2v_status rc = V2V_OK;
    char noisy[V2V_PATH_BYTES], clean[V2V_PATH_BYTES], truth[V2V_PATH_BYTES];
    struct v2v_scene scene = dataset->scene;
    struct v2v_simulation simulation = dataset->simulation;
    scene.kind = dataset->kinds[(n + n / 10) % dataset->kind_count];
    scene.seed = (uint64_t)(dataset->seed * 1000000 + n);
    simulation.scene = &scene;
    simulation.seed = scene.seed;
    simulation.frames = 1;
    simulation.output = noisy;
    simulation.clean = clean;
    simulation.truth = truth;
    V2V_TRY(path_of(noisy, dataset, n, "noisy"));
    V2V_TRY(path_of(clean, dataset, n, "clean"));
    V2V_TRY(path_of(truth, dataset, n, "truth"));
    rc = v2v_simulator_record(simulator, &simulation);
    if (rc == V2V_E_INPUT) {
        rc = V2V_FAIL(rc, "scene %lld, %s: %s; another --seed, --size or choice of --scenes helps",
                      (long long)n, v2v_scene_name(scene.kind), v2v_status_message());
    }
    if (rc == V2V_STOPPED) { /* in the midst of it */
        rc = V2V_FAIL(rc, "%s", go_on);
    }
done:
    return rc;
}

/* This rank's scene of a round. */
static enum v2v_status make_one(struct v2v_simulator *simulator, const struct v2v_dataset *dataset,
                                int64_t n, int is_last, struct v2v_dataset_report *mine)
{
    enum v2v_status rc = V2V_OK;
    int is_missing = 0;
    if (n >= dataset->count) {
        return V2V_OK;
    }
    V2V_TRY(check_missing(&is_missing, dataset, n));
    if (is_missing) {
        V2V_TRY(make_scene(simulator, dataset, n));
    }
    mine->made += is_missing;
    mine->kept += !is_missing;
    if (v2v_stop_requested() && !is_last) {
        V2V_TRY(V2V_FAIL(V2V_STOPPED, "%s", go_on));
    }
done:
    return rc;
}

static enum v2v_status make_all(struct v2v_dataset_report *mine, const struct v2v_dataset *dataset,
                                struct v2v_simulator *simulator, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_progress progress = {0};
    const int64_t ranks = v2v_comm_size(comm);
    v2v_progress_begin(&progress, "scenes", 0, dataset->count);
    for (int64_t i = 0; i < dataset->count; i += ranks) {
        const int64_t n = i + v2v_comm_rank(comm);
        const int64_t done_then = v2v_smaller(i + ranks, dataset->count);
        const int is_last = done_then == dataset->count;
        V2V_TRY(v2v_par_agree(comm, make_one(simulator, dataset, n, is_last, mine)));
        v2v_progress_step(&progress, done_then, NULL);
    }
done:
    v2v_progress_end(&progress);
    return rc;
}

enum v2v_status v2v_dataset_make(struct v2v_dataset_report *report,
                                 const struct v2v_dataset *dataset, const struct v2v_psf_file *psf,
                                 const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_simulator *simulator = NULL;
    struct workplace workplace = {.lock = -1};
    const double began = v2v_clock_now();
    *report = (struct v2v_dataset_report){0};
    V2V_ASSERT(dataset->kind_count > 0 && dataset->count > 0);
    v2v_stop_heed_ending();
    if (v2v_comm_rank(comm) == 0) {
        rc = enter(&workplace, dataset, psf);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    rc = v2v_simulator_create(&simulator, psf, dataset->scene.height, dataset->scene.width, NULL,
                              NULL);
    V2V_TRY(v2v_par_agree(comm, rc));
    if (v2v_comm_rank(comm) == 0) {
        workplace.has_begun = 1;
        rc = begin(&workplace, dataset);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(make_all(report, dataset, simulator, comm));
    v2v_par_sum_i64(comm, &report->made, 1);
    v2v_par_sum_i64(comm, &report->kept, 1);
    report->seconds = v2v_clock_now() - began;
done:
    v2v_simulator_destroy(&simulator);
    if (v2v_comm_rank(comm) == 0) {
        leave(&workplace, dataset, rc != V2V_OK);
    }
    free(workplace.settings);
    return rc;
}
