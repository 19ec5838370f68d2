#ifndef V2V3D_CONF_CALIBRATION_H
#define V2V3D_CONF_CALIBRATION_H

#include "v2v3d/base/field.h"
#include "v2v3d/base/status.h"
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Bounds of a view's gain. */
#define V2V_LEAST_GAIN 1e-3
#define V2V_MOST_GAIN 1e3
/** .. and so many pixels of a displacement. */
#define V2V_MOST_PIXELS 64.0

/** How the views of a microscope differ from what its PSFs say, in a YAML file. A view shows
 *      gain * exp(shading) * (its projection, displaced by shift + slope * depth)
 *  displaced by distortion, with depth -1 in the first slice, 1 in the last one, and shading and
 *  distortion fields over the frame (base/field.h). */
struct v2v_view_calibration {
    double gain;
    double shift[2];                      /**< y, x; pixels */
    double slope[2];                      /**< y, x; pixels from the middle slice to the last */
    double distortion_y[V2V_FIELD_TERMS]; /**< pixels */
    double distortion_x[V2V_FIELD_TERMS]; /**< pixels */
    double shading[V2V_FIELD_TERMS];      /**< natural logarithm */
};

struct v2v_calibration {
    int64_t views;
    int64_t height, width;             /**< of the frames that it was made from */
    struct v2v_view_calibration *view; /**< [views], owned; NULL: none, nothing differs */
    int64_t *number;                   /**< [views], owned: of the set's (conf/kept_views.h) */
};

/** Views as the PSFs say. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_calibration_init(struct v2v_calibration *calibration, int64_t views,
                                     int64_t height, int64_t width) V2V_MUST_CHECK;
void v2v_calibration_fini(struct v2v_calibration *calibration);

/** @kind Local: any number of ranks may read one file.
 *  @return V2V_OK | V2V_E_CONFIG (names file, line and key) | V2V_E_MEMORY */
enum v2v_status v2v_calibration_read(struct v2v_calibration *calibration,
                                     const char *path) V2V_MUST_CHECK;

/** Without the views that are not used: what is left are those that are.
 *  @kind Local. @param without see conf/kept_views.h @param path names the file in the message
 *  @return V2V_OK | V2V_E_CONFIG (one that is used has no calibration) */
enum v2v_status v2v_calibration_leave(struct v2v_calibration *calibration, const char *without,
                                      const char *path) V2V_MUST_CHECK;

/** Is it made for frames of these views and, where it has shading or distortion, of this size?
 *  @kind Local. @param what names the frames in the message @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_calibration_check(const struct v2v_calibration *calibration, int64_t views,
                                      int64_t height, int64_t width,
                                      const char *what) V2V_MUST_CHECK;

/** Is a view distorted? And is one distorted or shaded? @kind Local. */
int v2v_calibration_has_distortion(const struct v2v_calibration *calibration);
int v2v_calibration_has_fields(const struct v2v_calibration *calibration);

/** Are all numbers within the bounds that a file of them is read by? @kind Local. */
int v2v_calibration_is_within_bounds(const struct v2v_calibration *calibration);

/** As such a file. @kind Local. */
void v2v_calibration_print(const struct v2v_calibration *calibration, FILE *stream);

#ifdef __cplusplus
}
#endif

#endif
