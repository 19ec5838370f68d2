#ifndef V2V3D_SRC_OPTICS_BEAM_H
#define V2V3D_SRC_OPTICS_BEAM_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <stdint.h>

/* The field of one sub-aperture, made once for all views: they differ by the tilt of its carrier
 * alone. Frequencies are counted from that carrier where samples are fine enough, since it drops
 * out of the intensity. */
struct v2v_beam;

/** Aberration of the pupil and sub-aperture of `settings`, on the grid that they need.
 *  @kind Local. @return V2V_OK | V2V_E_CONFIG (apertures, a text of aberrations, a shift out of
 *  the PSF, a grid beyond the limit) | V2V_E_MEMORY */
enum v2v_status v2v_beam_create(struct v2v_beam **beam,
                                const struct v2v_optics_settings *settings) V2V_MUST_CHECK;
void v2v_beam_destroy(struct v2v_beam **beam);

/** Working memory of `threads` threads. @kind Local. @return V2V_OK | V2V_E_MEMORY */
struct v2v_beam_scratch;
enum v2v_status v2v_beam_scratch_create(struct v2v_beam_scratch **scratch,
                                        const struct v2v_beam *beam, int threads) V2V_MUST_CHECK;
void v2v_beam_scratch_destroy(struct v2v_beam_scratch **scratch);

/** slice[y,x] = the intensity, to the power of the photons, in slice z.
 *  @kind   Local, thread-safe; the calling OpenMP thread's part of `scratch` is used
 *  @param  slice [size,size]
 *  @param  tilt [y,x] of the carrier, 1/um */
void v2v_beam_slice(float *slice, const struct v2v_beam *beam,
                    const struct v2v_beam_scratch *scratch, const double tilt[2], int64_t z);

#endif
