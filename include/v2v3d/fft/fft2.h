/** Real two-dimensional Fourier transforms, planned once.
 *
 *  Purpose: the only room that speaks FFTW. Single precision; FFTW_ESTIMATE plans here and steps of
 *  the room's own in slabs.h, so that the same machine repeats the same bits; only what moves
 *  numbers between ranks is planned by measuring.
 *  Invariants: nothing is planned or allocated inside forward or inverse; transforms are not
 *  normalised (inverse(forward(x)) = ny*nx * x); spectra are half spectra [ny, nx/2+1].
 *
 *  Example (compiled by tests/unit/fft):
 *
 *      struct v2v_fft2 *fft = NULL;
 *      V2V_TRY(v2v_fft2_create(&fft, v2v_fft_good_size(500), v2v_fft_good_size(500)));
 *      v2v_fft2_forward(fft, spectrum, image);
 *      v2v_fft2_inverse(fft, image, spectrum);
 *  done:
 *      v2v_fft2_destroy(&fft);
 */
#ifndef V2V3D_FFT_FFT2_H
#define V2V3D_FFT_FFT2_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** One complex number as two floats, so that the header stays usable from C++. */
struct v2v_complex {
    float re, im;
};

struct v2v_fft2;

/** The smallest n' >= n with factors 2, 3, 5, 7 only, even. @kind Local. */
int64_t v2v_fft_good_size(int64_t n);

/** Plan transforms of [ny,nx] images, run by the calling thread alone: many run side by side from
 *  OpenMP threads on one plan. @kind Local, not thread-safe. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_fft2_create(struct v2v_fft2 **fft, int64_t ny, int64_t nx) V2V_MUST_CHECK;
void v2v_fft2_destroy(struct v2v_fft2 **fft);

/** spectrum[ky,kx] = sum image[y,x] exp(-2 pi i (ky y/ny + kx x/nx)). Arrays come from
 * v2v_mem_alloc (64-byte aligned). @kind Local, thread-safe. @param spectrum [ny,nx/2+1] @param
 * image [ny,nx], kept */
void v2v_fft2_forward(const struct v2v_fft2 *fft, struct v2v_complex *spectrum, float *image);

/** image[y,x] = sum over the full spectrum, unnormalised; the half spectrum is destroyed.
 *  @kind Local, thread-safe. */
void v2v_fft2_inverse(const struct v2v_fft2 *fft, float *image, struct v2v_complex *spectrum);

#ifdef __cplusplus
}
#endif

#endif
