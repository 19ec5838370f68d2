#ifndef V2V3D_METHOD_CALIBRATE_H
#define V2V3D_METHOD_CALIBRATE_H

#include "v2v3d/conf/calibration.h"
#include "v2v3d/method/estimator.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What was found, and what it is worth: how far the views left out are missed, of their length,
 *  by the volumes of the others. */
struct v2v_calibration_report {
    double heldout_before, heldout_after; /**< over the square of the frame that varies most */
    double frame_before, frame_after;     /**< over the frame but for its margin */
    struct v2v_part square_rows, square_columns;
    double weight; /**< of the total variation, in noise of the views */
    int64_t rounds;
    int has_slopes, has_fields; /**< bools: did they lower the residual by enough to be kept? */
    int is_gains_alone;         /**< bool: shifts lowered it by no more than noise does */
    int is_in_vain;             /**< bool: nothing did, and the views stay as they came */
    int64_t odd_view;           /**< that the others predict much worse than most; -1: none */
};

/** Shift, gain, slope with depth, shading and distortion of every view, by predicting views from
 *  volumes of the others: a third of the views at a time (one, of six or fewer) is left out, until
 *  every one was; each is compared with its prediction and moved by linear least squares. From
 *  coarse detail and a part of the frame to fine and more of it. Slopes, then shading and
 *  distortion, the latter by the whole frame, to the third degree and then to the tenth, are kept
 *  where they lower the residual by 3 % (the tenth degree: 1 %). At the end gains and shifts are
 *  found by the volume of all views, less its bias. The report is of the whole frame, two views at
 *  a time left out, before and after; where noise alone could lower it as much, shifts, and then
 *  gains, stay as they came.
 *  What views cannot tell stays as it was: what all of them share, and what moves, stretches or
 *  bends the volume in depth.
 *  @kind   Collective(comm); any number of ranks finds the same to the bit
 *  @param  problem   config, psf, height, width
 *  @param  views     [v,height,width] less their offset, the same on all ranks; blind samples
 *          (tensor/blind.h) count for nothing
 *  @return V2V_OK | V2V_E_INPUT (fewer than three views, a dark frame) | V2V_E_CONFIG |
 *          V2V_E_MEMORY | V2V_STOPPED | V2V_E_NUMERIC; agreed
 *  @cost   of deconvolve's frames without other options: 30 to 50; tells how far it is
 *  @source REFERENCE.md 13 */
enum v2v_status v2v_calibrate(struct v2v_calibration *calibration,
                              struct v2v_calibration_report *report,
                              const struct v2v_problem *problem, const float *views,
                              const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
