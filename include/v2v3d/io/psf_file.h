#ifndef V2V3D_IO_PSF_FILE_H
#define V2V3D_IO_PSF_FILE_H

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** PSFs as stored: [v,z,y,x]. */
struct v2v_psf_file {
    int64_t views, slices, height, width;
    double pixel_size_um, slice_spacing_um; /**< 0: not stated */
    float *data;                            /**< owned */
};

/** Read a PSF set, but for the views that `without` lists (conf/kept_views.h; "": all): folder
 *  of psf_1.tif .. psf_V.tif (all of one shape, none missing in the row; also psf_01.TIFF and the
 *  like, but one of a view), or HDF5 `/psf` [v,z,y,x]. What else begins with psf_ is warned of.
 *  Rank 0 reads, all get it.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_INPUT (unreadable, shapes differ, NaN, negative,
 *  an all-zero view) | V2V_E_CONFIG (of `without`) | V2V_E_MEMORY; agreed */
enum v2v_status v2v_psf_file_read(struct v2v_psf_file *file, const char *path, const char *without,
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Is it a folder that holds a psf_1.tif, however its number and ending are spelt? @kind Local. */
int v2v_psf_file_is_folder(const char *path);

/** Write HDF5. @kind Local (one rank). @return V2V_OK | V2V_E_IO | V2V_E_INPUT (a name too long) |
 *  V2V_E_USAGE (a name of another kind of file, as .tif) */
enum v2v_status v2v_psf_file_write(const struct v2v_psf_file *file,
                                   const char *path) V2V_MUST_CHECK;

/** CRC-32C of `data` as it is now, normalised or not; 0 without it. @kind Local. */
uint32_t v2v_psf_file_sum(const struct v2v_psf_file *file);

/** @kind Local. */
void v2v_psf_file_fini(struct v2v_psf_file *file);

#ifdef __cplusplus
}
#endif

#endif
