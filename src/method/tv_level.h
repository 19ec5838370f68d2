/** Brightness and noise of a frame's views, as total variation takes them. */
#ifndef METHOD_TV_LEVEL_H
#define METHOD_TV_LEVEL_H

#include "method/photons.h"

/** All 0: a dark frame. */
struct v2v_tv_level {
    double brightness; /**< of the views */
    double deepest;    /**< of their negative samples, over it */
    double sigma;      /**< of their noise; of photons: where they are that bright */
    double gain;  /**< its variance over the light, both in units of sigma; 0: the same for all */
    double floor; /**< the variance where there is no light, likewise, as weights take it .. */
    double dark;  /**< .. and as found, its root, in units of the views */
    double mean_variance; /**< of all samples, in units of sigma^2 */
    double frames; /**< of views that are means of frames: all this is of samples of so many; 0:
                        views of one frame */
};

/** Views, and what is known of their noise. */
struct v2v_tv_views {
    const float *views; /**< [count,height,width], finite */
    int64_t count, height, width;
    const struct v2v_averaging *averaging; /**< NULL: of one frame each */
    enum v2v_noise_model model;
    const struct v2v_camera *camera;
};

/** The same with any number of threads. @kind Local. @param scratch as large as the views
 *  @source REFERENCE.md 10 */
struct v2v_tv_level v2v_tv_level_of(const struct v2v_tv_views *views, float *scratch);

#endif
