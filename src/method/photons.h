/** Noise of photons in the views of a frame, which grows with the light. */
#ifndef METHOD_PHOTONS_H
#define METHOD_PHOTONS_H

#include <stdint.h>

struct v2v_photons {
    double bright;   /**< 99.9th percentile of the views: few samples may be anything */
    double gain;     /**< the variance is gain * level + variance, in the views' units .. */
    double variance; /**< .. 0 at least */
    int is_clear; /**< bool: the noise is white, where it is bright of photons above all, and there
                          are samples enough to tell */
};

/** @kind Local. @param views [v,height,width], finite @param scratch as large
 *  @source REFERENCE.md 10 */
struct v2v_photons v2v_photons_find(float *scratch, const float *views, int64_t count,
                                    int64_t height, int64_t width);

#endif
