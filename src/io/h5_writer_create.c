#include "io/file_internal.h"
#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/h5_resume.h"
#include "io/h5_writer_internal.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>
#include <time.h>

/* Is the shape fine, and has the disk room for the data? */
static enum v2v_status check_space(const struct v2v_h5_writer *writer,
                                   const struct v2v_h5_plan *plan)
{
    int64_t sets = 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        sets += plan->dataset[i] != NULL;
    }
    const int64_t *shape = plan->shape;
    const int64_t number = plan->is_uint16 ? sizeof(uint16_t) : sizeof(float);
    const int64_t image = v2v_mem_product(shape[2], shape[3], number * sets);
    const int64_t bytes = v2v_mem_product(shape[0], shape[1], image);
    V2V_ASSERT(shape[0] > 0 && shape[1] > 0 && image > 0);
    const int64_t taken = v2v_file_taken(writer->temporary); /* by an earlier run: it goes */
    return v2v_file_check_room(writer->path, bytes > taken ? bytes - taken : v2v_smaller(bytes, 0));
}

/* One image a chunk, all space taken at once, nothing filled in: every image is written by exactly
 * one rank. */
static enum v2v_status create_images(hid_t file, const char *path, const char *name,
                                     const struct v2v_h5_plan *plan)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = plan->shape;
    const hid_t type = plan->is_uint16 ? H5T_STD_U16LE : H5T_IEEE_F32LE;
    const hsize_t extent[4] = {(hsize_t)shape[0], (hsize_t)shape[1], (hsize_t)shape[2],
                               (hsize_t)shape[3]};
    const hsize_t chunk[4] = {1, 1, extent[2], extent[3]};
    hid_t space = H5Screate_simple(4, extent, NULL);
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t set = H5I_INVALID_HID;
    if (H5Pset_chunk(creation, 4, chunk) < 0 ||
        H5Pset_alloc_time(creation, H5D_ALLOC_TIME_EARLY) < 0 ||
        H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER) < 0 ||
        (set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, creation, H5P_DEFAULT)) < 0) {
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
                          v2v_mem_product(plan->shape[0], plan->shape[1], 1),
                          v2v_mem_product(plan->shape[2], plan->shape[3], sizeof(float))));
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        if (plan->dataset[i] != NULL) {
            V2V_TRY(create_images(file, writer->path, plan->dataset[i], plan));
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

/* Local: does this rank see the file that rank 0 made? Some file systems need a moment; without it
 * ranks would wait for each other in MPI-IO. */
static enum v2v_status see_file(const struct v2v_h5_writer *writer)
{
    enum { LOOKS = 50 };
    const struct timespec pause = {.tv_nsec = 100000000};
    for (int i = 0; i < LOOKS; i++) {
        v2v_watchdog_beat("looking for the output that rank 0 has made");
        if (v2v_file_exists(writer->temporary)) {
            return V2V_OK;
        }
        nanosleep(&pause, NULL);
    }
    return V2V_FAIL(V2V_E_IO,
                    "%s: rank 0 has made it and it is not seen here: all ranks have to write "
                    "into one folder",
                    writer->temporary);
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
    memcpy(fresh->dataset, plan->dataset, sizeof fresh->dataset);
    rc = v2v_text_format(fresh->path, sizeof fresh->path, "%s", path);
    if (rc == V2V_OK) {
        rc = v2v_file_temporary(fresh->temporary, path);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(prepare_file(fresh, plan));
    V2V_TRY(v2v_par_agree(comm, see_file(fresh)));
    V2V_TRY(v2v_par_agree(comm, prepare_access(fresh, &access)));
    fresh->file = H5Fopen(fresh->temporary, H5F_ACC_RDWR, access);
    V2V_TRY(v2v_h5_writer_settle(
        fresh,
        fresh->file >= 0 ? V2V_OK : V2V_H5_FAIL(V2V_E_IO, path, "/", "can't be opened to write")));
    V2V_TRY(v2v_h5_writer_settle(fresh, open_datasets(fresh, plan)));
    v2v_h5_writer_find_places(fresh);
    *writer = fresh;
    fresh = NULL;
done:
    v2v_h5_close(&access);
    v2v_h5_writer_abandon(&fresh);
    return rc;
}
