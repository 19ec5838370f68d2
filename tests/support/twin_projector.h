/** Plain loops in double precision over the formula of REFERENCE.md 2: what the fast projector is
 *  held against. */
#ifndef V2V_TEST_TWIN_PROJECTOR_H
#define V2V_TEST_TWIN_PROJECTOR_H

#include <stdint.h>

struct twin_shape {
    int64_t slices;
    int64_t kernel_height, kernel_width; /**< of a PSF slice */
    int64_t height, width;               /**< of a frame */
};

/** view[y,x] = sum_z sum_{y2,x2} volume[z,y2,x2] * psf[z, y-y2+c, x-x2+c]. One view. */
void twin_project(double *view, const double *volume, const float *psf,
                  const struct twin_shape *shape);

/** volume[z,y2,x2] += sum_{y,x} view[y,x] * psf[z, y-y2+c, x-x2+c]. One view. */
void twin_project_adjoint(double *volume, const double *view, const float *psf,
                          const struct twin_shape *shape);

/** One pixel of a view, and one voxel of its back-projection, of arrays in single precision. */
double twin_pixel(const float *volume, const float *psf, const struct twin_shape *shape, int64_t y,
                  int64_t x);
double twin_voxel(const float *view, const float *psf, const struct twin_shape *shape, int64_t z,
                  int64_t y2, int64_t x2);

#endif
