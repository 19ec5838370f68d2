#ifndef V2V3D_IO_RECORDING_H
#define V2V3D_IO_RECORDING_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/calibration.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_recording_info {
    int64_t frames, height, width;
    int64_t views;         /**< of a frame, without those of settings->without_views */
    int64_t before, after; /**< frames that a cut left out on either side */
    int64_t apart; /**< of one that is read: frames that share no page lie so many apart: 1, more
                        in a sliding window */
    double pixel_size_um, frame_interval_s; /**< 0: not stated */
    double offset;                          /**< counts at no light; NaN: not stated */
    int is_uint16;  /**< of one to write: whole numbers 0 .. 65535; of one that is read: 0 */
    int is_one_row; /**< of one that is read: nothing tells a frame's views, all pages are one's */
};

struct v2v_recording;

/** Open a recording: HDF5 `/views` [v,y,x] or [t,v,y,x] (integers, float32, float64), or a TIFF
 *  stack of `settings->views` pages a frame. Those of settings->without_views are not read. A
 *  hyperstack that states channels, or slices and frames, has its views there: in the channels, or
 *  in the slices of settings->channel. With a
 *  stride below the view count (a sliding window), page p of the stack still is view (p -
 *  first_view) mod views; with one above it, pages between frames are none of any. An HDF5 file
 *  is first looked at in a child process of rank 0 with a limit of time and memory. With
 *  settings->views = 0 the file decides, and all pages of a TIFF that says nothing are one frame;
 *  those that this program wrote as frames alone are frames of one view.
 *  @kind   Collective(comm)
 *  @return V2V_OK | V2V_E_INPUT (file, dataset or page, reason; pages that make no whole frame;
 *          no frame; another view count than asked for, or channels of which none is chosen;
 *          frames never written) | V2V_E_CONFIG (settings->without_views) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_recording_open(struct v2v_recording **recording, const char *path,
                                   const struct v2v_input_settings *settings,
                                   const struct v2v_comm *comm) V2V_MUST_CHECK;
const struct v2v_recording_info *v2v_recording_info(const struct v2v_recording *recording);
/** Its file's name, for messages. @kind Local. @return lent until it is closed */
const char *v2v_recording_path(const struct v2v_recording *recording);

/** Is there a frame t? @kind Local. @return V2V_OK | V2V_E_INPUT (no, and how many there are) */
enum v2v_status v2v_recording_has_frame(const struct v2v_recording *recording,
                                        int64_t t) V2V_MUST_CHECK;

/** From now on the recording is its frames first .. first+count-1, or fewer where it ends before.
 *  Those left out can still be read, as frames -before .. -1 and frames .. frames+after-1.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (no frame `first`) */
enum v2v_status v2v_recording_cut(struct v2v_recording *recording, int64_t first,
                                  int64_t count) V2V_MUST_CHECK;

/** From now on frames are read without the distortion that `calibration` says they have, and
 *  v2v_scaling_decide takes its shading over. Gains, shifts and slopes are the PSFs'
 *  (optics/calibration.h). @kind Local. @param calibration borrowed
 *  @return V2V_OK | V2V_E_INPUT (of another number of views; of frames of another size, where it
 *  has distortion or shading) | V2V_E_MEMORY */
enum v2v_status v2v_recording_calibrate(struct v2v_recording *recording,
                                        const struct v2v_calibration *calibration) V2V_MUST_CHECK;
/** That one; NULL: none. @kind Local. */
const struct v2v_calibration *v2v_recording_calibration(const struct v2v_recording *recording);

/** From now on hot and cold pixels are mended as frames are read (v2v_hot_pixels_mend); the first
 *  frame that has some is told. @kind Local. @param sharpness of the PSFs (v2v_psf_sharpness)
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_recording_mend(struct v2v_recording *recording,
                                   double sharpness) V2V_MUST_CHECK;

/** Frame t as float32 in the file's own units, views in order.
 *  @kind Local (ranks read different frames at their own pace). @param views [v,y,x]
 *  @return V2V_OK | V2V_E_INPUT (NaN or Inf: frame, view, pixel; unreadable data) */
enum v2v_status v2v_recording_read(struct v2v_recording *recording, float *views,
                                   int64_t t) V2V_MUST_CHECK;
/** The same, and which samples see nothing (v2v_blind_find), found before distortion is undone and
 *  moved with it. @kind Local. @param marks [v,y,x] out: 1 or 0; NULL: not asked for
 *  @param zero counts without light @param blind out: how many; 0 where they aren't asked for */
enum v2v_status v2v_recording_read_marked(struct v2v_recording *recording, float *views,
                                          uint8_t *marks, double zero, int64_t *blind,
                                          int64_t t) V2V_MUST_CHECK;

/** The same, and samples that see nothing are V2V_BLIND. @kind Local.
 *  @param blind out: how many; NULL: not asked for @return as v2v_recording_read | V2V_E_MEMORY */
enum v2v_status v2v_recording_read_seen(struct v2v_recording *recording, float *views, double zero,
                                        int64_t *blind, int64_t t) V2V_MUST_CHECK;

/** The same with the distortion that a calibration says they have. @kind Local. */
enum v2v_status v2v_recording_read_distorted(struct v2v_recording *recording, float *views,
                                             double zero, int64_t *blind, int64_t t) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_recording_close(struct v2v_recording **recording);

/** A recording to write: `/views` [t,v,y,x] float32 (or uint16, as info says), chunk = one view of
 *  one frame, attrs as in src/io/README.md; appears under `path` at v2v_recording_finish.
 *  @kind   Collective(comm)
 *  @return V2V_OK | V2V_E_USAGE (a name of another kind of file, as .tif) | V2V_E_INPUT (a name too
 *          long) | V2V_E_BUSY (another run writes it) | V2V_E_IO | V2V_E_MEMORY; agreed */
struct v2v_recording_writer;
enum v2v_status v2v_recording_create(struct v2v_recording_writer **writer, const char *path,
                                     const struct v2v_recording_info *info,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Write frame t's views first .. first+count-1; count may be 0, ranks may differ in all arguments.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; agreed; likewise _finish */
enum v2v_status v2v_recording_write(struct v2v_recording_writer *writer, const float *views,
                                    int64_t t, int64_t first, int64_t count) V2V_MUST_CHECK;
enum v2v_status v2v_recording_finish(struct v2v_recording_writer **writer) V2V_MUST_CHECK;
/** Drop an unfinished file; accepts NULL. @kind Collective(comm) */
void v2v_recording_abandon(struct v2v_recording_writer **writer);

#ifdef __cplusplus
}
#endif

#endif
