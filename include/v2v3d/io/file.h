/** Files: TIFF, HDF5 and PNG in and out, never half-written.
 *
 *  Purpose: the only room that speaks libtiff, HDF5, libpng and JSON.
 *  Invariants: input is hostile: every size is checked before memory is taken, every message names
 *  file, page or dataset, and reason; output is written under a temporary name beside its place and
 *  renamed when complete on all ranks; an existing output is refused without force.
 *
 *  Example (compiled by tests/unit/io):
 *
 *      struct v2v_recording *recording = NULL;
 *      struct v2v_input_settings settings = {.views = 13};
 *      V2V_TRY(v2v_recording_open(&recording, "rec.tif", &settings, comm));
 *      const struct v2v_recording_info *info = v2v_recording_info(recording);
 *      V2V_TRY(V2V_ALLOC(views, "views", info->views * info->height * info->width));
 *      V2V_TRY(v2v_recording_read(recording, views, 0));
 *  done:
 *      v2v_recording_close(&recording);
 */
#ifndef V2V3D_IO_FILE_H
#define V2V3D_IO_FILE_H

#include "v2v3d/base/status.h"
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define V2V_PATH_BYTES 4096

/** Is it there, and what is it? @kind Local. */
int v2v_file_exists(const char *path);
int v2v_file_is_folder(const char *path);

/** Is `path` a readable regular file, and no folder, FIFO or device?
 *  @kind Local. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_file_check_input(const char *path) V2V_MUST_CHECK;

/** What a name says, by its ending in upper or lower case: .tif .tiff, .h5 .hdf5 .hdf,
 *  .safetensors, .yaml .yml, or none of these. @kind Local. */
enum v2v_file_kind {
    V2V_FILE_OTHER,
    V2V_FILE_TIFF,
    V2V_FILE_HDF5,
    V2V_FILE_SAFETENSORS,
    V2V_FILE_YAML
};
enum v2v_file_kind v2v_file_kind_of_name(const char *path);

/** Has it to be opened as HDF5? By its first bytes, else by its name. @kind Local. */
int v2v_file_is_hdf5(const char *path);

/** Is a size stated that is another than that of another file, by more than 1 %: they are stated
 *  with two digits, often? Not where one is none (0). @kind Local. */
int v2v_file_is_other_size(double um, double of_other_um);

/** What an HDF5 file has, as a message says it: "has /a, /b/c and 5 more", of its datasets a few.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (it cannot be opened: why) */
enum v2v_status v2v_file_hdf5_names(char *text, size_t bytes, const char *path) V2V_MUST_CHECK;

/** What tells a file that is read from itself after a change. */
struct v2v_file_state {
    int64_t bytes, inode;
    int64_t seconds, nanoseconds; /**< of its last modification */
};

/** Take it before the file is opened; after every read hand what that came to, `rc`, back, unless
 *  the file has changed since: it was cut off, written to, replaced or removed, and neither what
 *  was read nor why it could not be read means anything.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (no such file); rc | V2V_E_INPUT (what changed) */
enum v2v_status v2v_file_remember(struct v2v_file_state *state, const char *path) V2V_MUST_CHECK;
enum v2v_status v2v_file_unchanged(enum v2v_status rc, const struct v2v_file_state *state,
                                   const char *path) V2V_MUST_CHECK;

/** May an output be written to `path`?
 *  @kind   Local
 *  @return V2V_OK | V2V_E_USAGE (it exists and `force` is 0, or is one of the `count` inputs or
 *          would lie among the files of one) | V2V_E_IO (its folder is missing or not writable) |
 *          V2V_E_INPUT (too long) */
enum v2v_status v2v_file_check_output(const char *path, int force, const char *const *inputs,
                                      int64_t count) V2V_MUST_CHECK;

/** Has the disk of `path`, which need not exist but in whose folder it is to be, room for so many
 *  bytes (-1: a product that left int64_t)? @kind Local. @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_file_check_room(const char *path, int64_t bytes) V2V_MUST_CHECK;

/** The name under which an output is written until it is complete: path + ".v2v3d-part". Names that
 *  end so, or in ".v2v3d-packed" or ".v2v3d-lock", are this program's alone.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (too long) */
enum v2v_status v2v_file_temporary(char temporary[V2V_PATH_BYTES], const char *path) V2V_MUST_CHECK;

/** Create the file `path` when it isn't there, and hold a lock on it until *descriptor is closed or
 *  the process ends, however it ends. A link is not followed. @kind Local.
 *  @return V2V_OK | V2V_E_BUSY (another process holds it) | V2V_E_IO (also: it is no regular file);
 *  *descriptor is -1 unless OK */
enum v2v_status v2v_file_lock(int *descriptor, const char *path) V2V_MUST_CHECK;

/** The lock of an output that takes long to write, path + ".v2v3d-lock": hold it, and remove it.
 *  Under it what a run left that was killed in its pass is cleared. `name` keeps what
 *  v2v_file_unlock_output needs, which does nothing for a descriptor of -1.
 *  @kind Local. @return as v2v_file_lock | V2V_E_INPUT (too long) */
enum v2v_status v2v_file_lock_output(int *descriptor, char name[V2V_PATH_BYTES],
                                     const char *path) V2V_MUST_CHECK;
void v2v_file_unlock_output(int *descriptor, const char *name);

/** Does no other process hold that lock? @kind Local. @return likewise */
enum v2v_status v2v_file_check_idle(const char *path) V2V_MUST_CHECK;

/** Create a folder (and its parents); an existing one is fine.
 *  @kind Local. @return V2V_OK | V2V_E_IO | V2V_E_INPUT (too long) */
enum v2v_status v2v_file_make_folder(const char *path) V2V_MUST_CHECK;

/** Write text crash-safely (temporary, fsync, rename).
 *  @kind Local. @return V2V_OK | V2V_E_IO | V2V_E_INPUT (the name is too long) */
enum v2v_status v2v_file_write_text(const char *path, const char *text) V2V_MUST_CHECK;

/** Start the helper that looks at HDF5 files before this process does, and end it. It is forked
 *  before MPI starts: a later fork shares pages that a network card writes to by itself, which then
 *  has the wrong ones (ibv_fork_init(3)). Without it every look is such a fork. @kind Local. */
void v2v_file_guard_start(void);
void v2v_file_guard_stop(void);

/** Has HDF5 anything open in this process? After all files were closed: what it could not close.
 *  @kind Local. */
int v2v_file_left_open(void);

/** CRC-32C of bytes, continuing from `crc` (0 to start). @kind Local. */
uint32_t v2v_file_crc32c(uint32_t crc, const void *data, int64_t bytes);

#ifdef __cplusplus
}
#endif

#endif
