#ifndef V2V3D_OPTICS_PSF_FIGURES_H
#define V2V3D_OPTICS_PSF_FIGURES_H

#include "v2v3d/io/psf_file.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** One PSF slice in figures. */
struct v2v_slice_figures {
    double energy;
    double y, x;     /**< centroid, pixels from the PSF's centre; 0 of a dark slice */
    double border;   /**< energy in the outermost ring */
    int64_t support; /**< pixels of the brightest that hold 99.9 % of the energy */
};

/** @kind Local. @param slice [y,x] */
struct v2v_slice_figures v2v_slice_figures_of(const float *slice, int64_t height, int64_t width);

/** The part of the light that a constant background makes: each slice's darkest border pixel times
 *  its pixels. 0 below a twentieth, and in windows of less than 16 pixels, which light may fill.
 *  Measured and simulated PSFs have less than 1e-4; a thousandth of the brightest pixel makes 0.6
 *  to 0.97, and volumes 10 dB worse. @kind Local. */
double v2v_psf_pedestal(const struct v2v_psf_file *psf);

/** Of two PSFs or parts of them, a b / (|a| |b|); 0 where one is dark. @kind Local. */
double v2v_psf_correlation(const float *a, const float *b, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
