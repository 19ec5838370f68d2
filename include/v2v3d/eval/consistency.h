/** How far does a recording agree with itself? Volumes by total variation of some of its views,
 *  against the other views and against each other: what an estimate of a volume can be worth.
 *
 *  Purpose: figures without a truth, of frames spread evenly over a recording.
 *  Invariants: they judge views, PSFs and their registration, with the estimator `tv` as the
 *  configuration sets its weight, or corrected by a network's weights; no volume that was made
 *  before. Ranks take frames, and share them where there are too few: any number of ranks gets the
 *  same figures to round-off.
 *
 *  Example (compiled by tests/mpi/eval):
 *
 *      V2V_TRY(v2v_consistency_of(&consistency, &job, world));
 *      printf("%.3f of the views left out is missed\n", consistency.heldout[0]);
 *  done:
 *      v2v_consistency_fini(&consistency);
 */
#ifndef V2V3D_EVAL_CONSISTENCY_H
#define V2V3D_EVAL_CONSISTENCY_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Of the frames judged, on all ranks. NaN: not known. */
struct v2v_consistency {
    int64_t frames, views, slices;
    int64_t *frame; /**< [frames] of the recording */
    /** Two views (of six or fewer one) are left out at a time and predicted from a volume of the
     *  others, until every view was: |view - prediction| / |view|, and in units of the noise. */
    double *heldout, *heldout_sigmas;             /**< [frames], all views */
    double *heldout_views, *heldout_views_sigmas; /**< [frames,views] */
    double *shift; /**< [frames,views,2] y, x: the recorded view lies so far from its prediction */
    /** Of a and b, the volumes of every other view: |a - b| / |a + b|, the standard error of their
     *  mean where their errors are independent of each other. */
    double *disagreement;        /**< [frames] */
    double *disagreement_slices; /**< [frames,slices] */
    double *resolution;          /**< [frames] pixels: v2v_fourier_resolution of a and b */
    double *memory;              /**< owned, [doubles] of all of them */
    int64_t doubles;
};

struct v2v_consistency_job {
    const struct v2v_config *config; /**< deconv, of tv; parallel; model */
    const struct v2v_psf_file *psf;
    struct v2v_recording *recording;
    const struct v2v_scaling *scaling;
    const char *weights; /**< of the model, a network that takes any views: volumes are its
                              estimator's; NULL: by total variation alone */
    int64_t frames;      /**< at most */
    /** MEAN and UNCERTAINTY of the frames judged, which are marked done; NULL: not written. The
     *  mean is the volume of all views, the uncertainty v2v_uncertainty_of's. HDF5, of all frames.
     */
    struct v2v_volume_writer *writer;
};

/** @kind   Collective(world); v2v_consistency_fini after both
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_CONFIG | V2V_E_MEMORY | V2V_E_NUMERIC | V2V_E_IO |
 *          V2V_STOPPED; agreed. A recording of one view has no figures.
 *  @cost   about views / 2 + 1 estimates of a frame from all its views, with a file one more and
 *          twice the memory */
enum v2v_status v2v_consistency_of(struct v2v_consistency *consistency,
                                   const struct v2v_consistency_job *job,
                                   struct v2v_comm *world) V2V_MUST_CHECK;
void v2v_consistency_fini(struct v2v_consistency *consistency);

/** Frame i of n that are spread evenly over `frames`: the middles of n equal parts. @kind Local. */
int64_t v2v_consistency_frame(int64_t i, int64_t n, int64_t frames);

#ifdef __cplusplus
}
#endif

#endif
