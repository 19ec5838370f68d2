#ifndef V2V3D_SRC_OPTICS_TILTS_H
#define V2V3D_SRC_OPTICS_TILTS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <stdint.h>

/** Spatial frequencies of the views' carriers. */
struct v2v_tilts {
    int64_t views;
    double (*at)[2]; /**< [views] of y, x, 1/um; owned */
};

/** From the settings' list, or else one on axis, then ring by ring: the outermost sub-aperture
 *  touches the pupil's edge.
 *  @kind Local. @return V2V_OK | V2V_E_CONFIG (the list's first piece that is not a pair within the
 *  pupil) | V2V_E_MEMORY */
enum v2v_status v2v_tilts_init(struct v2v_tilts *tilts,
                               const struct v2v_optics_settings *settings) V2V_MUST_CHECK;
void v2v_tilts_fini(struct v2v_tilts *tilts);

/** The settings' list of them. @kind Local. @return V2V_OK | V2V_E_CONFIG: too long a list */
enum v2v_status v2v_tilts_print(struct v2v_optics_settings *settings,
                                const struct v2v_tilts *tilts) V2V_MUST_CHECK;

#endif
