#ifndef V2V_IO_FILE_INTERNAL_H
#define V2V_IO_FILE_INTERNAL_H

#include "v2v3d/io/file.h"
#include <stdio.h>

/** The name of what is made of an output's temporary file in a pass over it: path +
 *  ".v2v3d-packed". @kind Local. @return V2V_OK | V2V_E_INPUT (too long) */
enum v2v_status v2v_file_packed(char packed[V2V_PATH_BYTES], const char *path) V2V_MUST_CHECK;

/** Make the temporary file, open to read and write. What lies under its name, a killed run's or a
 *  link or pipe that somebody laid there, is removed and neither opened nor followed.
 *  @kind Local. @return V2V_OK | V2V_E_IO; *descriptor is -1 unless OK */
enum v2v_status v2v_file_create(int *descriptor, const char *temporary) V2V_MUST_CHECK;

/** Remove what lies under a temporary name; nothing may. @kind Local. @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_file_clear(const char *temporary) V2V_MUST_CHECK;

/** fsync the temporary file, rename it to `path`, fsync the folder. When that fails, _move leaves
 *  the temporary file, and _commit removes it. @kind Local (call on one rank).
 *  @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_file_move(const char *temporary, const char *path) V2V_MUST_CHECK;
enum v2v_status v2v_file_commit(const char *temporary, const char *path) V2V_MUST_CHECK;

/** Wait until what was written to a file has reached the disk. @kind Local. @return V2V_OK |
 * V2V_E_IO
 */
enum v2v_status v2v_file_sync(const char *path) V2V_MUST_CHECK;

/** Bytes that a file takes on its disk; 0: there is none. @kind Local. */
int64_t v2v_file_taken(const char *path);

/** The same in pieces, so that the end of a long file does not keep other ranks waiting: once some
 *  gigabytes more were written. @kind Local. @param pending 0 at first @return likewise */
enum v2v_status v2v_file_sync_piece(int64_t *pending, int64_t written,
                                    const char *path) V2V_MUST_CHECK;

/** Begin to write `path` under its temporary name. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT (too long a name) | V2V_E_IO; *stream is NULL unless OK */
enum v2v_status v2v_file_begin(FILE **stream, char temporary[V2V_PATH_BYTES],
                               const char *path) V2V_MUST_CHECK;

/** End the writing of a temporary file: close it; commit it to `path` when `rc` and the close are
 *  fine, else remove it. A NULL stream (it was never opened) hands `rc` back.
 *  @kind Local. @return rc | V2V_E_IO */
enum v2v_status v2v_file_close_and_commit(enum v2v_status rc, FILE *stream, const char *temporary,
                                          const char *path) V2V_MUST_CHECK;

/** CRC-32C without the processor's own instruction; the same answer. @kind Local. */
uint32_t v2v_file_crc32c_portable(uint32_t crc, const void *data, int64_t bytes);

#endif
