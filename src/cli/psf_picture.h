#ifndef V2V_CLI_PSF_PICTURE_H
#define V2V_CLI_PSF_PICTURE_H

#include "v2v3d/io/psf_file.h"

/** Draw maximum projections of every view's PSF along z, x and y, each in its own grey range, as a
 *  PNG. @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_IO */
enum v2v_status v2v_psf_picture(const char *path, const struct v2v_psf_file *psf) V2V_MUST_CHECK;

#endif
