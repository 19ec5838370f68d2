/** Writes into a file that a thread does while the caller goes on.
 *
 *  One after the other, in their order, and each is on the disk before the next one begins: what
 *  comes behind a frame's data may say that they are there. The first failure is the last word:
 *  what was to come behind it is not written, and every later call tells it.
 *
 *  The thread calls nothing but the system: neither HDF5 nor MPI has to know of threads.
 */
#ifndef V2V_IO_WRITE_BEHIND_H
#define V2V_IO_WRITE_BEHIND_H

#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>

struct v2v_write_behind;

/** What goes where. */
struct v2v_piece {
    const void *data; /**< lent until v2v_write_behind_wait; NULL: `number`, little-endian */
    uint64_t number;
    int64_t bytes, at;
    const char *fault; /**< fault point */
};

/** @param path of a file that is there @param name that messages call it by. @kind Local. @return
 *  V2V_OK | V2V_E_IO | V2V_E_MEMORY (no thread) */
enum v2v_status v2v_write_behind_create(struct v2v_write_behind **behind, const char *path,
                                        const char *name) V2V_MUST_CHECK;

/** @kind Local. @return V2V_OK | V2V_E_IO of this or an earlier piece */
enum v2v_status v2v_write_behind_put(struct v2v_write_behind *behind,
                                     const struct v2v_piece *piece) V2V_MUST_CHECK;

/** Until all is on the disk, or failed: nothing is lent any more. @kind Local. @return likewise */
enum v2v_status v2v_write_behind_wait(struct v2v_write_behind *behind) V2V_MUST_CHECK;

/** After what is in work; what still waits is not written. @kind Local; accepts NULL. */
void v2v_write_behind_destroy(struct v2v_write_behind **behind);

#endif
