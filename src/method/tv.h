/** Total variation by maximum a posteriori: no training, one setting for all scenes. */
#ifndef METHOD_TV_H
#define METHOD_TV_H

#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/data_step.h"

extern const struct v2v_estimator_ops v2v_estimator_tv;

/** Settings that it goes by, wherever it runs (v2v_estimator_ops, keys). */
#define V2V_TV_KEYS                                                                                \
    "deconv.iterations", "deconv.lambda", "deconv.noise", "deconv.electrons_per_count",            \
        "deconv.read_noise", "deconv.depth", "deconv.curvature", "deconv.sparsity",                \
        "deconv.tolerance", "recon.refresh"

/** Where its volumes lie: the frame and a border, or a part that has none. @kind Local. */
struct v2v_torus v2v_tv_torus_of(const struct v2v_problem *problem);

/** How much of the views' noise a voxel sees (v2v_psf_voxel_noise, of views that sum to 1), beside
 *  the 13 views of 39 slices that this method's constants were chosen for. @kind Local. */
double v2v_tv_noise_seen(const struct v2v_psf_file *psf);

/** Weights of the runs from here on (deconv.lambda, deconv.sparsity). @kind Local. */
void v2v_tv_set_weights(struct v2v_estimator *estimator, double lambda, double sparsity);

/** Its step towards the views, free for other use between runs: lent. @kind Local. */
struct v2v_data_step *v2v_tv_data_step(const struct v2v_estimator *estimator);

/** The volume of the last run beyond the frame, too, in units of the views.
 *  @kind Collective(shard). @param volume [z, torus rows of this rank, torus width] out */
void v2v_tv_torus_volume(const struct v2v_estimator *estimator, float *volume);

/** Noise of the views of a run, as it was taken, in their units: of variance
 *  gain * max(level, 0) + deviation^2. */
struct v2v_tv_noise {
    double gain; /**< of photons; 0: the same for all samples */
    double deviation;
    double part; /**< of the views' brightness that it is where they are so bright */
    const struct v2v_averaging *averaging; /**< NULL: of all samples alike; else of those that are
                                                the mean of so many .. */
    double frames;                         /**< .. frames */
};

/** Of the views last run or looked at; all 0: a dark frame. @kind Local. */
struct v2v_tv_noise v2v_tv_noise(const struct v2v_estimator *estimator);

#endif
