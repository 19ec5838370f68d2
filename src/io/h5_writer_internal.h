/** What the parts of the HDF5 writer share: what it holds, from its creation to its end. */
#ifndef V2V_IO_H5_WRITER_INTERNAL_H
#define V2V_IO_H5_WRITER_INTERNAL_H

#include "io/h5_writer.h"
#include "io/write_behind.h"
#include "v2v3d/io/file.h"

struct v2v_h5_writer {
    char path[V2V_PATH_BYTES], temporary[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    const struct v2v_comm *comm;
    const struct v2v_volume_pack *pack; /* or NULL */
    hid_t file, done, checksum;
    hid_t set[V2V_H5_WRITER_SETS];
    const char *dataset[V2V_H5_WRITER_SETS]; /* the plan's */
    int64_t shape[4];
    int64_t place[V2V_H5_WRITER_SETS], done_place, checksum_place; /* -1: none */
    struct v2v_write_behind *behind; /* NULL: nothing was put to be written later yet */
    int64_t *sums;                   /* [t] checksums of what this rank wrote; else NULL */
    uint8_t *was_done;               /* [t] by the run before; NULL likewise */
    int64_t unsynced;                /* bytes that this rank wrote, without sums */
    int lock;                        /* rank 0: holds lock_name while this is >= 0 */
    int resumed;                     /* agreed: frames of the run before may be there */
    int created;                     /* agreed: the temporary file may be there */
    int marked;                      /* this rank marked a frame, with others or alone */
    int broken; /* HDF5 itself failed in a call of this rank, or in a collective one */
};

/** Agree on the outcome of a collective HDF5 call. @kind Collective(comm). @return agreed */
enum v2v_status v2v_h5_writer_settle(struct v2v_h5_writer *writer,
                                     enum v2v_status rc) V2V_MUST_CHECK;

/** What lies in one piece can be written without HDF5, where marks can, too. @kind Local. */
void v2v_h5_writer_find_places(struct v2v_h5_writer *writer);

/** Images first .. first+count-1 of frame t count for its checksum; the sums wrap around.
 *  @kind Local. */
void v2v_h5_writer_add_checksum(struct v2v_h5_writer *writer, int set, const float *images,
                                int64_t t, int64_t first, int64_t count);

#endif
