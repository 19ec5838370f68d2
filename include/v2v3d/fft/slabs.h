#ifndef V2V3D_FFT_SLABS_H
#define V2V3D_FFT_SLABS_H

#include "v2v3d/base/status.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Real two-dimensional transforms of frames [height,width] that zeros fill up to [ny,nx], cut over
 *  the ranks of a communicator: a rank holds some rows of every frame and some columns of every
 *  spectrum, which is stored column by column, [kx,ky].
 *
 *  Rows are transformed sixteen side by side, exchanged, and then columns likewise; what each
 *  becomes doesn't depend on those beside it: any number of ranks gets the same bits. Rows of zeros
 *  are neither transformed nor sent. Several frames go in one exchange.
 *
 *  Two back ends exchange, and change no bit: the own one is under way while the frames before and
 *  after are transformed; FFTW3-MPI's distributed transposition, which a cluster may bring tuned
 *  and which tries its ways at creation, is waited for. FFTW3-MPI's whole two-dimensional transform
 *  would transform and send the zeros too (tests/bench/bench_slabs.c compares). */
struct v2v_fft_slabs;

/** Rows, or columns, of which as many take the time of one. */
#define V2V_FFT_SIDE_BY_SIDE 16

struct v2v_fft_shape {
    int64_t height, width; /**< of a frame */
    int64_t ny, nx;        /**< of its transform: v2v_fft_good_size keeps them; not smaller */
    int64_t frames;        /**< that one call transforms, about: no exchange has room for more */
    int uses_fftw3_mpi;    /**< bool: FFTW3-MPI exchanges; on one rank nothing is exchanged */
};

/** Plan. @kind Collective(comm) (NULL: all rows and columns here), as is _destroy.
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_fft_slabs_create(struct v2v_fft_slabs **fft, const struct v2v_fft_shape *shape,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_fft_slabs_destroy(struct v2v_fft_slabs **fft);

/** Bytes that v2v_fft_slabs_create holds on the fullest of `ranks` ranks; -1 when the shape is too
 *  large to count in an int, as MPI does. @kind Local. */
int64_t v2v_fft_slabs_bytes(const struct v2v_fft_shape *shape, int ranks);

/** Frames of one exchange over `ranks` ranks. @kind Local. */
int64_t v2v_fft_slabs_batch(const struct v2v_fft_shape *shape, int ranks);

/** Rows of the frames and columns kx = 0 .. nx/2 of the spectra that this rank holds. Local. */
struct v2v_part v2v_fft_slabs_rows(const struct v2v_fft_slabs *fft);
struct v2v_part v2v_fft_slabs_columns(const struct v2v_fft_slabs *fft);

/** spectrum[kx,ky] = sum frame[y,x] exp(-2 pi i (ky y/ny + kx x/nx)) for n frames.
 *  @kind   Collective(comm), no allocation; on one rank frames are shared by the threads
 *  @param  spectra [columns of this rank,ny] each, `stride` complex numbers apart
 *  @param  frames [n, rows of this rank, width]
 *  @cost   2 * (ranks-1)/ranks^2 * n * height * (nx/2+1) * 4 bytes sent by a rank, rows and columns
 *          rounded up to multiples of ranks */
void v2v_fft_slabs_forward(struct v2v_fft_slabs *fft, struct v2v_complex *spectra, int64_t stride,
                           const float *frames, int64_t n);

/** frame[y,x] = factor * sum over the full spectrum. The spectra are kept.
 *  @kind Collective(comm), no allocation. */
void v2v_fft_slabs_inverse(struct v2v_fft_slabs *fft, float *frames, float factor,
                           const struct v2v_complex *spectra, int64_t stride, int64_t n);

/** This rank's columns of the spectrum of an image that it has as a whole: rows `first` ..
 *  first+count-1 (modulo ny) of it are not zero. @kind Local, thread-safe.
 *  @param spectrum [columns of this rank,ny] @param rows [count,nx] */
void v2v_fft_slabs_local(const struct v2v_fft_slabs *fft, struct v2v_complex *spectrum,
                         const float *rows, int64_t first, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
