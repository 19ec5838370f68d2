/** A volume that all ranks write into one TIFF: rank 0 collects the slices and keeps the pages in
 *  order. */
#ifndef V2V_IO_VOLUME_TIFF_H
#define V2V_IO_VOLUME_TIFF_H

#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"

struct v2v_volume_tiff;

/** What else a file is. */
struct v2v_volume_tiff_plan {
    int is_ome, is_packed; /**< as of struct v2v_tiff_info */
    double step;           /**< of integers, which come as whole numbers 0 .. 65535; 0: floats */
    struct v2v_tiff_told told;
};

/** What a TIFF keeps of attributes. @kind Local. @return V2V_OK | V2V_E_INPUT (one is too long) */
enum v2v_status v2v_tiff_told_of(struct v2v_tiff_told *told, const struct v2v_attribute *attributes,
                                 int64_t count) V2V_MUST_CHECK;

/** @kind Collective(comm).
 *  @return V2V_OK | V2V_E_IO | V2V_E_MEMORY; agreed */
enum v2v_status v2v_volume_tiff_create(struct v2v_volume_tiff **tiff, const char *path,
                                       const struct v2v_volume_info *info,
                                       const struct v2v_volume_tiff_plan *plan,
                                       const struct v2v_comm *comm) V2V_MUST_CHECK;

/** As v2v_volume_write. @kind Collective(comm) */
enum v2v_status v2v_volume_tiff_write(struct v2v_volume_tiff *tiff, const float *slices, int64_t t,
                                      int64_t first, int64_t count) V2V_MUST_CHECK;

/** *tiff is NULL afterwards. @kind Collective(comm). @return V2V_OK | V2V_E_IO (also: a frame was
 *  not written); agreed */
enum v2v_status v2v_volume_tiff_finish(struct v2v_volume_tiff **tiff) V2V_MUST_CHECK;

/** Is the file this volume, of this task, every page as it was written? @kind Local.
 *  @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_volume_tiff_check(const char *path, const struct v2v_volume_info *info,
                                      const char *task) V2V_MUST_CHECK;

/** @kind Local; accepts NULL. */
void v2v_volume_tiff_abandon(struct v2v_volume_tiff **tiff);

#endif
