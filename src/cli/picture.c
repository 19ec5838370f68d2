#include "cli/picture.h"

#include "v2v3d/base/memory.h"
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { GAP = 8, LABEL_ROWS = 24, LABEL_ZOOM = 2, ZOOM = 2 };
static const uint32_t white = 0xffffff, grey = 0x808080, orange = 0xffa030;

int v2v_picture_z_zoom(const struct v2v_volume_info *info)
{
    if (info->pixel_size_um <= 0.0 || info->slice_spacing_um <= 0.0) {
        return 2;
    }
    double zoom = info->slice_spacing_um / info->pixel_size_um;
    return zoom < 1.5 ? 1 : zoom > 16.0 ? 16 : (int)(zoom + 0.5);
}

enum v2v_status v2v_picture_frame(struct v2v_canvas *canvas, struct v2v_volume *volume, int64_t t,
                                  int z_zoom, double low, double high)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    float *voxels = NULL;
    V2V_TRY(V2V_ALLOC(voxels, "picture.volume",
                      v2v_mem_product(info->slices, info->height, info->width)));
    V2V_TRY(v2v_volume_read(volume, voxels, t, 0, info->slices));
    V2V_TRY(v2v_preview_volume(canvas, voxels, info->slices, info->height, info->width, z_zoom, low,
                               high));
done:
    v2v_mem_free(voxels);
    return rc;
}

/* A part with each pixel repeated ZOOM x ZOOM. */
static void blit(struct v2v_canvas *canvas, const struct v2v_canvas *part, int64_t y0, int64_t x0)
{
    for (int64_t y = 0; y < part->height * ZOOM; y++) {
        uint8_t *to = canvas->rgb + ((y0 + y) * canvas->width + x0) * 3;
        for (int64_t x = 0; x < part->width * ZOOM; x++) {
            memcpy(to + x * 3, part->rgb + (y / ZOOM * part->width + x / ZOOM) * 3, 3);
        }
    }
}

enum v2v_status v2v_picture_row(struct v2v_canvas *canvas, const struct v2v_canvas *parts,
                                const char *const *labels, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    int64_t height = 0, width = GAP;
    for (int64_t i = 0; i < count; i++) {
        height = parts[i].height > height ? parts[i].height : height;
        width += parts[i].width * ZOOM + GAP;
    }
    V2V_TRY(v2v_canvas_init(canvas, height * ZOOM + LABEL_ROWS + GAP, width));
    int64_t x = GAP;
    for (int64_t i = 0; i < count; i++) {
        v2v_canvas_text(canvas, GAP / 2, x, labels[i], LABEL_ZOOM, white);
        blit(canvas, &parts[i], LABEL_ROWS, x);
        x += parts[i].width * ZOOM + GAP;
    }
done:
    return rc;
}

static void label_value(struct v2v_canvas *canvas, int64_t y, int64_t x, double value)
{
    char text[32];
    snprintf(text, sizeof text, "%.4g", value);
    v2v_canvas_text(canvas, y, x, text, 1, grey);
}

enum v2v_status v2v_picture_curve(struct v2v_canvas *canvas, const double *y, int64_t count,
                                  double last, const char *title)
{
    enum { HEIGHT = 320, WIDTH = 560, LEFT = 64, RIGHT = 16, TOP = 32, BOTTOM = 24 };
    enum v2v_status rc = V2V_OK;
    double low = DBL_MAX, high = 0.0;
    V2V_TRY(v2v_canvas_init(canvas, HEIGHT, WIDTH));
    v2v_canvas_text(canvas, GAP, LEFT, title, LABEL_ZOOM, white);
    v2v_canvas_line(canvas, HEIGHT - BOTTOM, LEFT, HEIGHT - BOTTOM, WIDTH - RIGHT, grey);
    v2v_canvas_line(canvas, TOP, LEFT, HEIGHT - BOTTOM, LEFT, grey);
    for (int64_t i = 0; i < count; i++) {
        low = y[i] > 0.0 && y[i] < low ? y[i] : low;
        high = y[i] > high ? y[i] : high;
    }
    if (count < 2 || !(high > low)) {
        goto done;
    }
    double rows = (HEIGHT - BOTTOM - TOP) / log(high / low);
    double columns = (double)(WIDTH - RIGHT - LEFT) / (double)(count - 1);
    int64_t last_y = 0, last_x = 0;
    for (int64_t i = 0; i < count; i++) {
        double value = y[i] > low ? y[i] : low;
        int64_t row = HEIGHT - BOTTOM - (int64_t)(log(value / low) * rows);
        int64_t column = LEFT + (int64_t)((double)i * columns);
        if (i > 0) {
            v2v_canvas_line(canvas, last_y, last_x, row, column, orange);
        }
        last_y = row;
        last_x = column;
    }
    label_value(canvas, TOP, GAP / 2, high);
    label_value(canvas, HEIGHT - BOTTOM - GAP, GAP / 2, low);
    label_value(canvas, HEIGHT - BOTTOM + GAP, LEFT, 1.0);
    label_value(canvas, HEIGHT - BOTTOM + GAP, WIDTH - LEFT, last);
done:
    return rc;
}
