/** Pictures of a volume beside its projections. */
#ifndef V2V_EVAL_PREVIEW_KINDS_H
#define V2V_EVAL_PREVIEW_KINDS_H

#include "v2v3d/eval/preview.h"

/** As v2v_preview_draw, with a range that is settled. @kind Local. */
enum v2v_status v2v_preview_montage(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                    const float *volume) V2V_MUST_CHECK;
enum v2v_status v2v_preview_depth(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                  const float *volume) V2V_MUST_CHECK;

#endif
