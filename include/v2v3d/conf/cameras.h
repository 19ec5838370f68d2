#ifndef V2V3D_CONF_CAMERAS_H
#define V2V3D_CONF_CAMERAS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Where the cameras of views stand, all of which look the same way. */
struct v2v_cameras {
    int64_t views;
    double (*at)[2]; /**< [views] of y, x, units of baseline; owned */
};

/** From synthesis.cameras, or a grid about 0, row by row, of ceil(sqrt(views)) columns a unit
 *  apart. @kind Local. @param views 0: as many as the list has, else 9
 *  @return V2V_OK | V2V_E_CONFIG (no list of pairs, or of another number) | V2V_E_MEMORY */
enum v2v_status v2v_cameras_init(struct v2v_cameras *cameras,
                                 const struct v2v_synthesis_settings *settings,
                                 int64_t views) V2V_MUST_CHECK;
/** @kind Local. Accepts a zeroed one. */
void v2v_cameras_fini(struct v2v_cameras *cameras);

#ifdef __cplusplus
}
#endif

#endif
