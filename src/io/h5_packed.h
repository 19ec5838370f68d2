/** An HDF5 volume of integers, or compressed, which rank 0 writes chunk by chunk. */
#ifndef V2V_IO_H5_PACKED_H
#define V2V_IO_H5_PACKED_H

#include "io/volume_pack.h"

struct v2v_h5_packed;

/** Are these slices ones that can be packed, each a message of MPI? @kind Local.
 *  @return V2V_OK | V2V_E_INPUT (too large) */
enum v2v_status v2v_h5_packed_check(const char *path,
                                    const struct v2v_volume_info *info) V2V_MUST_CHECK;

/** A file with all that `part` has beside its volumes, and datasets for these.
 *  @kind Collective(comm). @param pack outlives it @param step [sets] of integers
 *  @return V2V_OK | V2V_E_IO | V2V_E_INPUT (`part` can't be read) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_h5_packed_create(struct v2v_h5_packed **packed, const char *path,
                                     const struct v2v_volume_pack *pack, const char *part,
                                     const double *step,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** A frame of this rank as it is stored, by all threads. @kind Local. @param voxels [z,y,x] the
 *  numbers to store; lent until the frame is written @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_h5_packed_encode(struct v2v_h5_packed *packed,
                                     const float *voxels) V2V_MUST_CHECK;

/** The frame that `rank` has encoded is written as frame t. @kind Collective(comm).
 *  @return V2V_OK | V2V_E_IO; agreed */
enum v2v_status v2v_h5_packed_put(struct v2v_h5_packed *packed, int set, int64_t t,
                                  int rank) V2V_MUST_CHECK;

/** *packed is NULL afterwards. @kind Collective(comm). @param checksum [t]; NULL: none @param
 *  clipped [t] @return V2V_OK | V2V_E_IO; agreed */
enum v2v_status v2v_h5_packed_finish(struct v2v_h5_packed **packed, const int64_t *checksum,
                                     const int64_t *clipped) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_h5_packed_abandon(struct v2v_h5_packed **packed);

#endif
