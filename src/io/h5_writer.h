/** Datasets [t,m,y,x] of float32, or of whole numbers 0 .. 65535 as uint16, written by all ranks of
 *  a communicator into one HDF5 file.
 *
 *  Rank 0 alone creates the file with everything that describes it and all its space (so that no
 *  rank can disagree about metadata), then all ranks open it and write images, each by itself: an
 *  image is one contiguous piece of the file already. On one rank the same calls take HDF5's plain
 *  driver and need no MPI.
 */
#ifndef V2V_IO_H5_WRITER_H
#define V2V_IO_H5_WRITER_H

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"
#include <hdf5.h>
#include <stdint.h>

#define V2V_H5_WRITER_SETS 4

struct v2v_h5_writer;
struct v2v_volume_pack;
struct v2v_volume_storage;

/** What to create. */
struct v2v_h5_plan {
    const char *dataset[V2V_H5_WRITER_SETS]; /**< names, which outlive the writer; NULL where
                                                  there is none */
    int64_t shape[4];                        /**< [t,m,y,x] of each */
    int is_uint16;                           /**< in the file; in memory they are float32 */
    int with_done;                           /**< a dataset /done [t], at first 0 */
    const char *task; /**< what `describe` writes as the attribute of this name: with it and /done
                           the file has checksums [t], and can be gone on with; or NULL */
    int resume;       /**< go on with what an interrupted writer of the same task left */
    const struct v2v_volume_storage *storage; /**< of a complete file that is checked; NULL: as it
                                                   is written here */
    const struct v2v_volume_pack *pack;       /**< makes the complete file of what is written; NULL:
                                                   it is that. Outlives the writer */
    /** Write attributes (on rank 0 only, before anything else can fail on another rank). */
    enum v2v_status (*describe)(hid_t file, const char *path, const void *context);
    const void *context;
};

/** @kind Collective(comm). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY | V2V_E_BUSY (another process
 *  writes this file); agreed */
enum v2v_status v2v_h5_writer_create(struct v2v_h5_writer **writer, const char *path,
                                     const struct v2v_h5_plan *plan,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Was frame t done before, by the run that this one goes on with? @kind Local. */
int v2v_h5_writer_is_done(const struct v2v_h5_writer *writer, int64_t t);

/** Images first .. first+count-1 of outer index t; count may be 0. The other ranks are not waited
 *  for. @kind Local. @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; after these two the file can only be
 *  suspended or abandoned */
enum v2v_status v2v_h5_writer_put(struct v2v_h5_writer *writer, int set, const float *images,
                                  int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;

/** As v2v_h5_writer_put, by a thread while the caller goes on: `images` are lent until
 *  v2v_h5_writer_wait. What went wrong with it is told by the next call. At once where a dataset
 *  does not lie in the file in one piece. @kind Local. @return likewise */
enum v2v_status v2v_h5_writer_put_later(struct v2v_h5_writer *writer, int set, const float *images,
                                        int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;

/** Until all that was put to be written later is on the disk, or failed. @kind Local. @return
 *  V2V_OK | V2V_E_IO */
enum v2v_status v2v_h5_writer_wait(struct v2v_h5_writer *writer) V2V_MUST_CHECK;

/** Likewise, of all ranks. @kind Collective(comm); ranks may differ in all arguments. @return
 *  agreed */
enum v2v_status v2v_h5_writer_write(struct v2v_h5_writer *writer, int set, const float *images,
                                    int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;

/** Frame t was put by the ranks of `writers`, and by nobody else. Its data go to the disk, then
 *  done[t] is set: a crash at any time leaves no frame marked whose data are missing. Without the
 *  flush in between a killed run left marked frames that read as zeros, 4 times of 4.
 *  @kind Collective(writers). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; agreed by them */
enum v2v_status v2v_h5_writer_mark_done(struct v2v_h5_writer *writer, int64_t t,
                                        const struct v2v_comm *writers) V2V_MUST_CHECK;

/** As v2v_h5_writer_mark_done, by the thread, once what was put later is on the disk; at once
 *  where several ranks wrote the frame. @kind Collective(writers). @return likewise, of this or an
 *  earlier frame */
enum v2v_status v2v_h5_writer_mark_later(struct v2v_h5_writer *writer, int64_t t,
                                         const struct v2v_comm *writers) V2V_MUST_CHECK;

/** Mark all done if nothing was marked; close; move into place. *writer is NULL afterwards, whether
 *  it succeeded or not; after a failure what was written is left as by v2v_h5_writer_suspend.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_IO | V2V_E_INPUT (what was gone on with holds
 *  other numbers than were written to it) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_h5_writer_finish(struct v2v_h5_writer **writer) V2V_MUST_CHECK;

/** Close, and leave what was written for a later run to go on with; removed if it has no task or no
 *  frame is done. Accepts NULL. @kind Collective(comm) */
void v2v_h5_writer_suspend(struct v2v_h5_writer **writer);

/** Close and remove what was written, but what was gone on with; accepts NULL. @kind
 *  Collective(comm) */
void v2v_h5_writer_abandon(struct v2v_h5_writer **writer);

#endif
