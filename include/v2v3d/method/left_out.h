#ifndef V2V3D_METHOD_LEFT_OUT_H
#define V2V3D_METHOD_LEFT_OUT_H

#include "v2v3d/method/estimator.h"

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_projector;

/** Some views of a frame are left out: volumes are made of the others, and predict them. The noise
 *  of a view is its own, so that what is left out judges settings, registration and methods. */
struct v2v_left_out {
    int64_t views, height, width; /**< of a frame */
    int64_t used;                 /**< how many of the views are */
    int32_t *view;                /**< [views] those that are used, then those left out */
    struct v2v_estimator *estimator;
    int64_t predicted;               /**< views: those left out, or all where none is */
    struct v2v_projector *projector; /**< onto these; NULL: nothing is predicted */
    struct v2v_psf_file psf;         /**< of those that are used */
    float *recorded;                 /**< [used,y,x] */
    float *frames;                   /**< likewise, of their averaging; NULL: they have none */
    float *volume, *rows;            /**< the projector's share of both */
};

/** Which ones: first, first + every, .. below end. None: all 0. */
struct v2v_left_out_views {
    int64_t first, every, end;
};

/** Folds that leave every view out once: view v is of fold v mod folds. Two views a fold, as far
 *  apart as their list allows; of six or fewer each by itself. @kind Local. */
int64_t v2v_left_out_folds(int64_t views);
struct v2v_left_out_views v2v_left_out_fold(int64_t views, int64_t fold);

/** @kind   Collective(problem's shard)
 *  @param  ops a method that takes frames of any size @param problem of all views
 *  @param  without what is left out; one view is used at least
 *  @param  predicts bool: v2v_left_out_predict will be called
 *  @return as v2v_estimator_create; agreed */
enum v2v_status v2v_left_out_create(struct v2v_left_out **left_out,
                                    const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem,
                                    struct v2v_left_out_views without, int predicts,
                                    const struct v2v_comm *shard) V2V_MUST_CHECK;
/** The same with one of two choices of views left out, which are spread over all: three of many
 *  views, one of six or fewer. @kind Collective(shard). @param problem of three views or more */
enum { V2V_LEFT_OUT_CHOICES = 2, V2V_LEFT_OUT_MOST = 3 };
enum v2v_status v2v_left_out_choose(struct v2v_left_out **left_out,
                                    const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem, int64_t choice,
                                    const struct v2v_comm *shard) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Collective(shard) */
void v2v_left_out_destroy(struct v2v_left_out **left_out);

/** The volume of the views that are used. @kind Collective(shard), no allocation.
 *  @param slices [estimator->slices,y,x] out @param views [v,y,x], all of the frame
 *  @param averaging of the views, by recon.neighbours of the problem; may be NULL
 *  @return V2V_OK | V2V_STOPPED | V2V_E_NUMERIC; agreed by the shard */
enum v2v_status v2v_left_out_run(struct v2v_left_out *left_out, float *slices, const float *views,
                                 const struct v2v_averaging *averaging) V2V_MUST_CHECK;

/** What a volume shows in the views left out, in their order, or in all where none is.
 *  @kind Collective(shard), no allocation. @param predicted [predicted,y,x] out, whole on all ranks
 *  @param slices as above */
void v2v_left_out_predict(struct v2v_left_out *left_out, float *predicted, const float *slices);

#ifdef __cplusplus
}
#endif

#endif
