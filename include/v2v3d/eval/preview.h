#ifndef V2V3D_EVAL_PREVIEW_H
#define V2V3D_EVAL_PREVIEW_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/png.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Maximum projections along z (top left), x (right of it) and y (below) in one picture, depth
 * drawn `z_zoom` pixels a slice, grey from `low` to `high` (both 0: 0 to the 99.9th percentile of
 * the projection along z).
 *  @kind Local. @param volume [z,y,x]. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_preview_volume(struct v2v_canvas *canvas, const float *volume, int64_t slices,
                                   int64_t height, int64_t width, int z_zoom, double low,
                                   double high) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
