/** Going on with the HDF5 file that an interrupted run left under its temporary name.
 *
 *  The file's structure never changes once rank 0 has created it (all space is taken at once), so a
 *  crash can only leave frames unwritten. A frame counts as done when its mark in `/done` and its
 *  checksum in `/checksum` both hold: whatever reached the disk, and in whatever order, a frame
 *  with wrong data is none.
 */
#ifndef V2V_IO_H5_RESUME_H
#define V2V_IO_H5_RESUME_H

#include "io/h5_writer.h"
#include "v2v3d/io/volume.h"

/** Which frames of a file are good, and is it what the plan says, of its task and shape?
 *  @kind Collective(comm). @param done [t], 1 where a frame is good
 *  @return V2V_OK | V2V_E_INPUT (it is not, or is damaged: the reason) | V2V_E_IO (it cannot be
 *  read now) | V2V_E_MEMORY; agreed.
 *  @cost reads every marked frame once, shared by the ranks */
enum v2v_status v2v_h5_good_frames(uint8_t *done, const char *path, const struct v2v_h5_plan *plan,
                                   const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Do the checksums of all frames of a file that was gone on with hold? Where its structure is
 *  damaged frames may lie in one another's place.
 *  @kind Collective(comm). @param dataset as the plan's
 *  @return V2V_OK | V2V_E_INPUT (names the first that doesn't) | V2V_E_IO | V2V_E_MEMORY; agreed
 *  @cost reads the file once, shared by the ranks */
enum v2v_status v2v_h5_check_written(const char *path, const char *const *dataset, int64_t frames,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Is there a file under the temporary name that the plan can go on with, and which of its frames
 *  are good? One of another task or shape, or a damaged one, is reported and not taken.
 *  @kind Collective(comm). @param done [t], 1 where a frame is good; untouched when not *found
 *  @return V2V_OK | V2V_E_IO (it cannot be read now) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_h5_resume(int *found, uint8_t *done, const char *temporary,
                              const struct v2v_h5_plan *plan,
                              const struct v2v_comm *comm) V2V_MUST_CHECK;

/** What an interrupted run left under a temporary name: how many frames it had done of how many,
 *  and is it of this task (which may be NULL: of none)? All 0 where nothing is there, or no volume
 *  that was begun; the record of an earlier failure stays then.
 *  @kind Local. @return V2V_OK | V2V_E_IO (it exists, but cannot be read now) | V2V_E_MEMORY */
enum v2v_status v2v_h5_left(struct v2v_volume_left *left, const char *temporary,
                            const char *task) V2V_MUST_CHECK;

#endif
