#ifndef V2V3D_IO_VOLUME_H
#define V2V3D_IO_VOLUME_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Types that the voxels of a file are written in. */
enum v2v_sample { V2V_SAMPLE_FLOAT32 = 0, V2V_SAMPLE_UINT16 };

/** How the voxels of a file are stored; zeroed: float32, as they are. */
struct v2v_volume_storage {
    enum v2v_sample sample;
    double peak; /**< UINT16: what 65535 stands for, in all frames; 0: the largest voxel of all
                      frames. Beyond it, and below 0, voxels are clipped and counted */
    int deflate; /**< HDF5: level 1 .. 9 of zlib, on shuffled bytes; 0: not compressed */
};

/** The outermost axis first: [t,z,y,x]. Sizes in micrometres, 0 = not stated (never invented). */
struct v2v_volume_info {
    int64_t frames, slices, height, width;
    double pixel_size_um, slice_spacing_um, frame_interval_s;
    struct v2v_volume_storage storage; /**< of a file to write; of one that is read: zeroed */
};

/** The attribute of a dataset of integers that tells the step between them, in the recording's
 *  units: the name that CF conventions for netCDF have for it, which some readers apply. */
#define V2V_VOLUME_STEP "scale_factor"

/** Attributes of where a volume's frames come from: the number of the first one in its recording
 *  (from 0), a hash of the recording's file, and what was taken off its samples. A TIFF keeps them
 *  too. */
#define V2V_VOLUME_FIRST_FRAME "first_frame"
#define V2V_VOLUME_RECORDING "recording_sum"
#define V2V_VOLUME_OFFSET "offset"

/** .. and which PSFs made it, as calibrated and normalised: v2v_psf_file_sum in hexadecimal. */
#define V2V_VOLUME_PSF "psf_crc32c"

struct v2v_volume;

/** Open a volume to read: HDF5 `/volume` [z,y,x] or [t,z,y,x], or a TIFF stack: of its channels
 *  the one that `settings` name; its slices and frames where it states both, else settings->slices,
 *  which must divide the pages, else all pages are slices of one frame, unless this program wrote
 *  frames of one slice. Integers are read in the step that the file states (V2V_VOLUME_STEP, in
 *  HDF5 with an offset, `add_offset`), or by ImageJ's calibration of a TIFF, else as fractions of
 *  their type's maximum.
 *  A frame that `/done` doesn't mark, or whose `/checksum` doesn't hold, is refused when it is
 *  read.
 *  @kind Collective(comm). @param settings NULL: as the file says
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY; agreed */
enum v2v_status v2v_volume_open(struct v2v_volume **volume, const char *path,
                                const struct v2v_input_settings *settings,
                                const struct v2v_comm *comm) V2V_MUST_CHECK;
/** @kind Local. @return lent until it is closed */
const struct v2v_volume_info *v2v_volume_info(const struct v2v_volume *volume);

/** Can frame t be there? 0: it is marked as not done. @kind Local. */
int v2v_volume_has(const struct v2v_volume *volume, int64_t t);

/** From now on the volume is its frames first .. first+count-1, or fewer where it ends before.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (no frame `first`) */
enum v2v_status v2v_volume_cut(struct v2v_volume *volume, int64_t first,
                               int64_t count) V2V_MUST_CHECK;

/** Slices first .. first+count-1 of frame t. @kind Local. @param out [count,y,x]
 *  @return V2V_OK | V2V_E_INPUT (NaN or Inf: frame, slice, pixel; unfinished or damaged: frame)
 *  @cost a frame with a checksum is read as a whole before any of it is */
enum v2v_status v2v_volume_read(struct v2v_volume *volume, float *out, int64_t t, int64_t first,
                                int64_t count) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_volume_close(struct v2v_volume **volume);

/** Which datasets a written file has beside `/volume`. */
enum { V2V_VOLUME_MEAN = 0, V2V_VOLUME_BRANCH1, V2V_VOLUME_BRANCH2, V2V_VOLUME_UNCERTAINTY };

/** One attribute of provenance: text when `text` is not NULL, else the number. */
struct v2v_attribute {
    const char *name;
    const char *text;
    double number;
};

/** A volume to write. `.h5` / `.hdf5`: HDF5 float32 [t,z,y,x], chunk = one slice, `/done` [t],
 * attrs;
 *  `.tif` / `.tiff`: ImageJ hyperstack (rank 0 gathers and holds frames that come before their turn
 *  in memory; mean volume only; of the attributes those of the task and of where frames come
 *  from; a missing frame fails v2v_volume_finish). Where
 *  info->storage asks for integers or compression, frames are first written as HDF5 float32,
 *  whatever the name, and v2v_volume_finish makes the file of that: only then all ranks' frames,
 *  and their largest voxel, are known, and ranks keep their own pace until then. `datasets`
 * is a bit mask of 1 << V2V_VOLUME_... ; it appears under `path` at v2v_volume_finish.
 *  @kind   Collective(comm)
 *  @return V2V_OK | V2V_E_USAGE (other file type; what a TIFF cannot hold) | V2V_E_INPUT (a name
 *          too long; slices too large to be compressed) | V2V_E_BUSY (another run writes it) |
 *          V2V_E_IO | V2V_E_MEMORY; agreed */
struct v2v_volume_writer;
enum v2v_status v2v_volume_create(struct v2v_volume_writer **writer, const char *path,
                                  const struct v2v_volume_info *info, unsigned datasets,
                                  const struct v2v_attribute *attributes, int64_t attribute_count,
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;

/** The attribute that makes an HDF5 volume one that can be gone on with: text that differs whenever
 *  anything differs that the voxels depend on. Such a file has `/checksum` [t] beside `/done`. */
#define V2V_VOLUME_TASK "task"

/** As v2v_volume_create, with what an interrupted run of the same task left under the temporary
 *  name: frames that are marked there and whose checksum holds are done. All are to do when there
 * is no such file, and in a TIFF. @kind Collective(comm). @return as v2v_volume_create */
enum v2v_status v2v_volume_resume(struct v2v_volume_writer **writer, const char *path,
                                  const struct v2v_volume_info *info, unsigned datasets,
                                  const struct v2v_attribute *attributes, int64_t attribute_count,
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;

/** What an interrupted run left of an HDF5 volume under its temporary name. */
struct v2v_volume_left {
    int64_t done, frames; /**< 0 where nothing is there, or no volume that was begun */
    int is_same;          /**< of this task */
};

/** @kind Local. @param task as the attribute; may be NULL
 *  @return V2V_OK | V2V_E_IO (it exists, but cannot be read now) | V2V_E_MEMORY */
enum v2v_status v2v_volume_left(struct v2v_volume_left *left, const char *path,
                                const char *task) V2V_MUST_CHECK;

/** Is the file at `path` this volume, complete and of this task, and do all its checksums hold?
 *  @kind Collective(comm). @return V2V_OK | V2V_E_INPUT (what differs, which frame is damaged) |
 *  V2V_E_MEMORY; agreed. @cost reads the file once, shared by the ranks; TIFF: rank 0 alone */
enum v2v_status v2v_volume_check(const char *path, const struct v2v_volume_info *info,
                                 unsigned datasets, const struct v2v_attribute *attributes,
                                 int64_t attribute_count,
                                 const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Was frame t done when the file was gone on with? @kind Local. */
int v2v_volume_is_done(const struct v2v_volume_writer *writer, int64_t t);

/** Write slices first .. first+count-1 of frame t of one dataset; count may be 0; ranks may differ
 * in t, first, count and data, not in dataset. @kind Collective(comm). @return agreed */
enum v2v_status v2v_volume_write(struct v2v_volume_writer *writer, int dataset, const float *slices,
                                 int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;

/** As v2v_volume_write, for ranks that need not keep step. @kind HDF5: Local, the status is this
 *  rank's own; TIFF: Collective(comm), agreed. After a failure the file can only be suspended or
 *  abandoned; where a TIFF's other ranks come again, a rank takes part with count = 0. */
enum v2v_status v2v_volume_put(struct v2v_volume_writer *writer, int dataset, const float *slices,
                               int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;

/** Whether v2v_volume_put is collective. @kind Local. */
int v2v_volume_keeps_step(const struct v2v_volume_writer *writer);

/** Frame t, which the ranks of `writers` wrote and nobody else (NULL: this one alone), is done: its
 *  data go to the disk, then it is marked. A file that is finished without any call of this has all
 *  its frames marked: who writes frames that may stay missing marks them.
 *  @kind Collective(writers). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; agreed
 *  by them */
enum v2v_status v2v_volume_mark_done(struct v2v_volume_writer *writer, int64_t t,
                                     const struct v2v_comm *writers) V2V_MUST_CHECK;

/** As v2v_volume_put and v2v_volume_mark_done, while the caller goes on with the next frame: a
 *  thread writes the data to the disk and then the mark. `slices` are lent until v2v_volume_wait.
 *  What went wrong is told by the next of these calls, of v2v_volume_wait or of v2v_volume_finish.
 *  At once all the same: a TIFF, and a frame that several ranks wrote.
 *  @kind as those. @return likewise */
enum v2v_status v2v_volume_put_later(struct v2v_volume_writer *writer, int dataset,
                                     const float *slices, int64_t t, int64_t first,
                                     int64_t count) V2V_MUST_CHECK;
enum v2v_status v2v_volume_mark_later(struct v2v_volume_writer *writer, int64_t t,
                                      const struct v2v_comm *writers) V2V_MUST_CHECK;
/** Until the thread is done: nothing is lent any more. @kind Local. @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_volume_wait(struct v2v_volume_writer *writer) V2V_MUST_CHECK;
/** Write what is left and give the file its name; the writer is gone, whatever happens. After a
 *  failure a file that has a task and done frames is left for v2v_volume_resume, another is
 *  dropped. @kind Collective(comm). @return V2V_OK | V2V_E_IO | V2V_E_INPUT (what was gone on with
 *  holds other numbers than were written to it) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_volume_finish(struct v2v_volume_writer **writer) V2V_MUST_CHECK;
/** Close an unfinished file and leave it for v2v_volume_resume, when it has a task and done frames;
 *  else drop it. Accepts NULL. @kind Collective(comm) */
void v2v_volume_suspend(struct v2v_volume_writer **writer);
/** Drop an unfinished file; accepts NULL. @kind Collective(comm) */
void v2v_volume_abandon(struct v2v_volume_writer **writer);

#ifdef __cplusplus
}
#endif

#endif
