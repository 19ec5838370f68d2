#ifndef V2V3D_OPTICS_CARVE_H
#define V2V3D_OPTICS_CARVE_H

#include "v2v3d/base/status.h"
#include "v2v3d/optics/shifts.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Space carving: a place of the volume can hold light only where the views, shifted to its depth,
 *  show some. Its light is the mean over the views without the brightest half, which may owe
 *  theirs to something else; views are smoothed over V2V_CARVE_BOX pixels and are counted from
 * their own background. */
struct v2v_carve;

enum { V2V_CARVE_TILE = 4, V2V_CARVE_BOX = 5 };

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_carve_create(struct v2v_carve **carve, const struct v2v_shifts *shifts,
                                 int64_t height, int64_t width) V2V_MUST_CHECK;
void v2v_carve_destroy(struct v2v_carve **carve);

/** The most light in any slice of every tile of V2V_CARVE_TILE pixels a side, in the views' units;
 *  beyond the frame a view goes on as at its edge.
 *  @kind Local, the same bits for any number of threads.
 *  @param light [ceil(y/4),ceil(x/4)] out @param views [v,y,x]
 *  @return standard deviation that the noise of the views alone gives the light of one place */
double v2v_carve_light(struct v2v_carve *carve, float *light, const float *views);

/** The same of the difference of two frames, which has no background: where light was added.
 *  @kind Local */
double v2v_carve_gain(struct v2v_carve *carve, float *light, const float *difference);

#ifdef __cplusplus
}
#endif

#endif
