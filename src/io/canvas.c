#include "v2v3d/io/png.h"

#include "io/font.h"
#include "v2v3d/base/memory.h"

#include <stdlib.h>
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

static void set_square(struct v2v_canvas *canvas, int64_t y0, int64_t x0, int side, uint32_t rgb)
{
    for (int64_t y = y0; y < y0 + side; y++) {
        for (int64_t x = x0; x < x0 + side; x++) {
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
            set_square(canvas, y0 + y * zoom, x0 + x * zoom, zoom, level * 0x010101U);
        }
    }
}

/* Bresenham's error term, for all directions (J. E. Bresenham, IBM Systems Journal 4, 1965). */
void v2v_canvas_line(struct v2v_canvas *canvas, int64_t y0, int64_t x0, int64_t y1, int64_t x1,
                     uint32_t rgb)
{
    const int64_t height = llabs(y1 - y0);
    const int64_t width = llabs(x1 - x0);
    const int64_t step_y = y1 > y0 ? 1 : -1;
    const int64_t step_x = x1 > x0 ? 1 : -1;
    int64_t error = width - height;
    int64_t y = y0;
    int64_t x = x0;

    for (int64_t left = width > height ? width : height; left >= 0; left--) {
        set_pixel(canvas, y, x, rgb);
        int64_t twice = 2 * error;
        if (twice >= -height) {
            error -= height;
            x += step_x;
        }
        if (twice <= width) {
            error += width;
            y += step_y;
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
                    set_square(canvas, y0 + y * zoom, x0 + x * zoom, zoom, rgb);
                }
            }
        }
    }
}
