#include "cli/picture.h"

#include "v2v3d/base/memory.h"
#include <string.h>

enum { GAP = 8, LABEL_ROWS = 24, LABEL_ZOOM = 2, ZOOM = 2 };
static const uint32_t white = 0xffffff;

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
