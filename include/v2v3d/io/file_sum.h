#ifndef V2V3D_IO_FILE_SUM_H
#define V2V3D_IO_FILE_SUM_H

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A number that differs, but for one chance in 2^32 or less, where the bytes of two files, or of
 *  the TIFF files of two folders, differ: the sum of a hash of every 16 MiB's CRC-32C and place.
 *  @kind Collective(comm); the same for any number of ranks. @return V2V_OK | V2V_E_INPUT |
 *  V2V_E_MEMORY; agreed. @cost reads the file once, shared by the ranks */
enum v2v_status v2v_file_sum(uint64_t *sum, const char *path,
                             const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Do all ranks read the same under this name? By the size, the first and the last 16 MiB; of a
 *  folder by the sizes of its TIFF files, and the first of them.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_INPUT (which rank doesn't) | V2V_E_MEMORY; agreed
 *  @cost nothing on one rank */
enum v2v_status v2v_file_agree(const char *path, const struct v2v_comm *comm) V2V_MUST_CHECK;

/** CRC-32C of all bytes of a file. @kind Local. @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_file_crc32c_of(uint32_t *crc, const char *path) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
