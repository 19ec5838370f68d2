#ifndef V2V3D_OPTICS_PSF_FIGURES_H
#define V2V3D_OPTICS_PSF_FIGURES_H

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

/** Of two PSFs or parts of them, a b / (|a| |b|); 0 where one is dark. @kind Local. */
double v2v_psf_correlation(const float *a, const float *b, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
