/** What the two volumes are judged by.
 *
 *  Purpose: the losses of REFERENCE.md 5, each with its gradient: views of the other half (mean
 *  squared error, Fourier L1), positivity, de-crosstalk, axial smoothness.
 *  Invariants: sums in double precision; nothing is allocated in v2v_loss_evaluate; a term of
 * weight 0 still is computed (it is in the log), its gradient is not.
 *
 *  Example (compiled by tests/unit/loss):
 *
 *      struct v2v_loss_setup setup = {.settings = &config.loss, .psf = &psf, .reduce =
 *                                     V2V_REDUCE_SUM, .height = 128, .width = 128,
 *                                     .window = {16, 112, 16, 112}};
 *      V2V_TRY(v2v_loss_create(&loss, &setup));
 *      v2v_loss_evaluate(loss, terms, 3, dvolume, volume, views);
 *  done:
 *      v2v_loss_destroy(&loss);
 */
#ifndef V2V3D_LOSS_LOSS_H
#define V2V3D_LOSS_LOSS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/optics/psf.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The terms, unweighted and summed over the branches judged, and their weighted sum. */
enum v2v_loss_term {
    V2V_LOSS_MSE,
    V2V_LOSS_FFT,
    V2V_LOSS_POS,
    V2V_LOSS_DC,
    V2V_LOSS_TV,
    V2V_LOSS_TOTAL,
    V2V_LOSS_TERMS
};

/** Rows [y0,y1) and columns [x0,x1) of the views that are compared. */
struct v2v_window {
    int64_t y0, y1, x0, x1;
};

struct v2v_loss_setup {
    const struct v2v_loss_settings *settings;
    const struct v2v_psf_file *psf; /**< used at creation only */
    int reduce;                     /**< enum v2v_reduce of the projection */
    int64_t height, width;          /**< of the volumes and views */
    struct v2v_window window;
};

struct v2v_loss;

/** Stores the OTFs of all views and slices. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_loss_create(struct v2v_loss **loss,
                                const struct v2v_loss_setup *setup) V2V_MUST_CHECK;
void v2v_loss_destroy(struct v2v_loss **loss);

/** Judge the branches in `branches` (bits as V2V_BRANCH_...): branch 1's volume is projected onto
 * the odd views, branch 2's onto the even ones. The terms of the mean volume (de-crosstalk, axial
 *  smoothness) are counted half for each branch judged, so that two ranks' terms sum to one rank's.
 *  @kind   Local, deterministic for a thread count
 *  @param  terms [V2V_LOSS_TERMS] out
 *  @param  dvolume [2]: dL/dvolume[b] [z,y,x], overwritten for the branches judged
 *  @param  volume [2]: both volumes [z,y,x], needed whichever branch is judged
 *  @param  views [v,y,x]
 *  @source REFERENCE.md 5 */
void v2v_loss_evaluate(struct v2v_loss *loss, double *terms, unsigned branches,
                       float *const *dvolume, const float *const *volume, const float *views);

/** The weights that the settings resolve to, in the order of the terms (total: 1). @kind Local. */
void v2v_loss_weights(double *weights, const struct v2v_loss_settings *settings);

#ifdef __cplusplus
}
#endif

#endif
