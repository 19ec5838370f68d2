#ifndef V2V3D_OPTICS_COST_H
#define V2V3D_OPTICS_COST_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/cost.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What the choice between slices and slabs (optics/projector.h) rests on: how fast this machine
 *  transforms and multiplies while all ranks do, and what moving data costs. */
struct v2v_projector_cost {
    int threads;        /**< of a rank */
    double transform_s; /**< of a frame by all threads, for each of its n log2(n), n = ny * nx */
    double product_s;   /**< of one number of an OTF, by all threads */
    double wait_s; /**< that ranks wait for one another in an exchange between pieces of work */
    double own_s;  /**< a frame that all ranks share, there and back, by the own exchange .. */
    double fftw3_mpi_s; /**< .. and by FFTW3-MPI's; 0 on one rank */
    struct v2v_comm_cost network;
};

/** Seconds that one projection and one back-projection take. */
struct v2v_projector_times {
    double forward_s, adjoint_s;
};

/** Measure, all-reduces apart: some 30 MB, 0.2 s in all, or three turns of each figure where that
 *  takes longer. All ranks get the same figures.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_projector_cost_measure(struct v2v_projector_cost *cost,
                                           const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Predicted times of `count` views of the set's at a time, frames [height,width], over `ranks`
 *  ranks. Only the set's sizes are looked at. @kind Local. */
struct v2v_projector_times v2v_projector_predict(const struct v2v_projector_cost *cost,
                                                 const struct v2v_psf_file *psf, int64_t height,
                                                 int64_t width, int64_t count, enum v2v_split split,
                                                 int ranks);

/** slices, slabs, slabs through FFTW3-MPI */
enum { V2V_SPLITS = 3 };

/** Slabs by the transform that parallel.transform names; where it leaves that open, the own one.
 *  @kind Local. */
enum v2v_split v2v_split_of_slabs(const struct v2v_config *config);

/** In words. @kind Local. */
const char *v2v_split_text(enum v2v_split split);

/** Predicted seconds of a projection and a back-projection by each, and the fastest of those that
 *  parallel.split and parallel.transform leave. @kind Local. */
enum v2v_split v2v_projector_faster(double seconds[V2V_SPLITS],
                                    const struct v2v_projector_cost *cost,
                                    const struct v2v_config *config, const struct v2v_psf_file *psf,
                                    int64_t height, int64_t width, int64_t count, int ranks);

/** How ranks share projections and back-projections of `count` views at a time: as parallel.split
 *  and parallel.transform say, or as the cost model, measured for it, predicts the fastest of what
 *  they leave; logged. With parallel.reproducible by slabs: they alone keep all bits of one rank.
 *  @kind   Collective(comm), agreed
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG (slices of several ranks are to be reproducible) */
enum v2v_status v2v_projector_choose_split(enum v2v_split *split, const struct v2v_config *config,
                                           const struct v2v_psf_file *psf, int64_t height,
                                           int64_t width, int64_t count,
                                           const struct v2v_comm *comm) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
