/** Multiplicative deconvolution, view by view: x <- max(x * ((1-w) + w * numerator / denominator),
 *  0), or of all views at once, with the iterations, floors, stopping rules and ranks of all
 *  methods of this form.
 *
 *  A voxel that gives a view less than 1e-6 of its PSF's sum (1e-4 where the denominator is the
 *  method's own) is left alone by that view, and is 0 when no view sees it, or all views taken at
 *  once no more than that of one; a pixel that would get less than 1e-4 of the PSF's sum from a
 *  volume of ones has no say; a projection counts as at least 1e-6 of the mean view. Blind samples
 *  (tensor/blind.h) follow the volume: they change nothing. All floors are relative: scaled views
 *  give the scaled volume. A dark frame is a dark volume; one whose mean is below
 *  V2V_ESTIMATOR_DARK is an even one.
 */
#ifndef METHOD_RICHARDSON_LUCY_H
#define METHOD_RICHARDSON_LUCY_H

#include "method/sensitivity.h"
#include "method/stop_rule.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/projector.h"

/** A projection below this fraction of the mean view counts as this fraction. */
#define V2V_PROJECTION_FLOOR 1e-6f

struct v2v_richardson_lucy;

/** What methods of this form differ in. */
struct v2v_richardson_lucy_variant {
    int64_t iterations;  /**< where deconv.iterations leaves it to the method */
    int has_denominator; /**< bool: of its own; else it is A_v^T 1 */
    int at_once;         /**< bool: all views make one step, w = 1, over the sum of their A_v^T 1;
                            else one view after the other */
    int judged_every;    /**< iterations, where a rule stops them */
    double start;        /**< of the projections, in mean views */
    double background;   /**< added to views and projections, in noise of the views */
    /** Set the numerator, and a denominator of one's own, from ratio = A x of the listed views.
     *  @kind Collective(comm). @param views rows of this rank, view v at v * height * width
     *  @param list all at once, or one @param scale 1 / mean view */
    void (*correct)(struct v2v_richardson_lucy *self, const float *views,
                    const struct v2v_view_list *list, float scale);
};

struct v2v_richardson_lucy {
    const struct v2v_richardson_lucy_variant *variant;
    const struct v2v_estimator *estimator; /**< for messages: name, frame */
    const struct v2v_comm *comm;
    struct v2v_projector *projector;
    struct v2v_sensitivity sensitivity;
    struct v2v_projector_share share; /**< of this rank */
    struct v2v_stop_rule stop;
    int64_t views, height, width;
    int64_t iterations;   /**< at most */
    double weight;        /**< w */
    double constant_view; /**< mean over views and pixels of the projection of a volume of ones */
    float *volume;        /**< [slices,rows,x] where that is not what the caller holds, else NULL */
    float background;     /**< added to this frame's views and projections, in mean views */
    float *ratio;         /**< [view_rows,x], of all views where they are taken at once: the
                               projection, and what is back-projected */
    float *noise;         /**< [v,y,x]: to estimate the views' noise; NULL without background */
    float *numerator;     /**< [slices,rows,x] */
    float *denominator;   /**< likewise, of a method that has one of its own; else NULL */
    double *seen;         /**< [slices,x]: a row of A_v^T 1 for each slice */
    uint8_t *unlit;       /**< [v,view_rows,x]: no voxel of the frame lights this pixel */
};

/** Functions of struct v2v_estimator_ops; `variant` is a struct v2v_richardson_lucy_variant.
 *  @kind as there. */
enum v2v_status v2v_richardson_lucy_describe_work(struct v2v_grid_work *work,
                                                  const struct v2v_problem *problem);
enum v2v_status v2v_richardson_lucy_create(struct v2v_estimator *estimator,
                                           const struct v2v_problem *problem);
void v2v_richardson_lucy_destroy(struct v2v_estimator *estimator);
enum v2v_status v2v_richardson_lucy_run(struct v2v_estimator *estimator, float *const *volume,
                                        const float *views, const struct v2v_monitor *monitor);

void v2v_richardson_lucy_project(struct v2v_estimator *estimator, float *views,
                                 const float *volume);

#define V2V_RICHARDSON_LUCY_OPS                                                                    \
    .describe_work = v2v_richardson_lucy_describe_work, .create = v2v_richardson_lucy_create,      \
    .destroy = v2v_richardson_lucy_destroy, .run = v2v_richardson_lucy_run,                        \
    .project = v2v_richardson_lucy_project, .leaves_blind = 1

/** Pixels of a view that this rank holds. @kind Local. */
static inline int64_t v2v_richardson_lucy_pixels(const struct v2v_richardson_lucy *self)
{
    return self->share.view_rows.count * self->width;
}

extern const struct v2v_estimator_ops v2v_estimator_rl, v2v_estimator_rld, v2v_estimator_frl;

#endif
