/** Noise of photons in the views of a frame, which grows with the light. */
#ifndef METHOD_PHOTONS_H
#define METHOD_PHOTONS_H

#include "v2v3d/method/estimator.h"
#include <stdint.h>

/** Of the variance in the light, the least that counts: photons may be all the noise there is, and
 *  what has none would have no noise. */
#define V2V_PHOTONS_LEAST_VARIANCE 0.01

struct v2v_photons {
    double bright;   /**< 99.9th percentile of the views: few samples may be anything */
    double gain;     /**< the variance is gain * level + variance, in the views' units .. */
    double variance; /**< .. 0 at least */
    int is_clear; /**< bool: the noise is white, where it is bright of photons above all, and there
                          are samples enough to tell; or the camera is known */
};

/** What the configuration says of the camera, in counts. */
struct v2v_camera {
    double gain;     /**< counts an electron; 0: not known */
    double variance; /**< of the read noise; < 0: not known */
};

/** @kind Local. */
struct v2v_camera v2v_camera_of(const struct v2v_config *config);

/** Read noise without a gain, or a camera where frames are averaged or noise is no photons', cannot
 *  be meant.
 *  @kind Local. @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_camera_check(const struct v2v_problem *problem) V2V_MUST_CHECK;

/** What is bright there, alone.
 *  @kind Local. @param views [samples], finite @param scratch as large */
double v2v_photons_bright(float *scratch, const float *views, int64_t samples);

/** @kind Local. @param views [v,height,width], finite @param scratch as large
 *  @param camera NULL: not known @source REFERENCE.md 10 */
struct v2v_photons v2v_photons_find(float *scratch, const float *views, int64_t count,
                                    int64_t height, int64_t width, const struct v2v_camera *camera);

/** The noise of one frame of views that are means of several.
 *  @kind Local. @param scratch as large as views */
struct v2v_photons v2v_photons_averaged(float *scratch, const float *views, int64_t samples,
                                        const struct v2v_averaging *averaging);

/** deconv.noise, where it is auto, as the views [v,y,x] of a whole frame show; logs which.
 *  @kind Local. @param averaging of views; may be NULL @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_photons_settle(struct v2v_config *config, const struct v2v_problem *problem,
                                   const float *views,
                                   const struct v2v_averaging *averaging) V2V_MUST_CHECK;

#endif
