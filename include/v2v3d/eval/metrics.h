/** How good is a volume?
 *
 *  Purpose: the metrics of REFERENCE.md 6.
 *  Invariants: double precision throughout; nothing is rescaled unless asked for.
 *
 *  Example (compiled by tests/unit/eval):
 *
 *      struct v2v_scores scores;
 *      V2V_TRY(v2v_scores_of(&scores, truth, volume, 39, 256, 256, 0));
 *      printf("%.2f dB, SSIM %.3f\n", scores.psnr, scores.ssim);
 *  done:
 *      return rc;
 */
#ifndef V2V3D_EVAL_METRICS_H
#define V2V3D_EVAL_METRICS_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_scores {
    double psnr, ssim; /**< REFERENCE.md 6; psnr is +inf for equal volumes */
    double background_truth, background_volume;
    double scale; /**< the fitted scale, 1 without */
};

/** PSNR and SSIM of a volume against the truth after crop (10 pixels a side in y, x) and background
 *  subtraction. With `fit_scale` the volume is multiplied by the least-squares scale first (after
 * its background is subtracted).
 *  @kind   Local
 *  @param  truth, volume [z,y,x]
 *  @return V2V_OK | V2V_E_INPUT (smaller than 31 x 31: nothing is left for SSIM's window; NaN or
 *          Inf) | V2V_E_MEMORY
 *  @source REFERENCE.md 6 */
enum v2v_status v2v_scores_of(struct v2v_scores *scores, const float *truth, const float *volume,
                              int64_t slices, int64_t height, int64_t width,
                              int fit_scale) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
