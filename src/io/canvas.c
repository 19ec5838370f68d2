#include "v2v3d/io/png.h"

#include "io/font.h"
#include "v2v3d/base/memory.h"

#include <string.h>

enum v2v_status v2v_canvas_init(struct v2v_canvas *canvas, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;

    *canvas = (struct v2v_canvas){.height = height, .width = width};
    V2V_TRY(V2V_ALLOC(canvas->rgb, "io.canvas", v2v_mem_product(height, width, 3)));
done:
    return rc;
}

void v2v_canvas_fini(struct v2v_canvas *canvas)
{
    v2v_mem_free(canvas->rgb);
    *canvas = (struct v2v_canvas){0};
}

static void set_pixel(struct v2v_canvas *canvas, int64_t y, int64_t x, uint32_t rgb)
{
    if (y < 0 || y >= canvas->height || x < 0 || x >= canvas->width) {
        return;
    }
    uint8_t *pixel = canvas->rgb + (y * canvas->width + x) * 3;
    pixel[0] = (uint8_t)(rgb >> 16);
    pixel[1] = (uint8_t)(rgb >> 8);
    pixel[2] = (uint8_t)rgb;
}

void v2v_canvas_fill(struct v2v_canvas *canvas, int64_t y0, int64_t x0, int64_t height,
                     int64_t width, uint32_t rgb)
{
    for (int64_t y = y0; y < y0 + height; y++) {
        for (int64_t x = x0; x < x0 + width; x++) {
            set_pixel(canvas, y, x, rgb);
        }
    }
}

void v2v_canvas_image(struct v2v_canvas *canvas, int64_t y0, int64_t x0, const float *image,
                      int64_t height, int64_t width, float low, float high, int zoom)
{
    const float scale = high > low ? 255 / (high - low) : 0;

    for (int64_t y = 0; y < height; y++) {
        for (int64_t x = 0; x < width; x++) {
            float grey = (image[y * width + x] - low) * scale;
            /* NaN fails both comparisons and is black. */
            uint32_t level = grey >= 255 ? 255 : grey > 0 ? (uint32_t)(grey + 0.5F) : 0;
            v2v_canvas_fill(canvas, y0 + y * zoom, x0 + x * zoom, zoom, zoom, level * 0x010101U);
        }
    }
}

void v2v_canvas_text(struct v2v_canvas *canvas, int64_t y0, int64_t x0, const char *text, int zoom,
                     uint32_t rgb)
{
    for (; *text != '\0'; text++, x0 += (int64_t)(V2V_FONT_COLUMNS + 1) * zoom) {
        const uint8_t *glyph = v2v_font_glyph(*text);
        for (int64_t y = 0; y < V2V_FONT_ROWS; y++) {
            for (int64_t x = 0; x < V2V_FONT_COLUMNS; x++) {
                if (glyph[y] >> (V2V_FONT_COLUMNS - 1 - x) & 1) {
                    v2v_canvas_fill(canvas, y0 + y * zoom, x0 + x * zoom, zoom, zoom, rgb);
                }
            }
        }
    }
}
