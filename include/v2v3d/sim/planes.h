#ifndef V2V3D_SIM_PLANES_H
#define V2V3D_SIM_PLANES_H

#include "v2v3d/conf/cameras.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The kind of scene that has views, but no volume. */
#define V2V_SCENE_PLANES "planes"

/** Textured planes in perspective: rectangles and discs, turned and slanted, before a background;
 *  nearer ones hide farther ones. Of a plane in space the disparity is linear over the image. */
struct v2v_planes {
    const struct v2v_cameras *cameras; /**< borrowed */
    double nearest, farthest;          /**< disparities, pixels a unit of baseline */
    int64_t height, width;
    uint64_t seed;
};

/** @kind Local, the same bits on any rank. @param view [y,x] out: of camera v, 0 and more
 *  @cost some 25 cosines a pixel; no allocation @source REFERENCE.md 18 */
void v2v_planes_draw(float *view, const struct v2v_planes *planes, int64_t v);

#ifdef __cplusplus
}
#endif

#endif
