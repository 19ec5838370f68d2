/** What `calibrate` knows so far, and its look at the views: each predicted from a volume of
 *  others, over a part of the frame or all of it. REFERENCE.md 13. */
#ifndef V2V_METHOD_CALIBRATOR_H
#define V2V_METHOD_CALIBRATOR_H

#include "method/registration.h"
#include "method/square.h"
#include "v2v3d/base/log.h"
#include "v2v3d/method/calibrate.h"
#include "v2v3d/method/left_out.h"

/** Where and how views are predicted. */
struct v2v_look {
    int64_t side;   /**< of the square that varies most, pixels with its margin; 0: the frame */
    int smoothing;  /**< pixels; of method/registration.h */
    int iterations; /**< of total variation */
    int64_t folds;  /**< at most; every view is left out of one */
    unsigned terms; /**< of method/registration.h, beside shifts: what equations are of */
};

struct v2v_calibrator {
    const struct v2v_problem *problem;
    const struct v2v_comm *comm;
    const float *views; /**< [v,y,x] of the frame */
    int64_t count;      /**< of views */
    struct v2v_config config;
    struct v2v_calibration *calibration;
    struct v2v_registration *registration; /**< [v] of the last look */
    struct v2v_square frame, busiest;      /**< all of it; its judged square */
    double missed, missed_in_square; /**< of the length of what is there, by the last look; the
                                        latter where the look is at all of the frame */

    struct v2v_square place;       /**< looked at .. */
    int64_t side;                  /**< .. as a look has it; -1: none yet */
    int64_t height, width, pixels; /**< of the place */
    struct v2v_part rows, columns; /**< of the place, judged: all but its margin */
    struct v2v_psf_file psf;       /**< as calibrated so far */
    float *recorded, *undistorted; /**< [v,place]; without shading and distortion */
    float *volume, *deep;          /**< [slices of this rank,place]; the latter weighted by depth */
    float *predicted[2];           /**< [v,place] of either; room for the frame */
    float *scratch;                /**< [place] */
    struct v2v_registration_images images;

    struct v2v_progress progress;
    double done; /**< iterations, of the whole frame */
};

/** @kind Collective(comm). @param calibrator problem, comm, views, calibration are set
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_calibrator_init(struct v2v_calibrator *calibrator) V2V_MUST_CHECK;
void v2v_calibrator_fini(struct v2v_calibrator *calibrator);

/** The square of this side that varies most, with its margin, or the frame. @kind Local. */
void v2v_calibrator_go(struct v2v_calibrator *calibrator, int64_t side);

/** PSFs and views of the place as the calibration has them so far. @kind Collective(comm).
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_calibrator_apply(struct v2v_calibrator *calibrator) V2V_MUST_CHECK;

/** Volumes of some of these views, as calibrated so far. @kind Collective(comm).
 *  @return as v2v_left_out_create */
enum v2v_status v2v_calibrator_leave_out(struct v2v_calibrator *calibrator,
                                         struct v2v_left_out **left_out,
                                         struct v2v_left_out_views without,
                                         int iterations) V2V_MUST_CHECK;

/** What `missed` is, and the equations that the next step solves. @kind Collective(comm).
 *  @return V2V_OK | V2V_E_MEMORY | V2V_STOPPED | V2V_E_NUMERIC; agreed */
enum v2v_status v2v_calibrator_look(struct v2v_calibrator *calibrator,
                                    const struct v2v_look *look) V2V_MUST_CHECK;

/** A look's place, of the frame's pixels; its iterations, of the whole frame. @kind Local. */
double v2v_calibrator_share(const struct v2v_calibrator *calibrator, int64_t side);
double v2v_calibrator_cost(const struct v2v_calibrator *calibrator, const struct v2v_look *look);

/** So many iterations at this place are done. @kind Local. */
void v2v_calibrator_step(struct v2v_calibrator *calibrator, int iterations);

#endif
