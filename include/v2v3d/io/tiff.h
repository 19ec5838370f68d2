#ifndef V2V3D_IO_TIFF_H
#define V2V3D_IO_TIFF_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** What this program keeps of a volume in the tag `Software`: attributes that HDF5 files have, as
 *  text; "" where the file does not say. */
struct v2v_tiff_told {
    char task[32];          /**< V2V_VOLUME_TASK */
    char first_frame[32];   /**< V2V_VOLUME_FIRST_FRAME */
    char recording_sum[32]; /**< V2V_VOLUME_RECORDING */
    char offset[32];        /**< V2V_VOLUME_OFFSET */
};

/** What a TIFF stack says of itself. Lengths are 0 where the file does not say. */
struct v2v_tiff_info {
    int64_t pages, height, width;
    /** By ImageJ's description, OME-XML, or tifffile's shape; product = pages; without a word, or
     *  where ImageJ's contradicts the pages, all are slices. For writing 0 means 1. */
    int64_t channels, slices, frames;
    int bits; /**< 8, 16 or 32 */
    int is_float;
    double type_max; /**< 255, 65535, 4294967295; 1 for float, and where there is a scale */
    double pixel_size_um, slice_spacing_um, frame_interval_s;
    int is_ome;    /**< of a file to write: described by OME-XML, not as ImageJ does */
    int is_packed; /**< likewise: written under the very name given, whose output the caller holds
                        the lock of, and left there: v2v_file_packed */
    double step;   /**< between integers that this program made of voxels; else 0 */
    /** ImageJ's calibration of 8- and 16-bit samples by a straight line: a value is zero + scale
     *  times what is stored. scale 0: there is none, or the step goes before it, or is_curved: it
     *  is no straight line, and not used. Of a file that is read. */
    double zero, scale;
    int is_curved; /**< bool */
    int is_own;    /**< bool: this program wrote it, so that one slice, or frame, is what is meant;
                        other programs call any row of pages so. Of a file that is read. */
    struct v2v_tiff_told told;
};

struct v2v_tiff;

/** Open and check a stack: every page has the same size and type; u8, u16, u32 and f32, one sample
 * a pixel, strips or tiles, no compression, deflate, LZW, PackBits or Zstandard; both byte orders;
 * BigTIFF; ImageJ's single-IFD files above 4 GB. No page of more than 2^31-1 pixels, and none that
 * declares more than its bytes in the file can decode to.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (names file, page, reason) | V2V_E_MEMORY */
enum v2v_status v2v_tiff_open(struct v2v_tiff **tiff, const char *path) V2V_MUST_CHECK;
const struct v2v_tiff_info *v2v_tiff_info(const struct v2v_tiff *tiff);

/** Pages first .. first+count-1, c fastest, then z, then t, whatever their order in the file, as
 *  float32 in the file's own units: those of ImageJ's calibration where there is a scale.
 *  @kind Local. @param out [count,y,x]
 *  @return V2V_OK | V2V_E_INPUT (page, reason; also NaN or Inf: page and pixel; also a page that
 *  this program wrote and that is no longer as it was) */
enum v2v_status v2v_tiff_read(struct v2v_tiff *tiff, float *out, int64_t first,
                              int64_t count) V2V_MUST_CHECK;
void v2v_tiff_close(struct v2v_tiff **tiff);

/** Does the name end in .ome.tif or .ome.tiff? @kind Local. */
int v2v_tiff_is_ome_name(const char *path);

/** Write [t,z,y,x] page by page as an ImageJ hyperstack or OME-TIFF with voxel size: float32, or
 *  where info->bits is 16 unsigned integers, whose pages come as whole numbers 0 .. 65535; BigTIFF
 *  when the data pass 4 GB. Every page's name is its checksum (CRC-32C). The file appears under
 *  `path` only at v2v_tiff_finish, which also frees the writer when it fails; after a failed page
 *  call v2v_tiff_abandon. @kind Local. @return V2V_OK | V2V_E_BUSY (another process writes this
 *  file) | V2V_E_INPUT (a shape that cannot be) | V2V_E_IO | V2V_E_MEMORY | V2V_E_INTERNAL (more or
 *  fewer pages than announced) */
struct v2v_tiff_writer;
enum v2v_status v2v_tiff_create(struct v2v_tiff_writer **writer, const char *path,
                                const struct v2v_tiff_info *info) V2V_MUST_CHECK;
enum v2v_status v2v_tiff_write_page(struct v2v_tiff_writer *writer,
                                    const float *page) V2V_MUST_CHECK;
enum v2v_status v2v_tiff_finish(struct v2v_tiff_writer **writer) V2V_MUST_CHECK;
/** Drop an unfinished file; accepts NULL. */
void v2v_tiff_abandon(struct v2v_tiff_writer **writer);

#ifdef __cplusplus
}
#endif

#endif
