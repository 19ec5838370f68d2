#include "eval/preview_kinds.h"
#include "v2v3d/base/pi.h"

#include <math.h>
#include <stdio.h>

/* Pixels; a bar's text has seven characters, twice as large as the font. */
enum { GAP = 2, BAR_WIDTH = 14, BAR_GAP = 8, BAR_TEXT = 7 * 12 + 4, TEXT_ROWS = 14, INSET = 4 };
enum { MOST_TILES = 48, LEAST_LABELLED = 48 };
static const uint32_t white = 0xffffff, border = 0x404040;

/* Columns that make the picture about 4 : 3. */
static int64_t columns_of(int64_t tiles, int64_t height, int64_t width)
{
    const double best = sqrt((double)tiles * 4.0 / 3.0 * (double)height / (double)width);
    const int64_t columns = (int64_t)fmax(1.0, rint(best));
    return columns < tiles ? columns : tiles;
}

enum v2v_status v2v_preview_montage(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                    const float *volume)
{
    enum v2v_status rc = V2V_OK;
    const int64_t height = preview->height, width = preview->width;
    const int64_t tiles = preview->slices < MOST_TILES ? preview->slices : MOST_TILES;
    const int64_t columns = columns_of(tiles, height, width);
    const int64_t rows = (tiles + columns - 1) / columns;
    char label[24];
    V2V_TRY(v2v_canvas_init(canvas, rows * (height + GAP) - GAP, columns * (width + GAP) - GAP));
    v2v_canvas_fill(canvas, 0, 0, canvas->height, canvas->width, border);
    for (int64_t i = 0; i < columns * rows; i++) {
        const int64_t y = i / columns * (height + GAP), x = i % columns * (width + GAP);
        if (i >= tiles) {
            v2v_canvas_fill(canvas, y, x, height, width, 0);
            continue;
        }
        const int64_t z = i * preview->slices / tiles;
        v2v_canvas_image(canvas, y, x, volume + z * height * width, height, width,
                         (float)preview->low, (float)preview->high, 1);
        if (width >= LEAST_LABELLED && height >= LEAST_LABELLED) {
            snprintf(label, sizeof label, "%lld", (long long)z);
            v2v_canvas_text(canvas, y + 3, x + 3, label, width >= 192 ? 2 : 1, white);
        }
    }
done:
    return rc;
}

/* One channel of sRGB from linear light. */
static double encode(double light)
{
    light = fmin(fmax(light, 0.0), 1.0);
    return light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1.0 / 2.4) - 0.055;
}

/* From red at the top to blue at the bottom, all equally light: L = 0.76, C = 0.125. */
uint32_t v2v_preview_hue(int64_t z, int64_t slices, double level)
{
    const double part = slices > 1 ? (double)z / (double)(slices - 1) : 0.0;
    const double hue = (25.0 + part * 240.0) * V2V_PI / 180.0;
    const double lightness = 0.76, a = 0.125 * cos(hue), b = 0.125 * sin(hue);
    const double l = pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3.0);
    const double m = pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3.0);
    const double s = pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3.0);
    const double rgb[3] = {encode(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
                           encode(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
                           encode(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
    uint32_t colour = 0;
    for (int i = 0; i < 3; i++) {
        colour = colour << 8 | (uint32_t)rint(255.0 * rgb[i] * level);
    }
    return colour;
}

/* Which depth is which hue. */
static void draw_bar(struct v2v_canvas *canvas, const struct v2v_preview *preview)
{
    const int64_t inset = canvas->height > 3 * TEXT_ROWS ? INSET : 0;
    const int64_t x = preview->width + BAR_GAP, height = canvas->height - 2 * inset;
    const int64_t last = preview->slices - 1;
    char text[24];
    for (int64_t y = 0; y < height; y++) {
        v2v_canvas_fill(canvas, inset + y, x, 1, BAR_WIDTH,
                        v2v_preview_hue(y * preview->slices / height, preview->slices, 1.0));
    }
    for (int end = 0; end <= (inset > 0); end++) {
        if (preview->slice_spacing_um > 0.0) {
            snprintf(text, sizeof text, "%.4g um",
                     end ? (double)last * preview->slice_spacing_um : 0.0);
        } else {
            snprintf(text, sizeof text, "z %lld", end ? (long long)last : 0LL);
        }
        v2v_canvas_text(canvas, inset + (end ? height - TEXT_ROWS : 0), x + BAR_WIDTH + 4, text, 2,
                        white);
    }
}

enum v2v_status v2v_preview_depth(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                  const float *volume)
{
    enum v2v_status rc = V2V_OK;
    const int64_t width = preview->width, pixels = preview->height * width;
    const double range = fmax(preview->high - preview->low, 1e-300);
    V2V_TRY(v2v_canvas_init(canvas, preview->height, width + BAR_GAP + BAR_WIDTH + 4 + BAR_TEXT));
    for (int64_t i = 0; i < pixels; i++) {
        int64_t brightest = 0;
        for (int64_t z = 1; z < preview->slices; z++) {
            brightest = volume[z * pixels + i] > volume[brightest * pixels + i] ? z : brightest;
        }
        const double level = ((double)volume[brightest * pixels + i] - preview->low) / range;
        v2v_canvas_fill(canvas, i / width, i % width, 1, 1,
                        v2v_preview_hue(brightest, preview->slices, fmin(fmax(level, 0.0), 1.0)));
    }
    draw_bar(canvas, preview);
done:
    return rc;
}
