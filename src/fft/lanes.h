/** Transforms of sixteen signals side by side, a lane of the processor's vectors each.
 *
 *  A row or a column alone leaves a library no more than shuffles to fill vectors with. Of as many
 *  as a vector has lanes every step is the same, on numbers that lie side by side: [n,lane], real
 *  and imaginary parts apart. What a lane gets doesn't depend on which one it is, nor on what is in
 *  the others. Beside FFTW: tests/bench/speed.md.
 */
#ifndef V2V3D_SRC_FFT_LANES_H
#define V2V3D_SRC_FFT_LANES_H

#include "v2v3d/base/status.h"
#include "v2v3d/fft/slabs.h"
#include <stdint.h>

#define V2V_LANES V2V_FFT_SIDE_BY_SIDE

/** A plan; run by any number of threads, on lanes of their own. */
struct v2v_fft_lanes;

/** Signals, and room for as many: steps go from one to the other, and change their names. */
struct v2v_lanes {
    float *re, *im;             /* [n,V2V_LANES] */
    float *other_re, *other_im; /* likewise */
};

/** Of n numbers, whose factors are 2, 3, 5, 7 only. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_fft_lanes_create(struct v2v_fft_lanes **plan, int64_t n) V2V_MUST_CHECK;
void v2v_fft_lanes_destroy(struct v2v_fft_lanes **plan);
int64_t v2v_fft_lanes_bytes(int64_t n);

/** lanes[k] = sum over x of lanes[x] exp(-2 pi i k x / n). Local, thread-safe, as are all. */
void v2v_fft_lanes_forward(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes);

/** With exp(+2 pi i k x / n). */
void v2v_fft_lanes_inverse(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes);

/** Real signals of 2 n samples as n numbers, re and im in turn, and their spectra of n+1: of the
 *  plan for n. The inverse is unnormalised, and takes no note of im in the first and last number.
 */
void v2v_fft_lanes_real_forward(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes);
void v2v_fft_lanes_real_inverse(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes);

/** re[i,s], im[i,s] = number i of signal s at from + s * stride; zeros in lanes without a signal.
 *  @param stride floats */
void v2v_lanes_take(float *re, float *im, const float *from, int64_t stride, int64_t n,
                    int64_t signals);

/** The way back, times `factor`. */
void v2v_lanes_give(float *to, int64_t stride, const float *re, const float *im, float factor,
                    int64_t n, int64_t signals);

/** Likewise where number i of all signals lies at from + i * stride. @param stride numbers */
void v2v_lanes_take_beside(float *re, float *im, const struct v2v_complex *from, int64_t stride,
                           int64_t n, int64_t signals);
void v2v_lanes_give_beside(struct v2v_complex *to, int64_t stride, const float *re, const float *im,
                           int64_t n, int64_t signals);

#endif
