/** Pictures: one frame of a volume; several side by side. */
#ifndef V2V_CLI_PICTURE_H
#define V2V_CLI_PICTURE_H

#include "v2v3d/eval/preview.h"
#include "v2v3d/io/volume.h"

/** Does a picture's name say that it is one? @kind Local. @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_picture_check_name(const char *path) V2V_MUST_CHECK;

/** Pixels a slice that make voxels look as they are, 2 when sizes are not stated. @kind Local */
int v2v_picture_z_zoom(const struct v2v_volume_info *info);

/** Maximum projections of frame t of an open volume. @kind Local */
enum v2v_status v2v_picture_frame(struct v2v_canvas *canvas, struct v2v_volume *volume, int64_t t,
                                  int z_zoom, double low, double high) V2V_MUST_CHECK;

/** `count` pictures in rows of `columns`, each `zoom` times as large, under its label.
 *  @kind Local */
enum v2v_status v2v_picture_grid(struct v2v_canvas *canvas, const struct v2v_canvas *parts,
                                 const char *const *labels, int64_t count, int64_t columns,
                                 int zoom) V2V_MUST_CHECK;

#endif
