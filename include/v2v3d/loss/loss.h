/** What the volumes of a network are judged by.
 *
 *  Purpose: the losses of REFERENCE.md 5, each with its gradient, a row each of
 *  v2v3d/conf/loss_terms.h: views that a volume has not seen (mean squared error, Fourier L1),
 *  positivity, de-crosstalk, axial smoothness.
 *  Invariants: sums in double precision, in an order that depends on neither ranks nor threads;
 *  nothing is allocated in v2v_loss_evaluate; a term of weight 0 still is computed (it is in the
 *  log), its gradient is not.
 *
 *  Ranks that share volumes share the loss: each projects its rows, compares some of the views as
 *  a whole and goes through its rows of the volumes. What it buys (tests/bench/bench_loss, 128 x
 *  128, 13 views, 39 slices, one thread a rank): two ranks take 15 ms and 52 MB each instead of the
 *  26 ms and 95 MB of the whole loss on either, and volumes are not gathered.
 *
 *  Example (compiled by tests/unit/loss):
 *
 *      static const int32_t odd[] = {1, 3}, even[] = {0, 2, 4};
 *      struct v2v_loss_setup setup = {.settings = &config.loss, .psf = &psf, .reduce =
 *                                     V2V_REDUCE_SUM, .height = 128, .width = 128,
 *                                     .window = {16, 112, 16, 112}, .outputs = 2,
 *                                     .held_out = {{odd, 2}, {even, 3}}};
 *      V2V_TRY(v2v_projector_create(&setup.projector, &psf, 128, 128, V2V_SPLIT_SLABS, NULL));
 *      V2V_TRY(v2v_loss_create(&loss, &setup));
 *      v2v_loss_evaluate(loss, terms, 3, dvolume, volume, views);
 *  done:
 *      v2v_loss_destroy(&loss);
 *      v2v_projector_destroy(&setup.projector);
 */
#ifndef V2V3D_LOSS_LOSS_H
#define V2V3D_LOSS_LOSS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Rows [y0,y1) and columns [x0,x1) of the views that are compared. */
struct v2v_window {
    int64_t y0, y1, x0, x1;
};

enum { V2V_LOSS_MOST_OUTPUTS = 2 };

/** The views that an output's volume is judged by. */
struct v2v_held_out {
    const int32_t *view; /**< [count] */
    int64_t count;
};

struct v2v_loss_setup {
    const struct v2v_loss_settings *settings;
    const struct v2v_psf_file *psf; /**< used at creation only */
    int reduce;                     /**< enum v2v_reduce of the projection */
    int64_t height, width;          /**< of the volumes and views */
    struct v2v_window window;
    int outputs; /**< volumes whose mean is the result: 1 or 2 */
    struct v2v_held_out held_out[V2V_LOSS_MOST_OUTPUTS]; /**< copied */
    struct v2v_projector *projector;                     /**< for such frames; borrowed */
    const struct v2v_comm *comm; /**< ranks that share the projector and the volumes; borrowed */
};

struct v2v_loss;

/** @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_loss_create(struct v2v_loss **loss,
                                const struct v2v_loss_setup *setup) V2V_MUST_CHECK;
/** @kind Collective(comm). */
void v2v_loss_destroy(struct v2v_loss **loss);

/** This rank will bring these rows of the volumes, instead of those that the projector has: they
 *  travel to it and back where they are not the same. Once.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_loss_hold(struct v2v_loss *loss, struct v2v_part rows) V2V_MUST_CHECK;

/** Judge the outputs in `outputs` (bits 1u << output): each volume is projected onto the views that
 *  it has not seen. Terms of the mean volume (de-crosstalk, axial smoothness) are shared out evenly
 *  to the outputs, so that two ranks' terms sum to one rank's.
 *  @kind   Collective(comm); the same bits for any number of ranks and threads where the projector
 *          is split by slabs
 *  @param  terms [V2V_LOSS_TERMS] out: unweighted, and their weighted sum; the same on all ranks
 *  @param  dvolume [outputs]: dL/dvolume[o] [z,rows,x], overwritten for the outputs judged
 *  @param  volume [outputs]: all volumes [z,rows,x], needed whichever output is judged
 *  @param  views [v,y,x], on all ranks
 *  @source REFERENCE.md 5 */
void v2v_loss_evaluate(struct v2v_loss *loss, double *terms, unsigned outputs,
                       float *const *dvolume, const float *const *volume, const float *views);

/** What volumes are judged by where the right one is known. */
struct v2v_volume_loss {
    const struct v2v_loss_settings *settings;
    int64_t slices, height, width;
    struct v2v_window window; /**< in which they are compared */
};

/** The mean squared difference within the window, as the term `mse`; the others are 0.
 *  @kind  Local, no allocation; the same bits with any number of threads
 *  @param terms [V2V_LOSS_TERMS] out, as above @param dvolume dL/dvolume [z,height,width] out
 *  @param volume, known [z,height,width] */
void v2v_volume_loss_evaluate(const struct v2v_volume_loss *loss, double *terms, float *dvolume,
                              const float *volume, const float *known);

/** The weights that the settings resolve to, in the order of the terms (total: 1). @kind Local. */
void v2v_loss_weights(double *weights, const struct v2v_loss_settings *settings);

/** What a term is called in configurations and logs; V2V_LOSS_TOTAL: "total". @kind Local. */
const char *v2v_loss_name(int term);

#ifdef __cplusplus
}
#endif

#endif
