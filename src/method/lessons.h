/** Frames of which the volume is known, made of a recording: what a network that corrects volumes
 *  is taught by.
 *
 *  Purpose: the volume of a frame by total variation, mirrored, is projected through the optics and
 *  made as noisy as the frame was; what total variation and the data step make of these views are
 *  the features, the mirrored volume is what the network should make of them. No truth is needed,
 *  and all views are used.
 *  Invariants: the same bits for the same (frame, number, train.seed) on any rank; divided by the
 *  error of total variation, so that recordings of any brightness teach the same.
 *  @source REFERENCE.md 14 */
#ifndef METHOD_LESSONS_H
#define METHOD_LESSONS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include <stdint.h>

struct v2v_lessons;

/** Images of a lesson: features and volume, of so many slices. @kind Local. */
int64_t v2v_lessons_images(int64_t slices);

/** @kind Local. @param config, psf borrowed @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_lessons_create(struct v2v_lessons **lessons, const struct v2v_config *config,
                                   const struct v2v_psf_file *psf) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_lessons_destroy(struct v2v_lessons **lessons);

/** Lesson `number` from frame t: features [feature,z,y,x] and the volume [z,y,x] behind them.
 *  @kind   Local; plans anew for frames of another size
 *  @param  images [v2v_lessons_images,y,x] out
 *  @return V2V_OK | V2V_STOPPED | V2V_E_INPUT (reading) | V2V_E_NUMERIC | V2V_E_CONFIG |
 *          V2V_E_MEMORY
 *  @cost   two volumes by total variation */
enum v2v_status v2v_lessons_make(struct v2v_lessons *lessons, float *images,
                                 struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                 int64_t t, int64_t number) V2V_MUST_CHECK;

#endif
