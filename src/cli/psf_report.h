#ifndef V2V_CLI_PSF_REPORT_H
#define V2V_CLI_PSF_REPORT_H

#include "v2v3d/io/psf_file.h"
#include "v2v3d/optics/shifts.h"
#include <stdio.h>

/** Print what a PSF set looks like: sizes, a line a view, a line a slice, warnings.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_psf_report(FILE *stream, const char *name, const struct v2v_psf_file *psf,
                               const struct v2v_shifts *shifts) V2V_MUST_CHECK;

/** Its warnings alone: of PSFs that are cut off, dark, alike or off-centre.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_psf_report_warnings(FILE *stream,
                                        const struct v2v_psf_file *psf) V2V_MUST_CHECK;

#endif
