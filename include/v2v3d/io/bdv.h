#ifndef V2V3D_IO_BDV_H
#define V2V3D_IO_BDV_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/volume.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Does the name end in .xml? @kind Local. */
int v2v_bdv_is_name(const char *path);

/** The HDF5 file beside an XML: NAME.xml, NAME.bdv.h5.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (too long) */
enum v2v_status v2v_bdv_data_name(char data[V2V_PATH_BYTES], const char *path) V2V_MUST_CHECK;

/** A level of the pyramid: every `factor` voxels of the whole are one here; axes x, y, z. */
struct v2v_bdv_level {
    int64_t factor[3], size[3], block[3];
};
enum { V2V_BDV_MOST_LEVELS = 16 };

/** Levels of a volume: x and y are halved until both are at most 128, and z with them where its
 *  voxels are not longer than theirs. @kind Local. @return how many */
int v2v_bdv_levels(struct v2v_bdv_level level[V2V_BDV_MOST_LEVELS],
                   const struct v2v_volume_info *info);

/** Write a volume for BigDataViewer: HDF5 of uint16 (which it stores as int16) with a pyramid of
 *  means, and the XML that names it. A volume's step is written as of V2V_VOLUME_STEP.
 *  @kind Rank-0, of a volume that is open on all ranks. @param storage its peak and compression
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_IO | V2V_E_BUSY | V2V_E_MEMORY
 *  @cost a frame of floats and one of integers; reads the volume twice unless there is a peak
 *  @source Pietzsch et al., Nature Methods 12, 481-483 (2015); https://imagej.net/plugins/bdv */
enum v2v_status v2v_bdv_write(const char *path, struct v2v_volume *volume,
                              const struct v2v_volume_storage *storage) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
