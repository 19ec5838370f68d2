#include "io/h5_resume.h"

#include "io/h5_checksum.h"
#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "io/rounding.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/par/watchdog.h"
#include <errno.h>
#include <string.h>
#include <unistd.h>

/* Is a dataset stored as a complete file's shall be? */
static enum v2v_status check_storage(hid_t set, const char *path, const char *name,
                                     const struct v2v_volume_storage *storage)
{
    enum v2v_status rc = V2V_OK;
    const int is_integer = storage->sample == V2V_SAMPLE_UINT16;
    hid_t creation = H5Dget_create_plist(set), type = H5Dget_type(set);
    double step = 0.0;
    V2V_TRY(v2v_h5_get_length(&step, set, path, V2V_VOLUME_STEP));
    if ((H5Tget_class(type) == H5T_INTEGER) != is_integer ||
        H5Tget_size(type) != (is_integer ? 2 : 4) ||
        (H5Pget_nfilters(creation) > 0) != (storage->deflate > 0) ||
        (is_integer && storage->peak > 0.0 && step != v2v_rounding_step(storage->peak))) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %s: is stored with another type, peak or compression than asked for",
                         path, name));
    }
done:
    v2v_h5_close(&type);
    v2v_h5_close(&creation);
    return rc;
}

/* A dataset of this very shape: with all its space where it was taken at once, so that its index
 * can be walked through; or stored as a complete file's. */
static enum v2v_status check_dataset(hid_t file, const char *path, const char *name, int rank,
                                     const int64_t *shape, size_t bytes,
                                     const struct v2v_volume_storage *storage)
{
    enum v2v_status rc = V2V_OK;
    hid_t set = H5I_INVALID_HID, space = H5I_INVALID_HID, type = H5I_INVALID_HID;
    hsize_t extent[4] = {0}, elements = 1;
    V2V_TRY(v2v_h5_open_dataset(&set, file, path, name));
    space = H5Dget_space(set);
    type = H5Dget_type(set);
    int same = H5Sget_simple_extent_ndims(space) == rank &&
               H5Sget_simple_extent_dims(space, extent, NULL) == rank;
    for (int i = 0; i < rank; i++) {
        same = same && extent[i] == (hsize_t)shape[i];
        elements *= (hsize_t)shape[i];
    }
    if (storage == NULL) {
        same = same && H5Tget_size(type) == bytes && H5Dget_storage_size(set) == elements * bytes;
    }
    if (!same) {
        V2V_TRY(
            V2V_FAIL(V2V_E_INPUT, "%s: %s: has not the shape, type or space expected", path, name));
    }
    if (storage != NULL) {
        V2V_TRY(check_storage(set, path, name, storage));
    }
done:
    v2v_h5_close(&type);
    v2v_h5_close(&space);
    v2v_h5_close(&set);
    return rc;
}

/* Is it what the plan says? */
static enum v2v_status check_file(const char *path, const struct v2v_h5_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    hid_t file = H5I_INVALID_HID;
    char task[64];
    int there = 0;
    V2V_TRY(v2v_h5_guard(path));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(v2v_h5_get_text(task, sizeof task, &there, file, path, V2V_VOLUME_TASK));
    if (!there || strcmp(task, plan->task) != 0) {
        V2V_TRY(V2V_FAIL(
            V2V_E_INPUT,
            "%s: is of another task: inputs, frames, settings, datasets or program differ", path));
    }
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        if (plan->dataset[i] != NULL) {
            V2V_TRY(check_dataset(file, path, plan->dataset[i], 4, plan->shape, sizeof(float),
                                  plan->storage));
        }
    }
    V2V_TRY(check_dataset(file, path, "/done", 1, plan->shape, sizeof(uint8_t), NULL));
    V2V_TRY(check_dataset(file, path, V2V_H5_CHECKSUM, 1, plan->shape, sizeof(uint64_t), NULL));
done:
    v2v_h5_close(&file);
    return rc;
}

/* What this rank finds in its share of the frames. */
struct verdict {
    uint8_t *marked;    /* [t] as the file says */
    uint64_t *checksum; /* [t] */
    int64_t *good;      /* [t] 1: verified by this rank */
};

/* Can all of a file be read? Where not it is the disk's failure, and no damage. Collective(comm),
 * agreed. */
static enum v2v_status check_disk(const char *path, const struct v2v_comm *comm)
{
    uint64_t sum = 0;
    const enum v2v_status rc = v2v_file_sum(&sum, path, comm);
    return rc == V2V_E_INPUT ? V2V_FAIL(V2V_E_IO, "%s: cannot be read now", path) : rc;
}

static void forget(struct verdict *verdict)
{
    v2v_mem_free(verdict->good);
    v2v_mem_free(verdict->checksum);
    v2v_mem_free(verdict->marked);
}

/* A frame that can't be read is none: only a lack of memory is a failure. */
static enum v2v_status verify(struct verdict *verdict, const char *path, const char *const *dataset,
                              int64_t frames, struct v2v_part mine)
{
    enum v2v_status rc = V2V_OK;
    hid_t file = H5I_INVALID_HID;
    struct v2v_h5_summed summed = {0};
    V2V_TRY(V2V_ALLOC(verdict->marked, "io.resume", frames));
    V2V_TRY(V2V_ALLOC(verdict->checksum, "io.resume", frames));
    V2V_TRY(V2V_ALLOC(verdict->good, "io.resume", frames));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(v2v_h5_read_of_frames(verdict->marked, file, path, "/done", H5T_NATIVE_UINT8, frames));
    V2V_TRY(v2v_h5_read_of_frames(verdict->checksum, file, path, V2V_H5_CHECKSUM, H5T_NATIVE_UINT64,
                                  frames));
    V2V_TRY(v2v_h5_summed_open(&summed, path, dataset));
    for (int64_t t = mine.first; t < mine.first + mine.count; t++) {
        uint64_t sum = 0;
        if (verdict->marked[t] != 1) {
            continue;
        }
        v2v_watchdog_beat("checking frames that are done");
        const enum v2v_status read = v2v_h5_summed_frame(&summed, &sum, t);
        if (read != V2V_OK) { /* is it the disk, which may be read another time? */
            V2V_TRY(check_disk(path, NULL));
        }
        verdict->good[t] = read == V2V_OK && sum == verdict->checksum[t];
    }
done:
    v2v_h5_summed_close(&summed);
    v2v_h5_close(&file);
    return rc == V2V_E_INPUT ? V2V_OK : rc;
}

enum v2v_status v2v_h5_good_frames(uint8_t *done, const char *path, const struct v2v_h5_plan *plan,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct verdict verdict = {0};
    const int64_t frames = plan->shape[0];
    if (v2v_comm_rank(comm) == 0) {
        rc = check_file(path, plan);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    rc = verify(&verdict, path, plan->dataset, frames,
                v2v_par_part(frames, v2v_comm_size(comm), v2v_comm_rank(comm)));
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_sum_i64(comm, verdict.good, frames);
    for (int64_t t = 0; t < frames; t++) {
        done[t] = verdict.good[t] != 0;
        if (plan->resume && !done[t] && verdict.marked[t] == 1 && v2v_comm_rank(comm) == 0) {
            v2v_log(V2V_LOG_WARNING, "%s: frame %lld is damaged and computed anew", path,
                    (long long)t);
        }
    }
done:
    forget(&verdict);
    return rc;
}

enum v2v_status v2v_h5_check_written(const char *path, const char *const *dataset, int64_t frames,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct verdict verdict = {0};
    int64_t bad = 0;
    rc = verify(&verdict, path, dataset, frames,
                v2v_par_part(frames, v2v_comm_size(comm), v2v_comm_rank(comm)));
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_par_sum_i64(comm, verdict.good, frames);
    while (bad < frames && verdict.good[bad] != 0) {
        bad++;
    }
    if (bad < frames) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: frame %lld is not what was written to it: the file that was gone on "
                         "with is damaged; --force makes it anew",
                         path, (long long)bad));
    }
done:
    forget(&verdict);
    return rc;
}

/* What is refused may be read well another time: a disk that fails is no damage. Collective(comm),
 * agreed. */
static enum v2v_status good_frames_for_sure(uint8_t *done, const char *path,
                                            const struct v2v_h5_plan *plan,
                                            const struct v2v_comm *comm)
{
    enum v2v_status rc = v2v_h5_good_frames(done, path, plan, comm);
    if (rc == V2V_E_INPUT) {
        V2V_TRY(check_disk(path, comm));
        rc = v2v_h5_good_frames(done, path, plan, comm);
    }
done:
    return rc;
}

enum v2v_status v2v_h5_resume(int *found, uint8_t *done, const char *temporary,
                              const struct v2v_h5_plan *plan, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    int64_t count = 0;
    *found = v2v_comm_rank(comm) == 0 && v2v_file_exists(temporary);
    v2v_par_broadcast(comm, found, sizeof *found, 0);
    if (!*found) {
        return V2V_OK;
    }
    rc = good_frames_for_sure(done, temporary, plan, comm);
    if (rc == V2V_E_INPUT) {
        if (v2v_comm_rank(comm) == 0) {
            v2v_log(V2V_LOG_WARNING, "%s; all frames are computed anew", v2v_status_message());
        }
        *found = 0;
        return V2V_OK;
    }
    V2V_TRY(rc);
    for (int64_t t = 0; t < plan->shape[0]; t++) {
        count += done[t];
    }
    v2v_log(V2V_LOG_INFO, "resuming: %lld of %lld frames are done", (long long)count,
            (long long)plan->shape[0]);
done:
    return rc;
}

/* Its frames, if the file is one that can be gone on with. */
static enum v2v_status count_left(struct v2v_volume_left *left, const char *path, const char *task)
{
    enum v2v_status rc = V2V_OK;
    hid_t file = H5I_INVALID_HID, set = H5I_INVALID_HID, space = H5I_INVALID_HID;
    hsize_t frames = 0;
    char its_task[64];
    uint8_t *marked = NULL;
    int there = 0;
    V2V_TRY(v2v_h5_guard(path));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(v2v_h5_get_text(its_task, sizeof its_task, &there, file, path, V2V_VOLUME_TASK));
    V2V_TRY(v2v_h5_open_dataset(&set, file, path, "/done"));
    space = H5Dget_space(set);
    if (!there || H5Sget_simple_extent_ndims(space) != 1 ||
        H5Sget_simple_extent_dims(space, &frames, NULL) != 1) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: no volume that was begun", path));
    }
    V2V_TRY(V2V_ALLOC(marked, "io.resume", (int64_t)frames));
    V2V_TRY(v2v_h5_read_of_frames(marked, file, path, "/done", H5T_NATIVE_UINT8, (int64_t)frames));
    left->frames = (int64_t)frames;
    left->is_same = task != NULL && strcmp(task, its_task) == 0;
    for (int64_t t = 0; t < left->frames; t++) {
        left->done += marked[t] == 1;
    }
done:
    v2v_mem_free(marked);
    v2v_h5_close(&space);
    v2v_h5_close(&set);
    v2v_h5_close(&file);
    return rc;
}

enum v2v_status v2v_h5_left(struct v2v_volume_left *left, const char *temporary, const char *task)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_status_record earlier;
    v2v_status_keep(&earlier);
    *left = (struct v2v_volume_left){0};
    if (access(temporary, R_OK) != 0) {
        return errno == ENOENT || errno == ENOTDIR
                   ? V2V_OK
                   : V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno));
    }
    rc = v2v_file_is_hdf5(temporary) ? count_left(left, temporary, task) : V2V_OK;
    if (rc == V2V_E_INPUT) {
        const enum v2v_status disk = check_disk(temporary, NULL);
        rc = disk == V2V_OK ? count_left(left, temporary, task) : disk;
    }
    if (rc != V2V_OK) {
        *left = (struct v2v_volume_left){0};
    }
    if (rc == V2V_E_INPUT) { /* it holds no frames, or none that could be gone on with */
        v2v_status_restore(&earlier);
        rc = V2V_OK;
    }
    return rc;
}
