/** Products of spectra, one block of frequencies at a time.
 *
 *  A block of all slice spectra stays in the second-level cache while the OTFs stream past it once.
 *  Inside a block real and imaginary parts lie apart, so that a product is four fused multiply-adds
 *  without shuffles.
 */
#ifndef V2V3D_SRC_OPTICS_SPECTRUM_BLOCK_H
#define V2V3D_SRC_OPTICS_SPECTRUM_BLOCK_H

#include "v2v3d/fft/fft2.h"
#include <stdint.h>

/** Frequencies of a block: 39 slices are 80 KB, below the smallest second-level cache in use
 *  (256 KB). */
#define V2V_BLOCK 256
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

/** rest = recorded - sum; both [2,V2V_BLOCK]. */
void v2v_block_rest(float *rest, const float *recorded, const double *sum);

/** slice[z,f] += conj(otf[z,f]) * view[f]. */
void v2v_block_project_adjoint(float *slice, const float *otf, const float *view, int64_t slices);

#endif
