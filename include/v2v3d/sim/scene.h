/** Scenes and recordings made of numbers.
 *
 *  Purpose: fluorescent scenes, their noisy recordings, data sets of them.
 *  Invariants: everything depends on the seed and the sample's place alone, never on the rank.
 *
 *  Example (compiled by tests/unit/sim):
 *
 *      struct v2v_scene scene = {.slices = 8, .height = 64, .width = 64, .slice_um = 1,
 *                                .pixel_um = 1, .seed = seed};
 *      struct v2v_noise noise;
 *      V2V_TRY(v2v_scene_find(&scene.kind, "neurons"));
 *      v2v_scene_draw(volume, &scene, 0, 0, scene.slices);
 *      V2V_TRY(v2v_noise_parse(&noise, "gaussian:0.2"));
 *      V2V_TRY(v2v_noise_level(&noise, views, count));
 *      v2v_noise_apply(noisy, views, count, &noise, seed, 0, 0);
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

/** How far a structure of a moving scene gets from where it began, to either side. */
#define V2V_SCENE_RANGE_UM 10.0

struct v2v_scene {
    int kind; /**< v2v_scene_find */
    int64_t slices, height, width;
    double slice_um, pixel_um; /**< of a voxel, > 0 */
    double motion_um;          /**< way of every structure from frame to frame; 0: a still scene */
    uint64_t seed;
};

/** @kind Local. @return V2V_OK | V2V_E_USAGE (names the kinds) */
enum v2v_status v2v_scene_find(int *kind, const char *name) V2V_MUST_CHECK;

/** The kinds in order. @kind Local. @return NULL: there are no more */
const char *v2v_scene_name(int kind);

/** Can it be drawn? @kind Local. @return V2V_OK | V2V_E_USAGE (more than 100,000 structures) */
enum v2v_status v2v_scene_check(const struct v2v_scene *scene) V2V_MUST_CHECK;

/** Slices first .. first+count-1 of frame t, in [0,1]. Numbers of structures go with the scene's
 *  volume; there is at least one of each. In a moving scene each structure goes its own straight
 *  way, turning back at V2V_SCENE_RANGE_UM.
 *  @kind Local. @param volume [count,y,x] out. @cost deterministic, whatever the threads */
void v2v_scene_draw(float *volume, const struct v2v_scene *scene, int64_t t, int64_t first,
                    int64_t count);

#ifdef __cplusplus
}
#endif

#endif
