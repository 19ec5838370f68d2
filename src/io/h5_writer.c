#include "io/file_internal.h"
#include "io/h5_checksum.h"
#include "io/h5_common.h"
#include "io/h5_resume.h"
#include "io/h5_writer_internal.h"
#include "io/volume_pack.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"
#include <string.h>
#include <unistd.h>

/* After a failed collective HDF5 can wait for ever in the next one (8 times of 16 errors of one
 * rank's writes, HDF5 1.10.8). */
#define BROKEN_CLOSE_SECONDS 10.0

enum v2v_status v2v_h5_writer_settle(struct v2v_h5_writer *writer, enum v2v_status rc)
{
    rc = v2v_par_agree(writer->comm, rc);
    writer->broken |= rc != V2V_OK;
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

void v2v_h5_writer_add_checksum(struct v2v_h5_writer *writer, int set, const float *images,
                                int64_t t, int64_t first, int64_t count)
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
        v2v_h5_writer_add_checksum(writer, set, images, t, first, count);
    } else {
        const int64_t bytes = count * shape[2] * shape[3] * (int64_t)sizeof *images;
        V2V_TRY(v2v_file_sync_piece(&writer->unsynced, bytes, writer->temporary));
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
    V2V_TRY(v2v_h5_writer_settle(own, rc));
    if (own->resumed && own->pack == NULL) { /* else it is read and checked there */
        V2V_TRY(v2v_h5_check_written(own->temporary, own->dataset, own->shape[0], own->comm));
    }
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
    if (own->created && !own->resumed && v2v_comm_rank(own->comm) == 0) {
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
