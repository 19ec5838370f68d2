/** The step of a convex method towards the views, in closed form.
 *
 *  Purpose: argmin over x of 1/2 |A x - y|^2 + 1/2 |x - v|_P^2, without iterations, where |x|_P^2 =
 *  x^T P x (struct v2v_penalty) is tridiagonal along z for every frequency of the plane. On a torus
 *  A is a matrix of views x slices for every frequency, so that
 *      x = v + P^-1 A^H s,   (1 + A P^-1 A^H) s = y - A v,   A x = y - s
 *  takes one Hermitian inverse of views x views a frequency, made once for all frames.
 *  Invariants: the torus holds the frame at its origin and a border that no light crosses but
 *  V2V_DATA_STEP_LOST of any slice's; views are unknown there and follow the volume
 *  (v2v_data_step_extend). A rank owns rows of the torus and columns of its spectra; nothing is
 *  summed over ranks but the residual and the change. Any number of ranks gets the same bits, of
 *  v2v_data_step_coarse the same but for round-off.
 *
 *  Example (compiled by tests/unit/optics):
 *
 *      V2V_TRY(v2v_data_step_create(&step, &psf, 512, 512, &torus, V2V_SPLIT_SLABS,
 *                                   comm));
 *      v2v_data_step_factor(step, &(struct v2v_penalty){.constant = 1.0 / tau});
 *      v2v_data_step_begin(step, views, 1.0);
 *      v2v_data_step_run(step, volume);              // [slices, rows of the torus, its width]
 *      squares = v2v_data_step_extend(step);         // |A x - y|^2 over the frame
 *  done:
 *      v2v_data_step_destroy(&step);
 */
#ifndef V2V3D_OPTICS_DATA_STEP_H
#define V2V3D_OPTICS_DATA_STEP_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Of a slice's light in a view, beyond the border. */
#define V2V_DATA_STEP_LOST 1e-3

struct v2v_data_step;

struct v2v_torus {
    int64_t height, width;
    struct v2v_part rows; /**< of this rank */
};

/** Its sides for frames of [height,width]; rows: all. @kind Local. */
struct v2v_torus v2v_data_step_torus_of(const struct v2v_psf_file *psf, int64_t height,
                                        int64_t width);

/** @kind Collective(comm).
 *  @param torus as torus_of, or of the views' own sides, which then lie on it: v2v_fft_good_size
 *         keeps them, not below the PSFs'
 *  @param split V2V_SPLIT_SLABS or V2V_SPLIT_SLABS_FFTW3_MPI
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_data_step_create(struct v2v_data_step **step, const struct v2v_psf_file *psf,
                                     int64_t height, int64_t width, const struct v2v_torus *torus,
                                     enum v2v_split split,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;
/** @kind Collective(comm). */
void v2v_data_step_destroy(struct v2v_data_step **step);

/** Bytes that the fullest of `ranks` ranks holds. @kind Local. */
int64_t v2v_data_step_bytes(const struct v2v_psf_file *psf, const struct v2v_torus *torus,
                            enum v2v_split split, int ranks);

/** @kind Local. */
struct v2v_torus v2v_data_step_torus(const struct v2v_data_step *step);

/** P = constant + differences D^T D + depth Z^T Z + curvature L^T L: D the forward differences
 *  along y and x, Z those along z, L the Laplacian (1 2 1; 2 -12 2; 1 2 1) / 4. The first is above
 *  0, the others not below. */
struct v2v_penalty {
    double constant, differences, depth, curvature;
};

/** Invert 1 + A P^-1 A^H, in double precision, kept in single. @kind Local, no allocation.
 *  @cost views^3 products a frequency, eight times as dear as single ones; nothing for the same
 *  penalty as before */
void v2v_data_step_factor(struct v2v_data_step *step, const struct v2v_penalty *penalty);

/** Take the views of a frame, times `scale`; beyond it they go from edge to opposite edge in a
 *  straight line. Blind samples (tensor/blind.h) are unknown as those beyond the frame are;
 *  saturated ones (tensor/saturation.h, of each view) say what A x is at least.
 *  @kind Collective(comm), no allocation. @param views [v,height,width], whole; where any is blind
 *  or saturated borrowed until the next begin */
void v2v_data_step_begin(struct v2v_data_step *step, const float *views, double scale);

/** Take views that are known on all of the torus, [v, torus rows of this rank, torus width].
 *  @kind Collective(comm), no allocation. */
void v2v_data_step_begin_torus(struct v2v_data_step *step, const float *views);

/** The views that begin took are of a part of a plane. `seen` are those that light of all the plane
 *  gives, `volume` is what of that light is in the part: from here to the next begin y is without
 *  seen - A volume, which the weights count. Samples at the plane's `highest` are saturated, where
 *  there are weights; else none is.
 *  @kind Collective(comm), no allocation. @param volume as of run
 *  @param seen [v, torus rows of this rank, torus width]; both in units of y
 *  @param frame as of begin @param highest [v], in its units; INFINITY: none */
void v2v_data_step_surround(struct v2v_data_step *step, const float *volume, const float *seen,
                            const float *frame, const float *highest);

/** From here to the next begin views are known in these rows and columns of the torus; else in the
 *  frame. @kind Local. */
void v2v_data_step_know(struct v2v_data_step *step, const struct v2v_part *rows,
                        const struct v2v_part *columns);

/** views = A volume on the torus; what begin took stays. @kind Collective(comm), no allocation.
 *  @param views [v, torus rows of this rank, torus width] @param volume as of run */
void v2v_data_step_project(struct v2v_data_step *step, float *views, const float *volume);

/** Room for v2v_data_step_weigh. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_data_step_take_weights(struct v2v_data_step *step) V2V_MUST_CHECK;

/** From here to the next begin a sample's square counts by weight = 1 / (gain * max(A x, 0) +
 *  floor), both in units of what begin took, A x with the light around it: noise of photons, and
 *  floor > 0. Every extend then makes of y what splits A x = u off (alternating directions, with a
 *  penalty of 1),
 *      u = (weight * y + A x + p) / (weight + 1),   p <- A x + p - u,   y' = u - p
 *  so that runs and extends in turn end at the minimum of the weighted squares, whatever the
 *  weights' size. After some extends A x is that of all of them, the newest counting less and
 *  less (REFERENCE.md 10). @kind Local, after take_weights and begin. @param gain 0: of all light
 *  alike */
void v2v_data_step_weigh(struct v2v_data_step *step, double gain, double floor);

/** From here to the next begin the weights are those times sqrt(frames / unit): samples are means
 *  of more frames than others. The root, not the inverse of the variance: what is weighed against
 *  the squares is then a part of each sample's own noise (REFERENCE.md 12).
 *  @kind Local, after weigh. @param frames [v,height,width], borrowed */
void v2v_data_step_average(struct v2v_data_step *step, const float *frames, double unit);

/** x from v, in place. @kind Collective(comm), no allocation.
 *  @param  volume [slices, torus rows of this rank, torus width]: v on entry, x on return
 *  @cost   Z forward and Z inverse transforms, 2*V*Z + V^2 complex products a frequency; every OTF
 *          comes once from memory */
void v2v_data_step_run(struct v2v_data_step *step, float *volume);

/** x = 0, of v2v_data_step_advance, as after create. Nothing else changes it. @kind Local. */
void v2v_data_step_clear(struct v2v_data_step *step);

/** A step of a primal-dual method, whose x is kept here by its spectra: with g of `volume`,
 *      x' = argmin 1/2 |A x' - y|^2 + g^T x' + 1/2 |x' - x|_P^2
 *  then `volume` is 2 x' - x, and x moves to x + relax (x' - x).
 *  @kind Collective(comm), no allocation. @cost that of run, and x, read and written */
void v2v_data_step_advance(struct v2v_data_step *step, float *volume, float relax);

/** |x' - x| / |x'| of the last advance; 0 for x' = 0. @kind Collective(comm), no allocation. */
double v2v_data_step_change(struct v2v_data_step *step);

/** By the last change: the part of the torus' voxels that would hold the light of x if each had the
 *  same, (sum of x)^2 over x'^2 and how many there are; 1 for x' = 0. @kind Local. */
double v2v_data_step_filled(const struct v2v_data_step *step);

/** x of advance. @kind Collective(comm), no allocation. @param volume as of run; out */
void v2v_data_step_volume(struct v2v_data_step *step, float *volume);

/** Planes of the torus, all on every rank, from the rows of each. @kind Collective(comm), no
 *  allocation. @param whole [count,torus] out @param rows [count, rows of this rank, its width] */
void v2v_data_step_gather(struct v2v_data_step *step, float *whole, const float *rows,
                          int64_t count);

/** Where views are unknown, y becomes A x of the last run, A x' of the last advance; else, with
 *  weights, what they make of it. @kind Collective(comm), no allocation.
 *  @cost V inverse and V forward transforms. @return |A x - y|^2 where they are known, all views,
 *  y as recorded: without weights */
double v2v_data_step_extend(struct v2v_data_step *step);

/** Samples that are known, all views, of all ranks; saturated ones are not. @kind Local. */
int64_t v2v_data_step_known(const struct v2v_data_step *step);

/** Pixels of the side of a square of v2v_data_step_coarse. */
enum { V2V_DATA_STEP_SQUARE = 8 };

/** What the last extend left of y as recorded, of squares that are known as a whole: the root
 *  mean square of sums over them, over their side. Of white noise its deviation; what A x of no x
 *  explains, as of views out of register, is several times as much.
 *  @kind Collective(comm), no allocation. @return in units of y; 0: there is no whole square */
double v2v_data_step_coarse(struct v2v_data_step *step);

#ifdef __cplusplus
}
#endif

#endif
