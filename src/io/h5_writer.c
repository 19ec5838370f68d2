#include "io/h5_writer.h"
#include "io/h5_common.h"
#include "io/h5_resume.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

/* One collective write moves at most this many bytes a rank: MPI counts are ints, and Open MPI
 * takes as much again for its buffers. */
#define MOST_ROUND_BYTES ((int64_t)256 << 20)

/* After a failed collective HDF5 can wait for ever in the next one (RELIABILITY.md 4). */
#define BROKEN_CLOSE_SECONDS 10.0

struct v2v_h5_writer {
    char path[V2V_PATH_BYTES], temporary[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    const struct v2v_comm *comm;
    hid_t file, transfer, done, checksum;
    hid_t set[V2V_H5_WRITER_SETS];
    int64_t shape[4];
    int64_t *sums, *totals; /* [t] checksums: of what this rank wrote, of all ranks; else NULL */
    uint8_t *was_done;      /* [t] by the run before; NULL likewise */
    int lock;               /* rank 0: holds lock_name while this is >= 0 */
    int resumed;            /* agreed: frames of the run before may be there */
    int created;            /* agreed: the temporary file may be there */
    int marked;             /* agreed: mark_done was called */
    int broken;             /* agreed: HDF5 itself failed in a collective call */
};

/* 0: shape and name are fine and the disk has room for the data. */
static enum v2v_status check_space(const struct v2v_h5_writer *writer,
                                   const struct v2v_h5_plan *plan)
{
    struct statvfs disk;
    char folder[V2V_PATH_BYTES];
    int64_t sets = 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        sets += plan->dataset[i] != NULL;
    }
    const int64_t *shape = plan->shape;
    const int64_t image = v2v_mem_product(shape[2], shape[3], (int64_t)sizeof(float) * sets);
    const int64_t bytes = v2v_mem_product(shape[0], shape[1], image);
    V2V_ASSERT(shape[0] > 0 && shape[1] > 0 && image > 0);
    if (bytes < 0) {
        return V2V_FAIL(V2V_E_IO, "%s: its size passes 2^63 bytes", writer->path);
    }
    memcpy(folder, writer->path, sizeof folder);
    char *slash = strrchr(folder, '/');
    if (slash != NULL) {
        slash[slash == folder] = '\0';
    }
    if (statvfs(slash != NULL ? folder : ".", &disk) == 0 &&
        (double)bytes > (double)disk.f_bavail * (double)disk.f_frsize) {
        return V2V_FAIL(V2V_E_IO, "%s: needs %.3g GB, the disk has %.3g GB left", writer->path,
                        (double)bytes * 1e-9, (double)disk.f_bavail * (double)disk.f_frsize * 1e-9);
    }
    return V2V_OK;
}

/* One image a chunk, all space taken at once, nothing filled in: parallel HDF5 would take it early
 * anyway, and every image is written by exactly one rank. */
static enum v2v_status create_images(hid_t file, const char *path, const char *name,
                                     const int64_t shape[4])
{
    enum v2v_status rc = V2V_OK;
    hsize_t extent[4], chunk[4];
    for (int i = 0; i < 4; i++) {
        extent[i] = (hsize_t)shape[i];
        chunk[i] = i < 2 ? 1 : extent[i];
    }
    hid_t space = H5Screate_simple(4, extent, NULL);
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t set = H5I_INVALID_HID;
    if (H5Pset_chunk(creation, 4, chunk) < 0 ||
        H5Pset_alloc_time(creation, H5D_ALLOC_TIME_EARLY) < 0 ||
        H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER) < 0 ||
        (set = H5Dcreate2(file, name, H5T_IEEE_F32LE, space, H5P_DEFAULT, creation, H5P_DEFAULT)) <
            0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, name, "can't be created");
    }
    rc = v2v_h5_close_written(rc, &set, path, name);
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    return rc;
}

/* One number for every frame, at first 0. */
static enum v2v_status create_marks(hid_t file, const char *path, const char *name, hid_t type,
                                    int64_t frames)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent = (hsize_t)frames;
    const uint8_t zero = 0;
    hid_t space = H5Screate_simple(1, &extent, NULL);
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t set = H5I_INVALID_HID;
    if (H5Pset_alloc_time(creation, H5D_ALLOC_TIME_EARLY) < 0 ||
        H5Pset_fill_value(creation, H5T_NATIVE_UINT8, &zero) < 0 ||
        (set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, creation, H5P_DEFAULT)) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, name, "can't be created");
    }
    rc = v2v_h5_close_written(rc, &set, path, name);
    v2v_h5_close(&creation);
    v2v_h5_close(&space);
    return rc;
}

/* Rank 0, by itself: the whole file but for its data. */
static enum v2v_status create_file(struct v2v_h5_writer *writer, const struct v2v_h5_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    hid_t file = H5I_INVALID_HID;
    V2V_TRY(check_space(writer, plan));
    V2V_TRY(v2v_h5_create(&file, writer->temporary, 0));
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        if (plan->dataset[i] != NULL) {
            V2V_TRY(create_images(file, writer->path, plan->dataset[i], plan->shape));
        }
    }
    if (plan->with_done) {
        V2V_TRY(create_marks(file, writer->path, "/done", H5T_STD_U8LE, plan->shape[0]));
    }
    if (writer->sums != NULL) {
        V2V_TRY(create_marks(file, writer->path, V2V_H5_CHECKSUM, H5T_STD_U64LE, plan->shape[0]));
    }
    V2V_TRY(plan->describe(file, writer->path, plan->context));
    const herr_t closed = H5Fclose(file);
    file = H5I_INVALID_HID;
    if (closed < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "can't be closed"));
    }
    if (writer->sums != NULL) {
        V2V_TRY(v2v_file_sync(writer->temporary));
    }
done:
    v2v_h5_close(&file);
    return rc;
}

/* What a file with a task needs beside its data. Local. */
static enum v2v_status allocate_checksums(struct v2v_h5_writer *writer,
                                          const struct v2v_h5_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    if (plan->task != NULL && plan->with_done) {
        V2V_TRY(V2V_ALLOC(writer->sums, "io.h5_writer", plan->shape[0]));
        V2V_TRY(V2V_ALLOC(writer->totals, "io.h5_writer", plan->shape[0]));
        V2V_TRY(V2V_ALLOC(writer->was_done, "io.h5_writer", plan->shape[0]));
    }
done:
    return rc;
}

/* The file under its temporary name: the one that the run before left, or a new one. */
static enum v2v_status prepare_file(struct v2v_h5_writer *writer, const struct v2v_h5_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    const int on_root = v2v_comm_rank(writer->comm) == 0;
    rc = v2v_text_format(writer->lock_name, sizeof writer->lock_name, "%s.lock", writer->path);
    if (rc == V2V_OK && on_root) {
        rc = v2v_file_lock(&writer->lock, writer->lock_name);
    }
    if (rc == V2V_OK) {
        rc = allocate_checksums(writer, plan);
    }
    V2V_TRY(v2v_par_agree(writer->comm, rc));
    if (plan->resume && writer->sums != NULL) {
        V2V_TRY(v2v_h5_resume(&writer->resumed, writer->was_done, writer->temporary, plan,
                              writer->comm));
    }
    writer->created = 1;
    rc = V2V_FAULT_POINT("h5.create");
    if (rc == V2V_OK && on_root && !writer->resumed) {
        rc = create_file(writer, plan);
    }
    V2V_TRY(v2v_par_agree(writer->comm, rc));
done:
    return rc;
}

/* Agree on the outcome of a collective HDF5 call. */
static enum v2v_status settle(struct v2v_h5_writer *writer, enum v2v_status rc)
{
    rc = v2v_par_agree(writer->comm, rc);
    writer->broken |= rc != V2V_OK;
    return rc;
}

/* Local: the properties with which all ranks open and write. */
static enum v2v_status prepare_access(struct v2v_h5_writer *writer, hid_t *access)
{
    const int parallel = v2v_comm_size(writer->comm) > 1;
    v2v_h5_quiet();
    *access = H5Pcreate(H5P_FILE_ACCESS);
    writer->transfer = H5Pcreate(H5P_DATASET_XFER);
    if (*access < 0 || writer->transfer < 0 || H5Pset_file_locking(*access, 0, 1) < 0 ||
        (parallel && (H5Pset_fapl_mpio(*access, v2v_comm_mpi(writer->comm), MPI_INFO_NULL) < 0 ||
                      H5Pset_coll_metadata_write(*access, 1) < 0 ||
                      H5Pset_dxpl_mpio(writer->transfer, H5FD_MPIO_COLLECTIVE) < 0))) {
        return V2V_H5_FAIL(V2V_E_MEMORY, writer->path, "/", "no access properties");
    }
    return V2V_OK;
}

static enum v2v_status open_datasets(struct v2v_h5_writer *writer, const struct v2v_h5_plan *plan)
{
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        if (plan->dataset[i] != NULL) {
            writer->set[i] = H5Dopen2(writer->file, plan->dataset[i], H5P_DEFAULT);
            if (writer->set[i] < 0) {
                return V2V_H5_FAIL(V2V_E_IO, writer->path, plan->dataset[i], "can't be opened");
            }
        }
    }
    if (plan->with_done) {
        writer->done = H5Dopen2(writer->file, "/done", H5P_DEFAULT);
        if (writer->done < 0) {
            return V2V_H5_FAIL(V2V_E_IO, writer->path, "/done", "can't be opened");
        }
    }
    if (writer->sums != NULL) {
        writer->checksum = H5Dopen2(writer->file, V2V_H5_CHECKSUM, H5P_DEFAULT);
        if (writer->checksum < 0) {
            return V2V_H5_FAIL(V2V_E_IO, writer->path, V2V_H5_CHECKSUM, "can't be opened");
        }
    }
    return V2V_OK;
}

enum v2v_status v2v_h5_writer_create(struct v2v_h5_writer **writer, const char *path,
                                     const struct v2v_h5_plan *plan, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_writer *fresh = NULL;
    hid_t access = H5I_INVALID_HID;
    *writer = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(fresh, "io.h5_writer", 1)));
    fresh->comm = comm;
    fresh->lock = -1;
    memcpy(fresh->shape, plan->shape, sizeof fresh->shape);
    rc = v2v_text_format(fresh->path, sizeof fresh->path, "%s", path);
    if (rc == V2V_OK) {
        rc = v2v_file_temporary(fresh->temporary, path);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(prepare_file(fresh, plan));
    V2V_TRY(v2v_par_agree(comm, prepare_access(fresh, &access)));
    fresh->file = H5Fopen(fresh->temporary, H5F_ACC_RDWR, access);
    V2V_TRY(settle(fresh, fresh->file >= 0
                              ? V2V_OK
                              : V2V_H5_FAIL(V2V_E_IO, path, "/", "can't be opened to write")));
    V2V_TRY(settle(fresh, open_datasets(fresh, plan)));
    *writer = fresh;
    fresh = NULL;
done:
    v2v_h5_close(&access);
    v2v_h5_writer_abandon(&fresh);
    return rc;
}

int v2v_h5_writer_is_done(const struct v2v_h5_writer *writer, int64_t t)
{
    V2V_ASSERT(t >= 0 && t < writer->shape[0]);
    return writer->was_done != NULL && writer->was_done[t];
}

/* One collective transfer: this rank's block, or nothing when its count[0] is 0. */
static enum v2v_status transfer_block(struct v2v_h5_writer *writer, hid_t set, hid_t type,
                                      const void *data, int rank, const hsize_t *start,
                                      const hsize_t *count)
{
    enum v2v_status rc = V2V_FAULT_POINT("h5.write");
    static const hsize_t one[4] = {1, 1, 1, 1};
    const int empty = count[0] == 0;
    /* In the file's shape: HDF5 walks through selections of unequal ranks element by element. */
    hid_t memory = H5Screate_simple(rank, empty ? one : count, NULL);
    hid_t space = H5Dget_space(set);
    const herr_t selected =
        empty ? (H5Sselect_none(space) < 0 || H5Sselect_none(memory) < 0 ? -1 : 0)
              : H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, count, NULL);
    if (rc == V2V_OK && (memory < 0 || selected < 0)) {
        rc = V2V_H5_FAIL(V2V_E_MEMORY, writer->path, "/", "no selection");
    }
    V2V_TRY(v2v_par_agree(writer->comm, rc));
    const float nothing = 0.0f; /* HDF5 wants an address even for an empty selection */
    if (H5Dwrite(set, type, memory, space, writer->transfer, empty ? &nothing : data) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "writing failed");
    }
    V2V_TRY(settle(writer, rc));
done:
    v2v_h5_close(&space);
    v2v_h5_close(&memory);
    return rc;
}

/* Rows of images first .. first+count-1 of frame t; the sums wrap around. */
static void add_checksum(struct v2v_h5_writer *writer, int set, const float *images, int64_t t,
                         int64_t first, int64_t count)
{
    const int64_t *shape = writer->shape;
    const int64_t row = ((set * shape[0] + t) * shape[1] + first) * shape[2];
    writer->sums[t] = (int64_t)((uint64_t)writer->sums[t] +
                                v2v_h5_rows_checksum(images, row, count * shape[2], shape[3]));
}

enum v2v_status v2v_h5_writer_write(struct v2v_h5_writer *writer, int set, const float *images,
                                    int64_t t, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = writer->shape;
    const int64_t image = shape[2] * shape[3];
    const int64_t fitting = MOST_ROUND_BYTES / (image * (int64_t)sizeof(float));
    const int64_t most = fitting > 1 ? fitting : 1;
    int64_t rounds = (count + most - 1) / most;
    V2V_ASSERT(set >= 0 && set < V2V_H5_WRITER_SETS && writer->set[set] > 0);
    V2V_ASSERT(count == 0 || (count > 0 && t >= 0 && t < shape[0] && first >= 0 &&
                              count <= shape[1] && first <= shape[1] - count));
    v2v_par_max_i64(writer->comm, &rounds, 1);
    for (int64_t round = 0; round < rounds; round++) {
        const int64_t done = round * most < count ? round * most : count;
        const int64_t now = count - done < most ? count - done : most;
        const hsize_t start[4] = {(hsize_t)t, (hsize_t)(first + done), 0, 0};
        const hsize_t size[4] = {now > 0 ? 1 : 0, (hsize_t)now, (hsize_t)shape[2],
                                 (hsize_t)shape[3]};
        V2V_TRY(transfer_block(writer, writer->set[set], H5T_NATIVE_FLOAT, images + done * image, 4,
                               start, size));
    }
    if (writer->sums != NULL && count > 0) {
        add_checksum(writer, set, images, t, first, count);
    }
done:
    return rc;
}

static enum v2v_status flush(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_par_agree(writer->comm, V2V_FAULT_POINT("h5.flush")));
    if (H5Fflush(writer->file, H5F_SCOPE_GLOBAL) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "can't be flushed");
    }
    V2V_TRY(settle(writer, rc));
done:
    return rc;
}

/* The checksums of the frames that any rank marks now, out of what every rank wrote of them; each
 * rank puts down those of the frames that it marks itself. */
static enum v2v_status put_checksums(struct v2v_h5_writer *writer, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t start = (hsize_t)first, size = (hsize_t)count;
    int64_t ends[2] = {count > 0 ? -first : -writer->shape[0], first + count - 1};
    v2v_par_max_i64(writer->comm, ends, 2);
    const int64_t low = -ends[0], frames = ends[1] - low + 1;
    if (frames <= 0) {
        goto done;
    }
    memcpy(writer->totals, writer->sums + low, (size_t)frames * sizeof *writer->totals);
    v2v_par_sum_i64(writer->comm, writer->totals, frames);
    V2V_TRY(transfer_block(writer, writer->checksum, H5T_NATIVE_UINT64,
                           writer->totals + (count > 0 ? first - low : 0), 1, &start, &size));
done:
    return rc;
}

/* Frames first .. first+count-1 of this rank are done; count may be 0. */
static enum v2v_status mark(struct v2v_h5_writer *writer, const uint8_t *ones, int64_t first,
                            int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t start = (hsize_t)first, size = (hsize_t)count;
    V2V_ASSERT(writer->done > 0 && first >= 0 && first + count <= writer->shape[0]);
    V2V_TRY(flush(writer));
    if (writer->sums != NULL) {
        V2V_TRY(put_checksums(writer, first, count));
    }
    V2V_TRY(transfer_block(writer, writer->done, H5T_NATIVE_UINT8, ones, 1, &start, &size));
    V2V_TRY(flush(writer));
    if (writer->sums != NULL && v2v_comm_size(writer->comm) == 1) {
        V2V_TRY(v2v_file_sync(writer->temporary)); /* MPI-IO's flush does it, the plain one not */
    }
done:
    return rc;
}

enum v2v_status v2v_h5_writer_mark_done(struct v2v_h5_writer *writer, int64_t t)
{
    const uint8_t one = 1;
    writer->marked = 1;
    return t < 0 ? mark(writer, &one, 0, 0) : mark(writer, &one, t, 1);
}

static enum v2v_status mark_all(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    const int64_t frames = v2v_comm_rank(writer->comm) == 0 ? writer->shape[0] : 0;
    uint8_t *ones = NULL;
    V2V_TRY(v2v_par_agree(writer->comm, V2V_ALLOC(ones, "io.done", frames)));
    memset(ones, 1, (size_t)frames);
    V2V_TRY(mark(writer, ones, 0, frames));
done:
    v2v_mem_free(ones);
    return rc;
}

/* Close everything; the file itself by H5Fclose, which is collective and tells whether it worked.
 * The outcome is this rank's own. */
static enum v2v_status close_file(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = v2v_h5_close_written(V2V_OK, &writer->done, writer->path, "/done");
    rc = v2v_h5_close_written(rc, &writer->checksum, writer->path, V2V_H5_CHECKSUM);
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        rc = v2v_h5_close_written(rc, &writer->set[i], writer->path, "a dataset");
    }
    if (writer->file > 0 && H5Fclose(writer->file) < 0 && rc == V2V_OK) {
        rc = V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "can't be closed");
    }
    writer->file = H5I_INVALID_HID;
    v2v_h5_close(&writer->transfer);
    return rc;
}

enum v2v_status v2v_h5_writer_finish(struct v2v_h5_writer **writer)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_writer *own = *writer;
    if (own->done > 0 && !own->marked && !own->resumed) {
        V2V_TRY(mark_all(own));
    }
    V2V_TRY(settle(own, close_file(own)));
    if (v2v_comm_rank(own->comm) == 0) {
        rc = v2v_file_commit(own->temporary, own->path);
    }
    V2V_TRY(v2v_par_agree(own->comm, rc));
    own->created = 0;
done:
    v2v_h5_writer_abandon(writer);
    return rc;
}

void v2v_h5_writer_abandon(struct v2v_h5_writer **writer)
{
    struct v2v_h5_writer *own = *writer;
    *writer = NULL;
    if (own == NULL) {
        return;
    }
    if (own->created && v2v_comm_rank(own->comm) == 0) {
        unlink(own->temporary); /* before the close, which may not come back */
    }
    if (own->broken) {
        v2v_watchdog_arm(BROKEN_CLOSE_SECONDS, "closing a file whose writing failed");
    }
    /* What the close says is of no interest: the file is gone, or it is closed already. */
    (void)!close_file(own);
    if (own->lock >= 0) {
        unlink(own->lock_name); /* while it is held: who finds it gone makes its own */
        close(own->lock);
    }
    v2v_mem_free(own->was_done);
    v2v_mem_free(own->totals);
    v2v_mem_free(own->sums);
    v2v_mem_free(own);
}

void v2v_h5_writer_suspend(struct v2v_h5_writer **writer)
{
    if (*writer != NULL && (*writer)->sums != NULL && ((*writer)->marked || (*writer)->resumed)) {
        (*writer)->created = 0; /* so that it isn't removed */
    }
    v2v_h5_writer_abandon(writer);
}
