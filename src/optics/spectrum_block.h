/** Products of spectra, one block of frequencies at a time.
 *
 *  A block is what a vector register or two hold of one number of each frequency, real and
 *  imaginary parts apart: sums stay in registers, the slices' blocks in the first-level cache, and
 *  the OTFs of all views (13 x 39: 65 KB) in the second-level one from the way there to the way
 *  back.
 */
#ifndef V2V3D_SRC_OPTICS_SPECTRUM_BLOCK_H
#define V2V3D_SRC_OPTICS_SPECTRUM_BLOCK_H

#include "v2v3d/fft/fft2.h"
#include <stdint.h>

/** Frequencies of a block: a cache line of floats. */
#define V2V_BLOCK 16
#define V2V_BLOCK_FLOATS (2 * V2V_BLOCK)

/** split[n,2,V2V_BLOCK] = `width` frequencies of n spectra that lie `stride` apart; zeros behind.
 */
void v2v_block_split(float *split, const struct v2v_complex *spectra, int64_t stride, int64_t n,
                     int64_t width);

/** The way back. */
void v2v_block_merge(struct v2v_complex *spectra, const float *split, int64_t stride, int64_t n,
                     int64_t width);

/** sum[2,V2V_BLOCK] = sum_z otf[z] * slice[z]. In double precision: sums of parts of the slices,
 *  added and rounded, are then the sum of all of them, rounded, but for one in 10^7. */
void v2v_block_project(double *sum, const float *otf, const float *slice, int64_t slices);

/** The sum, rounded. @param spectrum [width] */
void v2v_block_round(struct v2v_complex *spectrum, const double *sum, int64_t width);

/** rest[2,V2V_BLOCK] = recorded - sum_z otf[z] * slice[z], in single precision. */
void v2v_block_rest(float *rest, const float *recorded, const float *otf, const float *slice,
                    int64_t slices);

/** slice[z,f] += conj(otf[z,f]) * view[f]. */
void v2v_block_project_adjoint(float *slice, const float *otf, const float *view, int64_t slices);

/** numbers += others; both [n,2,V2V_BLOCK]. */
void v2v_block_add(float *numbers, const float *others, int64_t n);

/** step <- x - step; both [n,2,V2V_BLOCK]. */
void v2v_block_descend(float *step, const float *x, int64_t n);

/** next <- 2 next - x, and x <- x + relax (next - x).
 *  @param change [2,V2V_BLOCK]: sums over the slices of |next - x|^2 and |next|^2, times unit^2
 *  @param unit keeps squares in range */
void v2v_block_move(float *change, float *next, float *x, float relax, float unit, int64_t slices);

#endif
