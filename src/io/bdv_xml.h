/** The XML that BigDataViewer opens. */
#ifndef V2V_IO_BDV_XML_H
#define V2V_IO_BDV_XML_H

#include "v2v3d/io/bdv.h"

/** @kind Local. @param data the HDF5 file; the XML names it as one that lies beside it
 *  @return V2V_OK | V2V_E_IO | V2V_E_MEMORY */
enum v2v_status v2v_bdv_write_xml(const char *path, const char *data,
                                  const struct v2v_volume_info *info) V2V_MUST_CHECK;

#endif
