#include "cli/picture.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include <string.h>

enum { GAP = 8, LABEL_ROWS = 24, LABEL_ZOOM = 2, LETTER = 6 };
static const uint32_t white = 0xffffff;

enum v2v_status v2v_picture_check_name(const char *path)
{
    if (v2v_text_ends_in(path, ".png") || v2v_text_ends_in(path, ".apng")) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_USAGE, "%s: pictures are PNG: a name in .png", path);
}

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
    const struct v2v_preview preview = {.kind = V2V_PREVIEW_PROJECTIONS,
                                        .slices = info->slices,
                                        .height = info->height,
                                        .width = info->width,
                                        .z_zoom = z_zoom,
                                        .low = low,
                                        .high = high};
    float *voxels = NULL;
    V2V_TRY(V2V_ALLOC(voxels, "picture.volume",
                      v2v_mem_product(info->slices, info->height, info->width)));
    V2V_TRY(v2v_volume_read(volume, voxels, t, 0, info->slices));
    V2V_TRY(v2v_preview_draw(canvas, &preview, voxels));
done:
    v2v_mem_free(voxels);
    return rc;
}

/* A part with each pixel repeated zoom x zoom. */
static void blit(struct v2v_canvas *canvas, const struct v2v_canvas *part, int64_t y0, int64_t x0,
                 int zoom)
{
    for (int64_t y = 0; y < part->height * zoom; y++) {
        uint8_t *to = canvas->rgb + ((y0 + y) * canvas->width + x0) * 3;
        for (int64_t x = 0; x < part->width * zoom; x++) {
            memcpy(to + x * 3, part->rgb + (y / zoom * part->width + x / zoom) * 3, 3);
        }
    }
}

/* Where column c begins: each is as wide as the widest of its parts and labels. */
static int64_t column_at(const struct v2v_canvas *parts, const char *const *labels, int64_t count,
                         int64_t columns, int64_t c, int zoom)
{
    int64_t x = GAP;
    for (int64_t before = 0; before < c; before++) {
        int64_t widest = 0;
        for (int64_t i = before; i < count; i += columns) {
            const int64_t letters = (int64_t)strlen(labels[i]) * LETTER * LABEL_ZOOM;
            widest = v2v_larger(widest, v2v_larger(parts[i].width * zoom, letters));
        }
        x += widest + GAP;
    }
    return x;
}

enum v2v_status v2v_picture_grid(struct v2v_canvas *canvas, const struct v2v_canvas *parts,
                                 const char *const *labels, int64_t count, int64_t columns,
                                 int zoom)
{
    enum v2v_status rc = V2V_OK;
    int64_t highest = 0;
    for (int64_t i = 0; i < count; i++) {
        highest = v2v_larger(highest, parts[i].height);
    }
    const int64_t row = highest * zoom + LABEL_ROWS;
    V2V_TRY(v2v_canvas_init(canvas, v2v_parts(count, columns) * row + GAP,
                            column_at(parts, labels, count, columns, columns, zoom)));
    for (int64_t i = 0; i < count; i++) {
        const int64_t y = i / columns * row;
        const int64_t x = column_at(parts, labels, count, columns, i % columns, zoom);
        v2v_canvas_text(canvas, y + GAP / 2, x, labels[i], LABEL_ZOOM, white);
        blit(canvas, &parts[i], y + LABEL_ROWS, x, zoom);
    }
done:
    return rc;
}
