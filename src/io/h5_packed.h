/** An HDF5 volume of integers, or compressed, which rank 0 writes chunk by chunk. */
#ifndef V2V_IO_H5_PACKED_H
#define V2V_IO_H5_PACKED_H

#include "io/volume_pack.h"

struct v2v_h5_packed;

/** A file with all that `part` has beside its volumes, and datasets for these.
 *  @kind Collective(comm). @param pack outlives it @param step [sets] of integers
 *  @return V2V_OK | V2V_E_IO | V2V_E_INPUT (`part` can't be read) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_h5_packed_create(struct v2v_h5_packed **packed, const char *path,
                                     const struct v2v_volume_pack *pack, const char *part,
                                     const double *step,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** A frame of each rank: rank r has frame first + r, where there is one.
 *  @kind Collective(comm). @param voxels [z,y,x] the numbers to store
 *  @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; agreed */
enum v2v_status v2v_h5_packed_put(struct v2v_h5_packed *packed, int set, const float *voxels,
                                  int64_t first) V2V_MUST_CHECK;

/** *packed is NULL afterwards. @kind Collective(comm). @param checksum [t]; NULL: none @param
 *  clipped [t] @return V2V_OK | V2V_E_IO; agreed */
enum v2v_status v2v_h5_packed_finish(struct v2v_h5_packed **packed, const int64_t *checksum,
                                     const int64_t *clipped) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_h5_packed_abandon(struct v2v_h5_packed **packed);

#endif
