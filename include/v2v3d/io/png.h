#ifndef V2V3D_IO_PNG_H
#define V2V3D_IO_PNG_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Write an 8-bit picture. @kind Local. @param pixels [y,x,channels], channels 1 (grey) or 3 (RGB)
 *  @return V2V_OK | V2V_E_IO | V2V_E_INPUT (a name too long) */
enum v2v_status v2v_png_write(const char *path, const uint8_t *pixels, int64_t height,
                              int64_t width, int channels) V2V_MUST_CHECK;

/** A canvas to draw on: pictures of projections. Caller's struct, heap pixels. */
struct v2v_canvas {
    int64_t height, width;
    uint8_t *rgb; /**< [y,x,3], black at first */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY; _fini after both */
enum v2v_status v2v_canvas_init(struct v2v_canvas *canvas, int64_t height,
                                int64_t width) V2V_MUST_CHECK;
void v2v_canvas_fini(struct v2v_canvas *canvas);

/** Grey image [h,w] mapped from [low, high] to black..white with its corner at (y, x), each pixel
 *  repeated `zoom` times. Clipped to the canvas. @kind Local. */
void v2v_canvas_image(struct v2v_canvas *canvas, int64_t y, int64_t x, const float *image,
                      int64_t height, int64_t width, float low, float high, int zoom);

/** A rectangle, and text in a built-in 5x7 font of printable ASCII (scaled by `zoom`,
 *  6 x zoom pixels a character); rgb is 0xRRGGBB. Clipped to the canvas. @kind Local. */
void v2v_canvas_fill(struct v2v_canvas *canvas, int64_t y, int64_t x, int64_t height, int64_t width,
                     uint32_t rgb);
void v2v_canvas_text(struct v2v_canvas *canvas, int64_t y, int64_t x, const char *text, int zoom,
                     uint32_t rgb);

#ifdef __cplusplus
}
#endif

#endif
