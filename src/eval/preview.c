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

static void project(struct mips *mips, const float *volume, int64_t slices, int64_t height,
                    int64_t width, int zoom)
{
    for (int64_t i = 0; i < height * width; i++) {
        mips->along_z[i] = volume[i];
    }
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
                mips->along_z[y * width + x] = fmaxf(mips->along_z[y * width + x], in[x]);
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

/** Where a projection's range ends: at its percentile (even a sparse scene fills more than a
 *  thousandth of one along z), else at its maximum; 0 where there is no light. */
static enum v2v_status find_white(double *high, const float *mip, int64_t count)
{
    enum v2v_status rc = v2v_percentile(high, mip, count, white_percentile);
    for (int64_t i = 0; rc == V2V_OK && *high <= 0 && i < count; i++) {
        *high = fmax(*high, mip[i]);
    }
    *high = fmax(*high, 0);
    return rc;
}

/** Grey range: as given, else from 0 to the projection's end, else to 1. */
static enum v2v_status choose_range(double *low, double *high, const float *mip, int64_t count)
{
    if (*low != 0 || *high != 0) {
        return V2V_OK;
    }
    enum v2v_status rc = find_white(high, mip, count);
    *high = *high > 0 ? *high : 1;
    return rc;
}

static void draw_separators(struct v2v_canvas *canvas, int64_t height, int64_t width)
{
    v2v_canvas_fill(canvas, 0, width, canvas->height, SEPARATOR, separator_colour);
    v2v_canvas_fill(canvas, height, 0, SEPARATOR, canvas->width, separator_colour);
}

enum v2v_status v2v_preview_volume(struct v2v_canvas *canvas, const float *volume, int64_t slices,
                                   int64_t height, int64_t width, int z_zoom, double low,
                                   double high)
{
    V2V_ASSERT(slices > 0 && height > 0 && width > 0 && z_zoom > 0);
    enum v2v_status rc = V2V_OK;
    struct mips mips = {0};
    int64_t depth = slices * z_zoom;
    V2V_TRY(V2V_ALLOC(mips.along_z, "preview.mips", height * width));
    V2V_TRY(V2V_ALLOC(mips.along_y, "preview.mips", depth * width));
    V2V_TRY(V2V_ALLOC(mips.along_x, "preview.mips", height * depth));
    project(&mips, volume, slices, height, width, z_zoom);
    V2V_TRY(choose_range(&low, &high, mips.along_z, height * width));
    V2V_TRY(v2v_canvas_init(canvas, height + SEPARATOR + depth, width + SEPARATOR + depth));

    float black = (float)low, white = (float)high;
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

enum v2v_status v2v_preview_widen(struct v2v_preview *preview, const float *volume)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = preview->height * preview->width;
    double high = 0.0;
    float *mip = NULL;
    V2V_TRY(V2V_ALLOC(mip, "preview.mips", pixels));
    for (int64_t i = 0; i < pixels; i++) {
        mip[i] = volume[i];
        for (int64_t z = 1; z < preview->slices; z++) {
            mip[i] = fmaxf(mip[i], volume[z * pixels + i]);
        }
    }
    V2V_TRY(find_white(&high, mip, pixels));
    preview->high = fmax(preview->high, high);
done:
    v2v_mem_free(mip);
    return rc;
}

enum v2v_status v2v_preview_draw(struct v2v_canvas *canvas, const struct v2v_preview *preview,
                                 const float *volume)
{
    switch (preview->kind) {
    case V2V_PREVIEW_MONTAGE:
        return v2v_preview_montage(canvas, preview, volume);
    case V2V_PREVIEW_DEPTH:
        return v2v_preview_depth(canvas, preview, volume);
    case V2V_PREVIEW_PROJECTIONS:
        break;
    }
    return v2v_preview_volume(canvas, volume, preview->slices, preview->height, preview->width,
                              preview->z_zoom, preview->low, preview->high);
}
