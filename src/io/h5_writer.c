#include "io/h5_writer.h"
#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/h5_resume.h"
#include "io/volume_pack.h"
#include "io/write_behind.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

/* After a failed collective HDF5 can wait for ever in the next one (8 times of 16 errors of one
 * rank's writes, HDF5 1.10.8). */
#define BROKEN_CLOSE_SECONDS 10.0

struct v2v_h5_writer {
    char path[V2V_PATH_BYTES], temporary[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    const struct v2v_comm *comm;
    const struct v2v_volume_pack *pack; /* or NULL */
    hid_t file, done, checksum;
    hid_t set[V2V_H5_WRITER_SETS];
    int64_t shape[4];
    int64_t place[V2V_H5_WRITER_SETS], done_place, checksum_place; /* -1: none */
    struct v2v_write_behind *behind; /* NULL: nothing was put to be written later yet */
    int64_t *sums;                   /* [t] checksums of what this rank wrote; else NULL */
    uint8_t *was_done;               /* [t] by the run before; NULL likewise */
    int lock;                        /* rank 0: holds lock_name while this is >= 0 */
    int resumed;                     /* agreed: frames of the run before may be there */
    int created;                     /* agreed: the temporary file may be there */
    int marked;                      /* this rank marked a frame, with others or alone */
    int broken; /* HDF5 itself failed in a call of this rank, or in a collective one */
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

/* One image a chunk, all space taken at once, nothing filled in: every image is written by exactly
 * one rank. */
static enum v2v_status create_images(hid_t file, const char *path, const char *name,
                                     const int64_t shape[4])
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent[4] = {(hsize_t)shape[0], (hsize_t)shape[1], (hsize_t)shape[2],
                               (hsize_t)shape[3]};
    const hsize_t chunk[4] = {1, 1, extent[2], extent[3]};
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
        H5Pset_obj_track_times(creation, 0) < 0 ||
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
    V2V_TRY(v2v_h5_create(&file, writer->temporary, 0,
                          v2v_mem_product(plan->shape[0], plan->shape[1], 1)));
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
    if (on_root) {
        rc = v2v_file_lock_output(&writer->lock, writer->lock_name, writer->path);
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

/* Local: the properties with which all ranks open the file. */
static enum v2v_status prepare_access(const struct v2v_h5_writer *writer, hid_t *access)
{
    const int parallel = v2v_comm_size(writer->comm) > 1;
    v2v_h5_quiet();
    *access = H5Pcreate(H5P_FILE_ACCESS);
    if (*access < 0 || H5Pset_file_locking(*access, 0, 1) < 0 ||
        (parallel && (H5Pset_fapl_mpio(*access, v2v_comm_mpi(writer->comm), MPI_INFO_NULL) < 0 ||
                      H5Pset_coll_metadata_write(*access, 1) < 0))) {
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

/* Are the numbers in the file as in memory? */
static int is_of(hid_t set, hid_t type)
{
    hid_t own = set > 0 ? H5Dget_type(set) : H5I_INVALID_HID;
    const int is_same = own > 0 && H5Tequal(own, type) > 0;
    v2v_h5_close(&own);
    return is_same;
}

/* Where the numbers of frames lie in the file, in one piece; -1: they do not. */
static int64_t place_of_numbers(hid_t set, hid_t type)
{
    const haddr_t at = is_of(set, type) ? H5Dget_offset(set) : HADDR_UNDEF;
    return at != HADDR_UNDEF ? (int64_t)at : -1;
}

/* Where image (t,z) lies in the file; -1: it is not found. */
static int64_t place_of_image(hid_t set, int64_t t, int64_t z)
{
    const hsize_t first[4] = {(hsize_t)t, (hsize_t)z, 0, 0};
    haddr_t at = HADDR_UNDEF;
    hsize_t bytes = 0;
    unsigned filters = 0;
    return H5Dget_chunk_info_by_coord(set, first, &filters, &at, &bytes) >= 0 && at != HADDR_UNDEF
               ? (int64_t)at
               : -1;
}

/* Where the images lie, if one behind the other; -1: they do not. Early on their chunks were
 * allocated in this order, and nothing can have come between them but nodes of the index, which
 * move all that follow. */
static int64_t place_of_images(hid_t set, const int64_t shape[4])
{
    const int64_t images = shape[0] * shape[1];
    const int64_t bytes = shape[2] * shape[3] * (int64_t)sizeof(float);
    const int64_t at = is_of(set, H5T_NATIVE_FLOAT) ? place_of_image(set, 0, 0) : -1;
    const int64_t last = at >= 0 ? place_of_image(set, shape[0] - 1, shape[1] - 1) : -1;
    return at >= 0 && last == at + (images - 1) * bytes ? at : -1;
}

/* Collective: what lies in one piece can be written without HDF5, where marks can, too. */
static void find_places(struct v2v_h5_writer *writer)
{
    writer->done_place = place_of_numbers(writer->done, H5T_STD_U8LE);
    writer->checksum_place = place_of_numbers(writer->checksum, H5T_STD_U64LE);
    const int has_marks = writer->done_place >= 0 && writer->checksum_place >= 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        writer->place[i] = has_marks ? place_of_images(writer->set[i], writer->shape) : -1;
    }
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
    fresh->pack = plan->pack;
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
    find_places(fresh);
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

/* This rank's block of a dataset; the other ranks are not waited for. HDF5 keeps nothing back of a
 * file that several ranks have open. Local. */
static enum v2v_status put_block(struct v2v_h5_writer *writer, hid_t set, hid_t type,
                                 const void *data, int rank, const hsize_t *start,
                                 const hsize_t *count)
{
    enum v2v_status rc = V2V_OK;
    hid_t memory = H5I_INVALID_HID, space = H5I_INVALID_HID;
    V2V_TRY(V2V_FAULT_POINT("h5.write"));
    memory = H5Screate_simple(rank, count, NULL);
    space = H5Dget_space(set);
    if (memory < 0 || space < 0 ||
        H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, count, NULL) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_MEMORY, writer->path, "/", "no selection"));
    }
    if (H5Dwrite(set, type, memory, space, H5P_DEFAULT, data) < 0) {
        writer->broken = 1;
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "writing failed"));
    }
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

enum v2v_status v2v_h5_writer_put(struct v2v_h5_writer *writer, int set, const float *images,
                                  int64_t t, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = writer->shape;
    const hsize_t start[4] = {(hsize_t)t, (hsize_t)first, 0, 0};
    const hsize_t size[4] = {1, (hsize_t)count, (hsize_t)shape[2], (hsize_t)shape[3]};
    V2V_ASSERT(set >= 0 && set < V2V_H5_WRITER_SETS && writer->set[set] > 0);
    V2V_ASSERT(count == 0 || (count > 0 && t >= 0 && t < shape[0] && first >= 0 &&
                              count <= shape[1] && first <= shape[1] - count));
    if (count == 0) {
        return V2V_OK;
    }
    V2V_TRY(put_block(writer, writer->set[set], H5T_NATIVE_FLOAT, images, 4, start, size));
    if (writer->sums != NULL) {
        add_checksum(writer, set, images, t, first, count);
    }
done:
    return rc;
}

enum v2v_status v2v_h5_writer_write(struct v2v_h5_writer *writer, int set, const float *images,
                                    int64_t t, int64_t first, int64_t count)
{
    return v2v_par_agree(writer->comm, v2v_h5_writer_put(writer, set, images, t, first, count));
}

/* What this rank wrote goes to the system, and to the disk where a later run may go on with it. A
 * rank alone has HDF5's buffers before that. Local. */
static enum v2v_status empty_buffers(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_FAULT_POINT("h5.flush"));
    if (v2v_comm_size(writer->comm) == 1 && H5Fflush(writer->file, H5F_SCOPE_GLOBAL) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "can't be flushed"));
    }
    if (writer->sums != NULL) {
        V2V_TRY(v2v_file_sync(writer->temporary));
    }
done:
    return rc;
}

/* Frames first .. first+count-1 are done, and these are their checksums (NULL: there are none).
 * Local: one rank does it. */
static enum v2v_status put_marks(struct v2v_h5_writer *writer, const uint8_t *ones,
                                 const int64_t *sums, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t start = (hsize_t)first, size = (hsize_t)count;
    V2V_ASSERT(writer->done > 0 && first >= 0 && first + count <= writer->shape[0]);
    V2V_TRY(V2V_FAULT_POINT("h5.mark"));
    if (sums != NULL) {
        V2V_TRY(put_block(writer, writer->checksum, H5T_NATIVE_UINT64, sums, 1, &start, &size));
    }
    V2V_TRY(put_block(writer, writer->done, H5T_NATIVE_UINT8, ones, 1, &start, &size));
    if (v2v_comm_size(writer->comm) == 1 && H5Fflush(writer->file, H5F_SCOPE_GLOBAL) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, writer->path, "/", "can't be flushed"));
    }
done:
    return rc;
}

enum v2v_status v2v_h5_writer_mark_done(struct v2v_h5_writer *writer, int64_t t,
                                        const struct v2v_comm *writers)
{
    enum v2v_status rc = V2V_OK;
    const uint8_t one = 1;
    V2V_ASSERT(t >= 0 && t < writer->shape[0]);
    int64_t sum = writer->sums != NULL ? writer->sums[t] : 0;
    V2V_TRY(v2v_par_agree(writers, empty_buffers(writer)));
    v2v_par_sum_i64(writers, &sum, 1);
    if (v2v_comm_rank(writers) == 0) {
        rc = put_marks(writer, &one, writer->sums != NULL ? &sum : NULL, t, 1);
    }
    V2V_TRY(v2v_par_agree(writers, rc));
    writer->marked = 1;
done:
    return rc;
}

/* ---- by a thread ---- */

/* Local: the thread, from the first time on that there is something for it to do. */
static enum v2v_status begin_behind(struct v2v_h5_writer *writer)
{
    return writer->behind != NULL
               ? V2V_OK
               : v2v_write_behind_create(&writer->behind, writer->temporary, writer->path);
}

enum v2v_status v2v_h5_writer_put_later(struct v2v_h5_writer *writer, int set, const float *images,
                                        int64_t t, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = writer->shape;
    const int64_t image = shape[2] * shape[3] * (int64_t)sizeof *images;
    const int64_t place = writer->place[set];
    if (count == 0 || place < 0) {
        return v2v_h5_writer_put(writer, set, images, t, first, count);
    }
    V2V_ASSERT(t >= 0 && t < shape[0] && first >= 0 && count > 0 && first + count <= shape[1]);
    V2V_TRY(begin_behind(writer));
    V2V_TRY(v2v_write_behind_put(writer->behind,
                                 &(struct v2v_piece){.data = images,
                                                     .bytes = count * image,
                                                     .at = place + (t * shape[1] + first) * image,
                                                     .fault = "h5.write"}));
    add_checksum(writer, set, images, t, first, count);
done:
    return rc;
}

/* Local: a number of so many bytes. */
static enum v2v_status put_number(struct v2v_h5_writer *writer, uint64_t number, int64_t bytes,
                                  int64_t at)
{
    return v2v_write_behind_put(
        writer->behind,
        &(struct v2v_piece){.number = number, .bytes = bytes, .at = at, .fault = "h5.mark"});
}

enum v2v_status v2v_h5_writer_mark_later(struct v2v_h5_writer *writer, int64_t t,
                                         const struct v2v_comm *writers)
{
    enum v2v_status rc = V2V_OK;
    if (v2v_comm_size(writers) > 1 || writer->behind == NULL) {
        V2V_TRY(v2v_par_agree(writers, v2v_h5_writer_wait(writer)));
        return v2v_h5_writer_mark_done(writer, t, writers);
    }
    V2V_ASSERT(t >= 0 && t < writer->shape[0]);
    const int64_t bytes = (int64_t)sizeof *writer->sums;
    V2V_TRY(
        put_number(writer, (uint64_t)writer->sums[t], bytes, writer->checksum_place + t * bytes));
    V2V_TRY(put_number(writer, 1, 1, writer->done_place + t));
    writer->marked = 1;
done:
    return rc;
}

enum v2v_status v2v_h5_writer_wait(struct v2v_h5_writer *writer)
{
    return writer->behind != NULL ? v2v_write_behind_wait(writer->behind) : V2V_OK;
}

/* ---- the end ---- */

/* Collective(comm): rank 0 marks all frames. */
static enum v2v_status mark_all(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    const int64_t frames = v2v_comm_rank(writer->comm) == 0 ? writer->shape[0] : 0;
    uint8_t *ones = NULL;
    V2V_TRY(v2v_par_agree(writer->comm, V2V_ALLOC(ones, "io.done", frames)));
    if (writer->sums != NULL) {
        v2v_par_sum_i64(writer->comm, writer->sums, writer->shape[0]);
    }
    memset(ones, 1, (size_t)frames);
    if (frames > 0) {
        rc = put_marks(writer, ones, writer->sums, 0, frames);
    }
    V2V_TRY(v2v_par_agree(writer->comm, rc));
done:
    v2v_mem_free(ones);
    return rc;
}

/* Collective(comm): what any rank knows of the file, all know. */
static void share_state(struct v2v_h5_writer *writer)
{
    int64_t state[] = {writer->marked, writer->broken};
    v2v_par_max_i64(writer->comm, state, 2);
    writer->marked = (int)state[0];
    writer->broken = (int)state[1];
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
    return rc;
}

/* What is complete gets its name: it, or what is made of it. Collective(comm). */
static enum v2v_status give_name(struct v2v_h5_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    char packed[V2V_PATH_BYTES];
    const int on_root = v2v_comm_rank(writer->comm) == 0;
    if (writer->pack != NULL) {
        V2V_TRY(v2v_par_agree(writer->comm, v2v_file_packed(packed, writer->path)));
        V2V_TRY(v2v_volume_pack_run(writer->pack, packed, writer->temporary, writer->comm));
    }
    if (on_root) { /* a failure costs no frame: what they were written to stays */
        rc = writer->pack != NULL ? v2v_file_commit(packed, writer->path)
                                  : v2v_file_move(writer->temporary, writer->path);
    }
    V2V_TRY(v2v_par_agree(writer->comm, rc));
    if (on_root && writer->pack != NULL) {
        unlink(writer->temporary);
    }
done:
    return rc;
}

enum v2v_status v2v_h5_writer_finish(struct v2v_h5_writer **writer)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_h5_writer *own = *writer;
    V2V_TRY(v2v_par_agree(own->comm, v2v_h5_writer_wait(own)));
    v2v_write_behind_destroy(&own->behind);
    share_state(own);
    if (own->done > 0 && !own->marked && !own->resumed) {
        V2V_TRY(mark_all(own));
    }
    rc = close_file(own);
    if (rc == V2V_OK) {
        rc = v2v_file_sync(own->temporary); /* each host has written a part of it */
    }
    V2V_TRY(settle(own, rc));
    V2V_TRY(give_name(own));
    own->created = 0;
done:
    v2v_h5_writer_suspend(writer); /* a failure at the end costs no frame that is done */
    return rc;
}

void v2v_h5_writer_abandon(struct v2v_h5_writer **writer)
{
    struct v2v_h5_writer *own = *writer;
    struct v2v_status_record earlier;
    *writer = NULL;
    if (own == NULL) {
        return;
    }
    v2v_write_behind_destroy(&own->behind);
    if (own->created && v2v_comm_rank(own->comm) == 0) {
        unlink(own->temporary); /* before the close, which may not come back */
    }
    if (own->broken) {
        v2v_watchdog_arm(BROKEN_CLOSE_SECONDS, "closing a file whose writing failed");
    }
    /* What the close says is of no interest: the file is gone, closed, or was not written well. */
    v2v_status_keep(&earlier);
    (void)!close_file(own);
    v2v_status_restore(&earlier);
    v2v_file_unlock_output(&own->lock, own->lock_name);
    v2v_mem_free(own->was_done);
    v2v_mem_free(own->sums);
    v2v_mem_free(own);
}

void v2v_h5_writer_suspend(struct v2v_h5_writer **writer)
{
    struct v2v_h5_writer *own = *writer;
    if (own != NULL) {
        share_state(own);
        if (own->sums != NULL && (own->marked || own->resumed)) {
            own->created = 0; /* so that it isn't removed */
        }
    }
    v2v_h5_writer_abandon(writer);
}
