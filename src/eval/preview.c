#include "eval/preview_kinds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

enum { SEPARATOR = 2 };                            /* pixels between two projections */
static const uint32_t separator_colour = 0x404040; /* dark grey */
static const double white_percentile = 99.9;

/** Maximum projections along each axis; depth is stretched by repeating each slice. */
struct mips {
    float *along_z; /* [y,x] */
    float *along_y; /* [z*zoom,x] */
    float *along_x; /* [y,z*zoom] */
};

/** mip[y,x] = max over z of volume[z,y,x] */
static void project_along_z(float *mip, const float *volume, int64_t slices, int64_t pixels)
{
    for (int64_t i = 0; i < pixels; i++) {
        mip[i] = volume[i];
    }
    for (int64_t z = 1; z < slices; z++) {
        for (int64_t i = 0; i < pixels; i++) {
            mip[i] = fmaxf(mip[i], volume[z * pixels + i]);
        }
    }
}

static void project(struct mips *mips, const float *volume, const struct v2v_preview *preview)
{
    const int64_t slices = preview->slices, height = preview->height, width = preview->width;
    const int64_t zoom = preview->z_zoom;
    project_along_z(mips->along_z, volume, slices, height * width);
    for (int64_t z = 0; z < slices; z++) {
        float *row = mips->along_y + z * zoom * width;
        for (int64_t x = 0; x < width; x++) {
            row[x] = volume[z * height * width + x];
        }
        for (int64_t y = 0; y < height; y++) {
            const float *in = volume + (z * height + y) * width;
            float brightest = in[0];
            for (int64_t x = 0; x < width; x++) {
                brightest = fmaxf(brightest, in[x]);
                row[x] = fmaxf(row[x], in[x]);
            }
            for (int64_t k = 0; k < zoom; k++) {
                mips->along_x[(y * slices + z) * zoom + k] = brightest;
            }
        }
        for (int64_t i = width; i < zoom * width; i++) {
            row[i] = row[i - width];
        }
    }
}

static void draw_separators(struct v2v_canvas *canvas, int64_t height, int64_t width)
{
    v2v_canvas_fill(canvas, 0, width, canvas->height, SEPARATOR, separator_colour);
    v2v_canvas_fill(canvas, height, 0, SEPARATOR, canvas->width, separator_colour);
}

static enum v2v_status draw_projections(struct v2v_canvas *canvas,
                                        const struct v2v_preview *preview, const float *volume)
{
    enum v2v_status rc = V2V_OK;
    struct mips mips = {0};
    const int64_t height = preview->height, width = preview->width;
    const int64_t depth = preview->slices * preview->z_zoom;
    const float black = (float)preview->low, white = (float)preview->high;
    V2V_TRY(V2V_ALLOC(mips.along_z, "preview.mips", height * width));
    V2V_TRY(V2V_ALLOC(mips.along_y, "preview.mips", depth * width));
    V2V_TRY(V2V_ALLOC(mips.along_x, "preview.mips", height * depth));
    project(&mips, volume, preview);
    V2V_TRY(v2v_canvas_init(canvas, height + SEPARATOR + depth, width + SEPARATOR + depth));
    v2v_canvas_image(canvas, 0, 0, mips.along_z, height, width, black, white, 1);
    v2v_canvas_image(canvas, 0, width + SEPARATOR, mips.along_x, height, depth, black, white, 1);
    v2v_canvas_image(canvas, height + SEPARATOR, 0, mips.along_y, depth, width, black, white, 1);
    draw_separators(canvas, height, width);
done:
    v2v_mem_free(mips.along_x);
    v2v_mem_free(mips.along_y);
    v2v_mem_free(mips.along_z);
    return rc;
}

/** Even a sparse scene fills more than a thousandth of a projection along z; a point does not. */
enum v2v_status v2v_preview_widen(struct v2v_preview *preview, const float *volume)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = preview->height * preview->width;
    const double low = isnan(preview->low) ? 0.0 : preview->low;
    double high = 0.0;
    float *mip = NULL;
    V2V_TRY(V2V_ALLOC(mip, "preview.mips", pixels));
    project_along_z(mip, volume, preview->slices, pixels);
    V2V_TRY(v2v_percentile(&high, mip, pixels, white_percentile));
    for (int64_t i = 0, is_dark = high <= low; is_dark && i < pixels; i++) {
        high = fmax(high, mip[i]);
    }
    preview->low = low;
    preview->high = fmax(preview->high, fmax(high, low)); /* NaN counts as nothing */
done:
    v2v_mem_free(mip);
    return rc;
}

enum v2v_status v2v_preview_draw(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                 const float *volume)
{
    V2V_ASSERT(preview->slices > 0 && preview->height > 0 && preview->width > 0 &&
               preview->z_zoom > 0 && !isnan(preview->low) && !isnan(preview->high));
    switch (preview->kind) {
    case V2V_PREVIEW_MONTAGE:
        return v2v_preview_montage(canvas, preview, volume);
    case V2V_PREVIEW_DEPTH:
        return v2v_preview_depth(canvas, preview, volume);
    case V2V_PREVIEW_PROJECTIONS:
        break;
    }
    return draw_projections(canvas, preview, volume);
}
