/** What a frame's views say of a volume, beside the volume of total variation: where they are not
 *  met by it yet. And frames of which the volume is known, for teaching: a volume that was
 *  estimated, flipped, is projected and made noisy, and estimated again (a parametric bootstrap of
 *  the estimator's error: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, 6.5).
 *
 *  Features of views y and volume x, with A the projection on the torus of the data step:
 *      f0 = x,  f_k = A^H (A A^H + 1 / tau_k)^-1 r,  r = y - A x in the frame, 0 beyond it,
 *  tau_k of 2 and 64 for PSFs that sum to 1 a view. They are as bright as the views.
 *  Invariants: on one rank; the same bits at any number of threads; nothing is allocated after
 *  creation.
 */
#ifndef V2V3D_METHOD_FEATURES_H
#define V2V3D_METHOD_FEATURES_H

#include "method/tv.h"
#include "v2v3d/method/estimator.h"
#include "v2v3d/optics/data_step.h"

enum { V2V_FEATURES = 3 };

struct v2v_features;

/** For frames of the problem, by its settings of tv. @kind Local.
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG */
enum v2v_status v2v_features_create(struct v2v_features **features,
                                    const struct v2v_problem *problem) V2V_MUST_CHECK;
void v2v_features_destroy(struct v2v_features **features);

/** Total variation under them, which runs with them: lent. @kind Local. */
struct v2v_estimator *v2v_features_tv(const struct v2v_features *features);

/** The torus that volumes lie on, the frame at its origin. @kind Local. */
struct v2v_torus v2v_features_torus(const struct v2v_features *features);

/** f0 is total variation's volume of the views; where that is dark, so are all. @kind Local.
 *  @param out [V2V_FEATURES,z,height,width]
 *  @param volume [z,torus] out: f0 beyond the frame, too; NULL: not wanted
 *  @param noise out: of the views, as tv took it; all 0: they are dark
 *  @param views [v,height,width]
 *  @return V2V_OK | V2V_STOPPED | V2V_E_NUMERIC */
enum v2v_status v2v_features_of_views(struct v2v_features *features, float *out, float *volume,
                                      struct v2v_tv_noise *noise,
                                      const float *views) V2V_MUST_CHECK;

/** f0 is a volume [z,torus] that is given. @kind Local. */
void v2v_features_of_volume(struct v2v_features *features, float *out, const float *volume,
                            const float *views);

/** Views of a volume with this noise by (seed, stream): normal, and of photons where it has a gain.
 *  @kind Local. @param views [v,height,width] out @param volume [z,torus] */
void v2v_features_simulate(struct v2v_features *features, float *views, const float *volume,
                           const struct v2v_tv_noise *noise, uint64_t seed, uint64_t stream);

enum v2v_flips { V2V_FLIP_X = 1, V2V_FLIP_Y = 2, V2V_FLIP_Z = 4 };

/** The volume mirrored about the middle of the frame, which stays where it is on the torus. Views
 *  are projected afterwards: no symmetry of the optics is needed.
 *  @kind Local. @param out, volume [z,torus], no overlap @param flips of enum v2v_flips */
void v2v_features_flip(const struct v2v_features *features, float *out, const float *volume,
                       unsigned flips);

/** The frame of a volume. @kind Local. @param out [z,height,width] @param volume [z,torus] */
void v2v_features_cut(const struct v2v_features *features, float *out, const float *volume);

#endif
