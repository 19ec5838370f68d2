/** What a file says of a dataset's storage, held against the dataset before HDF5 reads by it.
 *
 *  HDF5 takes a chunk as its index describes it: one that is shorter than the dataset's chunks, as
 *  stored or once decoded, is copied from beyond the end of its memory (1.10.8). Without filters no
 *  recorded size is used at all where chunks are not cached (v2v_h5_open_dataset), and their sum
 *  tells of damage. With filters a chunk is first decoded in a file in memory, in whose pipeline
 *  every size is checked.
 */
#ifndef V2V_IO_H5_CHUNKS_H
#define V2V_IO_H5_CHUNKS_H

#include "v2v3d/base/status.h"
#include <hdf5.h>

struct v2v_h5_chunks;

/** Look at the storage as a whole. @kind Local. @param path, name borrowed; set is to stay open
 *  @return V2V_OK | V2V_E_INPUT (more or fewer bytes stored than the dataset has, or chunks; a
 *  chunk of more than 2 GiB) | V2V_E_MEMORY */
enum v2v_status v2v_h5_chunks_create(struct v2v_h5_chunks **chunks, hid_t set, const char *path,
                                     const char *name) V2V_MUST_CHECK;

/** Every chunk that the block meets, once each. @kind Local. @param what the message's words for
 *  the block and its fate @param start, count NULL: all of the dataset
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY. @cost with filters: each is read and decoded */
enum v2v_status v2v_h5_chunks_check(struct v2v_h5_chunks *chunks, const char *what,
                                    const hsize_t *start, const hsize_t *count) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_h5_chunks_destroy(struct v2v_h5_chunks **chunks);

/** A whole dataset of numbers, its chunks checked. @kind Local. @return V2V_OK | V2V_E_INPUT |
 *  V2V_E_MEMORY */
enum v2v_status v2v_h5_read_all(void *out, hid_t set, hid_t type, const char *path,
                                const char *name) V2V_MUST_CHECK;

#endif
