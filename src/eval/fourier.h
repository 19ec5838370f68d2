#ifndef EVAL_FOURIER_H
#define EVAL_FOURIER_H

#include "v2v3d/base/status.h"
#include <stdint.h>

/** What two images have in common, by their transforms. Images lose their mean and fade out towards
 *  their edges first (Tukey window, an eighth a side). */
struct v2v_fourier;

/** For images [height,width]. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_fourier_create(struct v2v_fourier **fourier, int64_t height,
                                   int64_t width) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_fourier_destroy(struct v2v_fourier **fourier);

/** How far `image` lies from `reference`, in pixels: the place of the greatest cross-correlation
 *  within 16 pixels (a quarter of a side), by parabolas between pixels. NaN where one is flat.
 *  @kind Local, no allocation. @param shift out, y and x: image[y,x] = reference[y - shift[0],
 *  x - shift[1]] */
void v2v_fourier_shift(struct v2v_fourier *fourier, double shift[2], const float *image,
                       const float *reference);

/** Rings of equal lateral frequency, half as many as the shorter side has pixels, up to the Nyquist
 *  frequency; and the sums over a ring that correlation takes. @kind Local. */
int64_t v2v_fourier_rings(const struct v2v_fourier *fourier);
struct v2v_ring {
    double product, first, second; /**< Re a b*, |a|^2, |b|^2 */
};
/** rings[r] += those of one pair of images. @kind Local, no allocation. */
void v2v_fourier_correlate(struct v2v_fourier *fourier, struct v2v_ring *rings, const float *a,
                           const float *b);

/** The period, in pixels, from which on two volumes of half of the data each are correlated by less
 *  than 1/7; 2 where they are to the Nyquist frequency, NaN where they are nowhere. With the rings
 *  of all slices summed it is the Fourier shell correlation of the volumes over cylinders about the
 *  axial frequency (by Parseval's theorem): lateral, since depth is sampled and seen otherwise, and
 *  a sphere's shell would mix both.
 *  @kind   Local
 *  @source G. Harauz and M. van Heel, Optik 73, 146 (1986); threshold: P. B. Rosenthal and
 *          R. Henderson, J. Mol. Biol. 333, 721 (2003), R. P. J. Nieuwenhuizen et al., Nat. Methods
 *          10, 557 (2013); by direction: S. Koho et al., Nat. Commun. 10, 3103 (2019) */
double v2v_fourier_resolution(const struct v2v_ring *rings, int64_t count);

#endif
