/** What several commands do in the same way: open inputs that fit the PSFs, guard outputs. */
#ifndef V2V_CLI_STEPS_H
#define V2V_CLI_STEPS_H

#include "cli/command.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/network.h"
#include "v2v3d/par/time.h"
#include "v2v3d/sim/recording.h"

/** Is this the rank that prints? @kind Local */
int v2v_step_on_root(const struct v2v_session *session);

/** The last failure's message. What all ranks found is told as rank 0's: its number, which would
 *  say nothing, is left away. @kind Local */
const char *v2v_step_message(void);

/** Refuse an output that exists or of which an interrupted run finished frames (without --force),
 *  is one of the inputs (NULLs are skipped) or the file of settings, or lies where nothing can be
 *  written. Rank 0 looks. @kind Collective(world), agreed */
enum v2v_status v2v_step_output(const struct v2v_session *session, const char *path,
                                const char *const *inputs, int64_t count) V2V_MUST_CHECK;

/** Likewise where `resume` says that what is there is to be gone on with.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_step_output_or_resume(const struct v2v_session *session, const char *path,
                                          const char *const *inputs, int64_t count,
                                          int resume) V2V_MUST_CHECK;

/** How the views differ from what the PSFs say, for v2v_step_psf and v2v_step_recording; NULL:
 *  they don't. Rank 0 reads. @kind Collective(world), agreed; the session owns it */
enum v2v_status v2v_step_calibration(struct v2v_session *session, const char *path) V2V_MUST_CHECK;

/** PSFs as the configuration normalises them, without input.without_views, calibrated.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_step_psf(const struct v2v_session *session, struct v2v_psf_file *psf,
                             const char *path) V2V_MUST_CHECK;

/** A recording, calibrated, whose view count is that of the PSFs (which TIFF input takes unless
 *  told otherwise; PSFs without views: any), and whose pixel size is, where both state one, to 1 %.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_step_recording(const struct v2v_session *session,
                                   struct v2v_recording **recording, const char *path,
                                   const struct v2v_psf_file *psf) V2V_MUST_CHECK;

/** A volume whose slice count is that of the PSFs. @kind Collective(world), agreed */
enum v2v_status v2v_step_volume(const struct v2v_session *session, struct v2v_volume **volume,
                                const char *path, const struct v2v_psf_file *psf) V2V_MUST_CHECK;

/** The session takes over the network of a weight file; a setting of it that was given otherwise,
 *  on the command line, or in a file where it isn't the default, is warned of.
 *  @kind Local. @param ops info's @param path to be named @return V2V_OK | V2V_E_INPUT |
 *  V2V_E_CONFIG (a value that is too long to be compared) */
enum v2v_status v2v_step_adopt(struct v2v_session *session, const struct v2v_weights_info *info,
                               const struct v2v_network_ops *ops, const char *path) V2V_MUST_CHECK;

/** The network that a weight file is of; the session's configuration takes it over, with a warning
 *  for every setting of it that was given otherwise. @kind Collective(world), agreed
 *  @param of_views bool: it has to make views; else volumes */
enum v2v_status v2v_step_network(struct v2v_session *session, const struct v2v_network_ops **ops,
                                 const char *path, int of_views) V2V_MUST_CHECK;

/** What a weight file says, after it was checked against the PSFs; the session's configuration
 *  takes its network over, likewise. @kind Collective(world), agreed */
enum v2v_status v2v_step_weights_info(struct v2v_session *session, struct v2v_weights_info *info,
                                      const char *path,
                                      const struct v2v_psf_file *psf) V2V_MUST_CHECK;

/** The recording's offset; gain 1: for what does not need a gain.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_step_offset(const struct v2v_session *session, struct v2v_scaling *scaling,
                                struct v2v_recording *recording) V2V_MUST_CHECK;

/** --frames FIRST:COUNT; NULL: all frames. @kind Local. @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_step_frames(struct v2v_part *frames, const char *text) V2V_MUST_CHECK;

/** Log ranks x threads. @kind Local */
void v2v_step_announce(const struct v2v_session *session);

/** Log the part of the time since `began` that the ranks spent on communication.
 *  @kind Collective(world) */
void v2v_step_communication(const struct v2v_session *session, const struct v2v_par_time *began);

/** Frames and voxel size of a volume made from a recording. @kind Local */
struct v2v_volume_info v2v_step_volume_of(const struct v2v_session *session,
                                          const struct v2v_recording_info *recording,
                                          const struct v2v_psf_file *psf);

/** Frame and voxel size of a recording made from a volume. @kind Local */
struct v2v_recording_info v2v_step_recording_of(const struct v2v_volume_info *volume,
                                                const struct v2v_psf_file *psf);

/** Size and voxels of a scene: frames of `size` ("HxW" or "N"; NULL: 512) by the PSFs' slices. The
 *  recording states what --pixel-size and --slice-spacing or the PSFs say; where nothing does,
 *  voxels are drawn as cubes of a micrometre, and nothing is stated.
 *  @kind Local. @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_step_scene(struct v2v_scene *scene, struct v2v_simulation *simulation,
                               const struct v2v_session *session, const struct v2v_psf_file *psf,
                               const char *size) V2V_MUST_CHECK;

/** Write the slices of one frame that each rank holds, and mark the frame as done.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_step_write_slices(const struct v2v_session *session,
                                      struct v2v_volume_writer *writer, const float *slices,
                                      int64_t t, struct v2v_part mine) V2V_MUST_CHECK;

#endif
