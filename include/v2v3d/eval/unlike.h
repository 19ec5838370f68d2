#ifndef V2V3D_EVAL_UNLIKE_H
#define V2V3D_EVAL_UNLIKE_H

#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/par/comm.h"
#include "v2v3d/tensor/statistics.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Frames of a recording that are unlike one of it (REFERENCE.md 11). */

/** Of the views' pixels. 3 % of fibres cost total variation 3 dB; some 10 pixels, as of vessels9,
 *  nothing. */
#define V2V_MUCH_SATURATED 1e-3

/** A recording, and the frame that others are held against. Everything is borrowed. */
struct v2v_unlike_input {
    struct v2v_recording *recording;
    const struct v2v_scaling *scaling;
    const float *reference; /**< [v,y,x] as recorded, less the offset, without blind samples */
    int64_t shown;          /**< its number */
    int asks_zero;          /**< bool: is the frames' darkness asked for? */
    int is_zero_told;       /**< bool: above the offset it isn't: that was told, or is meant */
};

/** Figures of one frame; 0: it isn't unlike. */
enum v2v_unlike_figure {
    V2V_UNLIKE_UNSEEN,  /**< 1: it shows nothing above its noise */
    V2V_UNLIKE_ODD,     /**< 1 + the view that is less than half as bright, or more than twice .. */
    V2V_UNLIKE_TIMES,   /**< .. as in the reference, beside the other views: so many times */
    V2V_UNLIKE_ABOVE,   /**< its dark lies so much above the offset .. */
    V2V_UNLIKE_BELOW,   /**< .. or below */
    V2V_UNLIKE_CLIPPED, /**< part of its samples that is saturated, from V2V_MUCH_SATURATED on */
    V2V_UNLIKE_FIGURES
};

struct v2v_unlike {
    double figure[V2V_UNLIKE_FIGURES];
};

/** Where the dark of views lies; above zero only where that is asked for. @kind Local.
 *  @param views as recorded, less the offset @param scratch as large */
struct v2v_dark v2v_unlike_zero(const float *views, float *scratch,
                                const struct v2v_unlike_input *input);

/** A frame as recorded (eval/as_recorded.h), less the offset.
 *  @kind   Local
 *  @param  blind out: how many samples see nothing, V2V_BLIND (tensor/blind.h); may be NULL
 *  @param  clipped out: part of the samples that is saturated; may be NULL
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_unlike_read(float *views, int64_t *blind, double *clipped,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling,
                                int64_t t) V2V_MUST_CHECK;

/** All frames but the reference. Ranks share them, and all know all of them then.
 *  @kind   Collective(comm)
 *  @param  frames [t] out
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT; agreed */
enum v2v_status v2v_unlike_frames(struct v2v_unlike *frames, const struct v2v_unlike_input *input,
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Frames whose volumes explain their views worse than another one's does, as where views moved. */
struct v2v_unlike_explained {
    int64_t known;        /**< of which that is known, and nothing else is unlike */
    int64_t best;         /**< is explained best, or -1 */
    int64_t moved, first; /**< how many are worse than that, and the first of them */
};

/** @kind Local. @param frames, misfit [info->frames] */
struct v2v_unlike_explained v2v_unlike_explained(const struct v2v_unlike *frames,
                                                 const struct v2v_misfit *misfit,
                                                 const struct v2v_recording_info *info);

#ifdef __cplusplus
}
#endif

#endif
