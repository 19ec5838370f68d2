#ifndef V2V3D_EVAL_PREVIEW_H
#define V2V3D_EVAL_PREVIEW_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/png.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum v2v_preview_kind { V2V_PREVIEW_PROJECTIONS = 0, V2V_PREVIEW_MONTAGE, V2V_PREVIEW_DEPTH };

/** What to draw of a volume. */
struct v2v_preview {
    enum v2v_preview_kind kind;
    int64_t slices, height, width;
    int z_zoom;
    double low, high;        /**< grey from .. to; NaN: not settled */
    double slice_spacing_um; /**< 0: not known */
};

/** Settle a range that isn't: low at 0, high at least at the 99.9th percentile of the volume's
 *  projection along z, or where that isn't above low at its maximum. After all volumes of a row one
 *  range for them. @kind Local. @param volume [z,y,x]. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_preview_widen(struct v2v_preview *preview, const float *volume) V2V_MUST_CHECK;

/** A picture in a range that is settled: maximum projections along z (top left), x (right of it)
 *  and y (below), depth drawn `z_zoom` pixels a slice; or slices side by side, 48 at most, evenly
 *  chosen and numbered from 0; or the brightest voxel along z, its depth as a hue of even lightness
 *  (OKLCh), with a bar beside it. @kind Local. @param volume [z,y,x]. @return V2V_OK | V2V_E_MEMORY
 *  @source B. Ottosson, A perceptual color space for image processing, 2020: OKLab */
enum v2v_status v2v_preview_draw(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                 const float *volume) V2V_MUST_CHECK;

/** The hue of slice z, 0xRRGGBB, times a grey level from 0 to 1. @kind Local. */
uint32_t v2v_preview_hue(int64_t z, int64_t slices, double level);

#ifdef __cplusplus
}
#endif

#endif
