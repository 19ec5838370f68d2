/** Ways from the views of a frame to its volume: the interface that reconstruction knows them by.
 *
 *  Purpose: one const table of functions a method (struct v2v_estimator_ops), all of them listed in
 *  src/method/estimators.c. Frames, ranks, units, padding, writing and resuming are written once,
 *  over it (recon/recon.h).
 *  Invariants: an estimator is made for one frame size, and nothing is allocated in run; ranks of
 *  its shard share a frame, never the answer; a failure of run is agreed by them.
 *
 *  Example (compiled by tests/unit/method):
 *
 *      struct v2v_problem problem = {.config = &config, .psf = &psf, .height = 512, .width = 512};
 *      V2V_TRY(v2v_estimator_find(&ops, "rld"));
 *      V2V_TRY(v2v_estimator_create(&estimator, ops, &problem, comm));
 *      V2V_TRY(ops->run(estimator, &volume, views, NULL));
 *  done:
 *      v2v_estimator_destroy(&estimator);
 */
#ifndef V2V3D_METHOD_ESTIMATOR_H
#define V2V3D_METHOD_ESTIMATOR_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/nn/network.h"
#include "v2v3d/par/grid.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_ESTIMATOR_MOST_OUTPUTS = V2V_NETWORK_MOST_OUTPUTS };

/** What an estimator is made for; the pointers are borrowed at its creation. */
struct v2v_problem {
    const struct v2v_config *config;
    const struct v2v_psf_file *psf;
    const char *weights; /**< file of the network in config; NULL: the method needs none, or has to
                              be told of them */
    int64_t height, width;        /**< of a frame as recorded */
    int is_part;                  /**< bool: no frame, but a part of the plane that a frame and what
                                       is beyond it are given on; for methods that `tell`;
                                       v2v_fft_good_size keeps its sides */
    int precision;                /**< V2V_PRECISION_F32 or _BF16 */
    double skip;                  /**< tolerance; 0: nothing is left out */
    unsigned outputs;             /**< bits 1u << output: those of this rank; 0: all */
    int64_t floats, floats_a_row; /**< where memory is limited, room that is left for arrays that
                                       are taken later, and for each row of this rank's volumes */
};

struct v2v_estimator_ops;
struct v2v_projector_share;

/** Views that are means of several frames, of more where less changed (method/fusion.h), and the
 *  noise of one frame. */
struct v2v_averaging {
    const float *frames;   /**< [v,y,x]: 1 or more; a frame's variance over it is left, or less */
    double sigma;          /**< of a frame's noise, where it is the same for all samples .. */
    double gain, variance; /**< .. and of photons, of variance gain * level + variance */
    int is_of_photons;     /**< bool: it shows that it is */
};

/** What is known about the part of a frame that views are of: light of the frame, as it is outside
 *  of the part. */
struct v2v_surroundings {
    const float *light;            /**< [slices,y,x]: of it, what is in the part */
    const float *seen;             /**< [v,y,x]: views that all of it gives */
    struct v2v_part rows, columns; /**< of the part, where views are known */
    const float *highest;          /**< [v]: v2v_saturated_value of all the views */
};

/** What a volume leaves of its views, where they are known; 0: not known, or a dark frame. */
struct v2v_misfit {
    double missed;          /**< root mean square, of their noise */
    double coarse;          /**< likewise of means of 8 x 8 pixels, of their noise .. */
    double noise_of_coarse; /**< .. which is this part of the views' brightness */
};

struct v2v_estimator {
    const struct v2v_estimator_ops *ops;
    const struct v2v_comm *shard;
    int64_t height, width;  /**< of the views that run takes: multiples of the unit */
    unsigned held;          /**< outputs of this rank, as bits */
    struct v2v_part slices; /**< of the volumes, on this rank: all but where ranks share slices */
    const struct v2v_output *output; /**< which views each output may not see; NULL: it sees all */
    double computed_part;            /**< of the work, by the last run, 0 .. 1 */
    int64_t iterations;              /**< of the last run, where the method counts them */
    struct v2v_misfit misfit;        /**< of the last run, an iteration before its end at the
                                          earliest, where the method knows it */
    int64_t most_iterations;         /**< of the runs from here on; 0: as configured */
    const struct v2v_surroundings *around; /**< of the next runs of a part; borrowed */
    const struct v2v_averaging *averaging; /**< of the views looked at or run next; NULL: they are
                                                of one frame; borrowed */
    int64_t frame; /**< under way, as users count: set by the caller, for monitors and messages */
    double units;  /**< volume * units is in the recording's: set by the caller, else 1 */
    void *self;    /**< the method's own */
};

/** The volume after an iteration. */
struct v2v_iterate {
    struct v2v_estimator *estimator;
    void (*to_slices)(struct v2v_estimator *estimator, float *slices, const float *volume);
    const float *volume; /**< as the method holds it */
    double scale;        /**< volume * scale is in units of the views */
};

/** The volume in whole slices, estimator->slices of them, in the units of the recording.
 *  @kind Collective(shard), no allocation. @param slices [slices,y,x] out; not the volume of run */
void v2v_iterate_slices(const struct v2v_iterate *iterate, float *slices);

/** Who looks on while a method iterates. */
struct v2v_monitor {
    /** Called after every iteration, from 1 on. @kind Collective(shard).
     *  @return bool: this was the last one; the same on all ranks of the shard */
    int (*enough)(void *context, int64_t iteration, const struct v2v_iterate *iterate);
    void *context;
};

struct v2v_estimator_ops {
    const char *name;    /**< in configurations */
    int is_learned;      /**< bool: it needs weights */
    int has_gain;        /**< bool: views are to have the gain, and volumes are projected, as in the
                              training; else views scaled by s give the volume scaled by s */
    int leaves_blind;    /**< bool: blind samples (tensor/blind.h) of views are unknown to it */
    int skips_light;     /**< bool: by itself it leaves out the tiles that are dark */
    const void *variant; /**< what rows with the same functions differ in */
    const char *const *keys; /**< the settings that not every method goes by but it does, then NULL:
                                  of sections recon and deconv */

    /** Does the configuration leave a setting to a frame? NULL: never. @kind Local. */
    int (*is_open)(const struct v2v_config *config);
    /** Decide it, by the views [v,y,x] of a whole frame, the same on all ranks.
     *  @kind Collective(comm). @param config problem's own @param averaging of views; may be NULL
     *  @return V2V_OK | V2V_STOPPED | V2V_E_CONFIG | V2V_E_MEMORY | V2V_E_INPUT (weights) |
     *          V2V_E_NUMERIC; agreed */
    enum v2v_status (*settle)(struct v2v_config *config, const struct v2v_problem *problem,
                              const float *views, const struct v2v_averaging *averaging,
                              const struct v2v_comm *comm);

    /** What a frame takes: rows, unit of its sides, cuts, memory, ranks that may share it
     *  (most_shards), outputs (most_branches), the mean of which is the result. @kind Local.
     *  @return V2V_OK | V2V_E_CONFIG (settings that the method cannot work with) */
    enum v2v_status (*describe_work)(struct v2v_grid_work *work, const struct v2v_problem *problem);
    /** The common fields are set already. @kind Collective(shard).
     *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT | V2V_E_CONFIG | V2V_E_INTERNAL; agreed by
     *  the shard */
    enum v2v_status (*create)(struct v2v_estimator *estimator, const struct v2v_problem *problem);
    /** After whatever part of create was done; self may be NULL. @kind Collective(shard). */
    void (*destroy)(struct v2v_estimator *estimator);
    /** Rows of the volumes that a rank of the shard computes; NULL: all. @kind Local. */
    struct v2v_part (*rows_of)(const struct v2v_estimator *estimator, int rank);
    /** volume[o] [slices,rows,x] of every output held, from views [v,y,x], the same on all ranks of
     *  the shard. Iterations re-arm the watchdog. @kind Collective(shard), no allocation.
     *  @param monitor NULL: nobody looks on
     *  @return V2V_OK | V2V_STOPPED | V2V_E_NUMERIC; agreed by the shard */
    enum v2v_status (*run)(struct v2v_estimator *estimator, float *const *volume,
                           const float *views, const struct v2v_monitor *monitor);
    /** What is measured of a frame's views [v,y,x] before its parts are computed by themselves;
     *  runs of `window`, of a part from even pixels on, shall take it, and the weights, from
     *  `whole`, of the frame. NULL, like `whole_light`: parts are not computed by themselves.
     *  @kind Collective(shard), no allocation. */
    void (*measure)(struct v2v_estimator *whole, const float *views);
    /** @kind Local, no allocation. */
    void (*inherit)(struct v2v_estimator *window, const struct v2v_estimator *whole);
    /** The light that the last run ended with, the frame and what is beyond it, and the views that
     *  it gives: on a torus (optics/data_step.h), which `is_part` is a part of.
     *  @kind Collective(shard), no allocation. @param volume [slices,torus] out
     *  @param views [v,torus] out; of both, all on every rank */
    void (*whole_light)(struct v2v_estimator *whole, float *volume, float *views);
    /** views [v,y,x] that a volume gives, with nothing beyond the frame, by what runs hold of the
     *  PSFs: the sum over the shard, each rank some rows of it and zeros. NULL: they hold nothing,
     *  as is where frames are padded.
     *  @kind Collective(shard), no allocation. @param volume [slices,y,x] of this rank */
    void (*project)(struct v2v_estimator *estimator, float *views, const float *volume);
};

/** How many there are, and one of them, 0 .. count-1. @kind Local. */
int64_t v2v_estimator_count(void);
const struct v2v_estimator_ops *v2v_estimator_at(int64_t index);

/** By name. @kind Local. @return V2V_OK | V2V_E_CONFIG (names those that there are) */
enum v2v_status v2v_estimator_find(const struct v2v_estimator_ops **ops,
                                   const char *name) V2V_MUST_CHECK;

/** Does the configuration leave a setting to a frame? @kind Local. */
int v2v_estimator_is_open(const struct v2v_estimator_ops *ops, const struct v2v_config *config);

/** How a recording is scaled for it: the configuration's input, without gain where volumes scale
 *  with the views. @kind Local. */
struct v2v_input_settings v2v_estimator_input(const struct v2v_estimator_ops *ops,
                                              const struct v2v_config *config);

/** Decide such settings (ops->settle). Rank 0's answer is all ranks': other processors may round
 *  another way.
 *  @kind   Collective(world)
 *  @param  config problem's own; deconv and recon are settled
 *  @param  views [v,y,x] of a whole frame, the same on all ranks
 *  @param  averaging of views; NULL: they are of one frame
 *  @return as ops->settle; agreed */
enum v2v_status v2v_estimator_settle(struct v2v_config *config, const struct v2v_estimator_ops *ops,
                                     const struct v2v_problem *problem, const float *views,
                                     const struct v2v_averaging *averaging,
                                     const struct v2v_comm *world) V2V_MUST_CHECK;

/** The one that a network's weights are for. @kind Local. */
const struct v2v_estimator_ops *v2v_estimator_of_network(const struct v2v_network_ops *network);

/** Lay the ranks out for frames, by section parallel of the configuration: ranks take frames; where
 *  there are too few of them, outputs and parts of a frame.
 *  @kind   Collective(world)
 *  @param  work of describe_work, with the number of frames
 *  @param  branches ranks that share a frame, outputs each; 0: as many as are best
 *  @param  beside bytes that a rank holds already, PSFs among them, and takes beside the estimator
 *  @return V2V_OK | V2V_E_CONFIG (more ranks than can share a frame) or as v2v_grid_lay_out */
enum v2v_status v2v_estimator_lay_out(struct v2v_grid *grid, const struct v2v_grid_work *work,
                                      int branches, int64_t beside, const struct v2v_config *config,
                                      struct v2v_comm *world) V2V_MUST_CHECK;

/** @kind Collective(shard), which is borrowed. @return V2V_OK or as describe_work and create;
 *  agreed */
enum v2v_status v2v_estimator_create(struct v2v_estimator **estimator,
                                     const struct v2v_estimator_ops *ops,
                                     const struct v2v_problem *problem,
                                     const struct v2v_comm *shard) V2V_MUST_CHECK;
/** @kind Collective(shard). */
void v2v_estimator_destroy(struct v2v_estimator **estimator);

/** For run: are the `count` views of a frame finite? @kind Local.
 *  @return V2V_OK | V2V_E_NUMERIC (view, row, column) */
enum v2v_status v2v_estimator_check_views(const struct v2v_estimator *estimator, const float *views,
                                          int64_t count) V2V_MUST_CHECK;

/** Views whose mean is not above this are not iterated on: below FLT_MIN 1/mean would overflow. */
#define V2V_ESTIMATOR_DARK 1e-37

/** As check_views, and their mean but for blind samples, of those below zero as zeros.
 *  @kind Local. @return likewise */
enum v2v_status v2v_estimator_mean(double *mean, const struct v2v_estimator *estimator,
                                   const float *views, int64_t count) V2V_MUST_CHECK;

/** For run, after a step: NaN, Inf, a fault point or a request to stop, each found by one rank, end
 *  all ranks.
 *  @kind   Local
 *  @param  fault what the method's fault point gave @param volume of the share [slices,rows,x]
 *  @param  step its number, and `word` what the method calls it
 *  @return V2V_OK | V2V_E_NUMERIC (frame, voxel) | fault | V2V_STOPPED */
enum v2v_status v2v_estimator_check_step(const struct v2v_estimator *estimator,
                                         enum v2v_status fault, const float *volume,
                                         const struct v2v_projector_share *share, const char *word,
                                         int64_t step) V2V_MUST_CHECK;

/** Does this rank hold output `o`? @kind Local. */
static inline int v2v_estimator_holds(const struct v2v_estimator *estimator, int o)
{
    return (estimator->held >> o & 1) != 0;
}

#ifdef __cplusplus
}
#endif

#endif
