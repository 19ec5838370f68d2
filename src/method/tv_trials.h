/** Volumes by total variation of some of a frame's views, by one weight and another, and how well
 *  they predict the other views: on a square of the frame where it varies most. */
#ifndef METHOD_TV_TRIALS_H
#define METHOD_TV_TRIALS_H

#include "method/square.h"
#include "v2v3d/method/left_out.h"

/** Weights that may be tried: of the variation alone, 0.0075 to 1.92 of sigma, each the root of 2
 *  times the one before; behind them parts of `best_alone`, with a weight of the volume itself. */
enum { V2V_TV_WEIGHTS = 17, V2V_TV_SPARSE = 2, V2V_TV_TRIED = V2V_TV_WEIGHTS + V2V_TV_SPARSE };

enum { V2V_TV_FOLDS = V2V_LEFT_OUT_CHOICES };

struct v2v_tv_weights {
    double lambda, sparsity; /**< of deconv.lambda and deconv.sparsity */
};

/** A volume without the views of a fold, by a weight; by which group of ranks, as far as there are
 *  groups. */
struct v2v_trial {
    int fold, index, group, iterations;
};
enum { V2V_TRIALS = V2V_TV_FOLDS }; /**< at once */

struct v2v_trials {
    struct v2v_square_views square;
    struct v2v_config config;
    struct v2v_problem problem; /**< of the square */
    struct v2v_comm *comm;      /**< of the ranks that share the work .. */
    struct v2v_comm *sharing;   /**< .. and those of them that share a volume of views left out */
    int groups, group;          /**< of ranks that share volumes, and this rank's */
    double best_alone;          /**< lambda, set by the caller */
    struct v2v_left_out *fold[V2V_TV_FOLDS];
    double missed[V2V_TV_FOLDS][V2V_TV_TRIED]; /**< sums of the squares; < 0: not tried */
    double filled[V2V_TV_FOLDS][V2V_TV_TRIED]; /**< part of the voxels that hold the light, if each
                                                    has the same */
    int64_t judged;                            /**< samples of the views that a fold leaves out */
    float *samples;   /**< [fold,weight,judged]: by how much they are missed; 0 where not tried */
    float *volume;    /**< [z,height,width] of the square */
    float *predicted; /**< [left out,height,width] */
};

/** The number of a weight of the variation alone, or what is between two of them. @kind Local. */
double v2v_trials_lambda(double index);

/** Of the nearest one, whether or not it may be tried. @kind Local. */
int v2v_trials_index(double lambda);

/** @kind Local. @param index below V2V_TV_TRIED */
struct v2v_tv_weights v2v_trials_weights(const struct v2v_trials *trials, int index);

/** @kind Collective(world): ranks of a host share, since a square is too small to be sent from host
 *  to host. @param problem of the whole frame; its weights are not read @param views [v,y,x], no
 *  offset @param averaging of views; may be NULL
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG, agreed; _fini after all */
enum v2v_status v2v_trials_init(struct v2v_trials *trials, const struct v2v_problem *problem,
                                const float *views, const struct v2v_averaging *averaging,
                                const struct v2v_comm *world) V2V_MUST_CHECK;
void v2v_trials_fini(struct v2v_trials *trials);

/** Each by its group; what it misses is known to all ranks. @kind Collective(trials->comm).
 *  @return V2V_OK | V2V_STOPPED | V2V_E_MEMORY | V2V_E_NUMERIC, agreed */
enum v2v_status v2v_trials_run(struct v2v_trials *trials, const struct v2v_trial *list,
                               int count) V2V_MUST_CHECK;

/** All folds by a weight, unless they are known. @kind Collective(trials->comm).
 *  @param iterations of each volume @return likewise */
enum v2v_status v2v_trials_try(struct v2v_trials *trials, int index, int iterations) V2V_MUST_CHECK;

/** As if a weight were not tried. @kind Local. */
void v2v_trials_forget(struct v2v_trials *trials, int index);

/** Sum of the squares by which a weight misses all folds. @kind Local. */
double v2v_trials_missed(const struct v2v_trials *trials, int index);

/** By how many deviations a weight predicts the first folds better than another. What it misses
 *  samples by is their noise, each its own, which scatters the difference of squares.
 *  @kind Local. */
double v2v_trials_better(const struct v2v_trials *trials, int index, int than, int folds);

#endif
