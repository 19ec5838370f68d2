/** How much of each voxel a view sees, A_v^T 1, and how much of the volume each pixel sees, A_v 1.
 *
 *  With ones for a view, the correlation is the PSF summed over the rectangle that falls inside the
 *  frame, which summed-area tables answer without a transform and in K*K instead of y*x numbers per
 *  view and slice (67 MB instead of 0.5 GB for 13 views of 39 slices of 512 x 512). */
#ifndef METHOD_SENSITIVITY_H
#define METHOD_SENSITIVITY_H

#include "v2v3d/io/psf_file.h"
#include "v2v3d/par/comm.h"

struct v2v_sensitivity {
    int64_t views, height, width;        /* of the frames */
    int64_t kernel_height, kernel_width; /* of the PSFs */
    struct v2v_part slices;              /* those tabulated */
    double *table; /* [v, slice, ky 0..K, kx 0..K]: PSF summed over < ky, < kx */
    double *total; /* [v]: PSF summed over all slices, rows, columns */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_sensitivity_init(struct v2v_sensitivity *sensitivity,
                                     const struct v2v_psf_file *psf, struct v2v_part slices,
                                     int64_t height, int64_t width) V2V_MUST_CHECK;
void v2v_sensitivity_fini(struct v2v_sensitivity *sensitivity);

/** row[x] = (A_v^T 1)[slice z of those tabulated, y, x]. @kind Local, thread-safe.
 *  @param row [x] out; its values are >= 0 up to round-off of double precision */
void v2v_sensitivity_row(const struct v2v_sensitivity *sensitivity, double *row, int64_t v,
                         int64_t z, int64_t y);

/** light[y,x] = (A_v 1)[first + y, x] for `rows` rows of view v: what a volume of ones gives to its
 *  pixels, over all slices of the set. @kind Local.
 *  @param table [ky 0..K, kx 0..K] scratch @param light [rows,x] out; round-off as above */
void v2v_sensitivity_light(const struct v2v_sensitivity *sensitivity, double *light,
                           const struct v2v_psf_file *psf, int64_t v, struct v2v_part rows,
                           double *table);

#endif
