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

/** split[n,2,V2V_BLOCK] = block of n spectra that lie `stride` apart. */
void v2v_block_split(float *split, const struct v2v_complex *spectra, int64_t stride, int64_t n);

/** The way back. */
void v2v_block_merge(struct v2v_complex *spectra, const float *split, int64_t stride, int64_t n);

/** sum[f] = sum_z otf[z,f] * slice[z,f], summed in the order of z. */
void v2v_block_project(float *sum, const float *otf, const float *slice, int64_t slices);

/** slice[z,f] += conj(otf[z,f]) * view[f]. */
void v2v_block_project_adjoint(float *slice, const float *otf, const float *view, int64_t slices);

#endif
