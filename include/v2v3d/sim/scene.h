/** Scenes and recordings made of numbers.
 *
 *  Purpose: fluorescent scenes, their noisy recordings.
 *  Invariants: everything depends on the seed and the sample's place alone, never on the rank.
 *
 *  Example (compiled by tests/unit/sim):
 *
 *      struct v2v_noise noise;
 *      V2V_TRY(v2v_noise_parse(&noise, "gaussian:0.2"));
 *      V2V_TRY(v2v_noise_level(&noise, views, count));
 *      v2v_noise_apply(noisy, views, count, &noise, seed, frame, 0);
 *  done:
 *      return rc;
 */
#ifndef V2V3D_SIM_SCENE_H
#define V2V3D_SIM_SCENE_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A scene of curved fibres and cells in [0,1], background 0, from a seed: what the demo shows.
 *  @kind Local. @param volume [z,y,x] out */
enum v2v_status v2v_scene_fill(float *volume, int64_t slices, int64_t height, int64_t width,
                               uint64_t seed) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
