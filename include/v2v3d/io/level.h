#ifndef V2V3D_IO_LEVEL_H
#define V2V3D_IO_LEVEL_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** The mean of a frame is known far better than this part of its noise; one whose light is less is
 *  noise, and not to be brought up to the level of light (REFERENCE.md 1). */
#define V2V_LEVEL_LEAST_MEAN 0.1

/** How bright and noisy a frame is, after offset and gain. */
enum v2v_level {
    V2V_LEVEL_MEAN,
    V2V_LEVEL_PEAK,  /**< 99.9th percentile: few pixels may be anything */
    V2V_LEVEL_NOISE, /**< standard deviation, REFERENCE.md 10 */
    V2V_LEVEL_RATIO, /**< noise over the larger of |mean| and its floor, which no gain changes */
    V2V_LEVEL_FIGURES
};

/** Of the frames that a network was trained on, but for those that are dark or not finite. */
struct v2v_level_range {
    int64_t frames; /**< 0: nothing is known */
    double least[V2V_LEVEL_FIGURES], most[V2V_LEVEL_FIGURES];
};

/** The frame that is farthest outside of a range. */
struct v2v_level_outlier {
    int64_t frame;
    enum v2v_level figure;
    double value;
    double factor; /**< to the nearer end of the range; 1: no frame is outside */
};

/** "mean", "peak", .. @kind Local */
const char *v2v_level_name(enum v2v_level figure);

/** Of one frame; NaN where it is dark or not finite. @kind Local.
 *  @param views [count,y,x], scaled @param scratch as large */
void v2v_level_of_frame(double level[V2V_LEVEL_FIGURES], float *scratch, const float *views,
                        int64_t count, int64_t height, int64_t width);

/** Widen a range, zeroed at first, by the frames of a recording. Ranks read a share of them each.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT | V2V_E_IO; agreed
 *  @cost a frame: read, and two selections among its samples (13 x 512 x 512: 57 ms) */
enum v2v_status v2v_level_range_add(struct v2v_level_range *range, struct v2v_recording *recording,
                                    const struct v2v_scaling *scaling,
                                    const struct v2v_comm *comm) V2V_MUST_CHECK;

/** The frames of a recording against a range. @kind Collective(comm). @return, @cost as above
 *  @param is_homogeneous bool: of the network: its ratio alone matters, else all but that */
enum v2v_status v2v_level_judge(struct v2v_level_outlier *outlier,
                                const struct v2v_level_range *range, int is_homogeneous,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
