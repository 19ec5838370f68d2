#include "io/tiff_internal.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum v2v_status v2v_tiff_set_axes(struct v2v_tiff *tiff, const int64_t size[V2V_TIFF_AXES],
                                  const int64_t stride[V2V_TIFF_AXES], const int64_t *page)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_info *info = &tiff->info;
    int64_t *order = NULL;
    int is_plain = 1;
    info->channels = size[0];
    info->slices = size[1];
    info->frames = size[2];
    V2V_TRY(V2V_ALLOC(order, "io.tiff_order", info->pages));
    for (int64_t p = 0; p < info->pages; p++) {
        const int64_t c = p % size[0], z = p / size[0] % size[1], t = p / size[0] / size[1];
        const int64_t at = c * stride[0] + z * stride[1] + t * stride[2];
        order[p] = page != NULL ? page[at] : at;
        is_plain &= order[p] == p;
    }
    if (!is_plain) {
        tiff->order = order;
        order = NULL;
    }
done:
    v2v_mem_free(order);
    return rc;
}

/* Of a folder's files, which are alike, the first is told of. */
static int is_told(const char *path, double x, double y)
{
    static _Thread_local char folder[V2V_PATH_BYTES];
    static _Thread_local double last[2];
    const char *slash = strrchr(path, '/');
    const size_t length = slash != NULL ? (size_t)(slash - path) : 0;
    const int is_same = x == last[0] && y == last[1] && length == strlen(folder) &&
                        strncmp(folder, path, length) == 0;
    snprintf(folder, sizeof folder, "%.*s", (int)length, path);
    last[0] = x;
    last[1] = y;
    return is_same;
}

double v2v_tiff_pixel_size(const char *path, double x, double y)
{
    const double rounding = 1e-4; /* of decimals and fractions in files */
    if (x > 0.0 && y > 0.0 && fabs(x - y) > rounding * x) {
        if (!is_told(path, x, y)) {
            v2v_log(V2V_LOG_WARNING, "%s: pixels of %g x %g um are not square: size not used", path,
                    y, x);
        }
        return 0.0;
    }
    return x;
}

/* Above 4 GB ImageJ writes one directory only, and the pages one after the other from where that
 * says; the description holds their number. */
static enum v2v_status find_block(struct v2v_tiff *tiff, const struct v2v_imagej *imagej)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_grid grid;
    int64_t end = 0;

    V2V_TRY(v2v_tiff_describe_grid(tiff, 0, &tiff->shape, &grid));
    for (int64_t i = 0; i < grid.count; i++) {
        int64_t from = (int64_t)TIFFGetStrileOffset(tiff->handle, (uint32_t)i);
        if (grid.tiled || grid.codec->tag != COMPRESSION_NONE || (i > 0 && from != end)) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: ImageJ's description declares %lld pages, the file "
                             "has 1, not stored as ImageJ does it",
                             tiff->path, (long long)imagej->images));
        }
        end = from + v2v_tiff_decoded_bytes(&tiff->shape, &grid, i);
    }
    tiff->block_from = (int64_t)TIFFGetStrileOffset(tiff->handle, 0);
    int64_t bytes = v2v_mem_product(imagej->images, end - tiff->block_from, 1);
    if (bytes < 0 || bytes > tiff->file_bytes - tiff->block_from) {
        V2V_TRY(V2V_FAIL(
            V2V_E_INPUT,
            "%s: ImageJ's description declares %lld pages, the file holds %lld: it is "
            "cut off or damaged",
            tiff->path, (long long)imagej->images,
            (long long)((tiff->file_bytes - tiff->block_from) / (end - tiff->block_from))));
    }
    tiff->info.pages = imagej->images;
done:
    return rc;
}

/* ImageJ's, or none at all: then its tags alone tell a length. */
static enum v2v_status read_imagej(struct v2v_tiff *tiff, const char *description)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_info *info = &tiff->info;
    struct v2v_imagej imagej;
    v2v_imagej_parse(&imagej, description);
    if (info->pages == 1 && imagej.images > 1) {
        V2V_TRY(find_block(tiff, &imagej));
    }
    info->channels = imagej.channels;
    info->slices = imagej.slices;
    info->frames = imagej.frames;
    const int64_t described = v2v_mem_product(imagej.channels, imagej.slices, imagej.frames);
    if (described != info->pages || imagej.images > info->pages) {
        const int has_fewer = described < 0 || described > info->pages;
        if (has_fewer || imagej.images > info->pages || imagej.channels > 1) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: has %lld pages, but ImageJ's description says %lld images, %lld "
                             "channels of %lld slices and %lld frames: it is cut off or damaged",
                             tiff->path, (long long)info->pages, (long long)imagej.images,
                             (long long)imagej.channels, (long long)imagej.slices,
                             (long long)imagej.frames));
        }
        info->channels = 1;
        info->slices = info->pages;
        info->frames = 1;
    }
    info->slice_spacing_um = imagej.spacing_um;
    info->frame_interval_s = imagej.frame_interval_s;
done:
    return rc;
}

/* Of a resolution tag: pixels in a unit. */
static double pixel_size(TIFF *handle, uint32_t tag, double unit_um)
{
    float per_unit = 0;
    (void)TIFFGetField(handle, tag, &per_unit);
    return per_unit > 0 && per_unit < 1e12F ? unit_um / (double)per_unit : 0;
}

/* ImageJ calibrates samples of 8 and 16 bits. What this program made of voxels it knows to the bit
 * by its own tag. */
static void calibrate(struct v2v_tiff *tiff, const char *description)
{
    struct v2v_tiff_info *info = &tiff->info;
    double zero = 0.0, scale = 0.0;
    if (info->is_float || info->bits > 16 || info->step > 0.0) {
        return;
    }
    switch (v2v_imagej_values(&zero, &scale, description)) {
    case V2V_IMAGEJ_AS_STORED:
        break;
    case V2V_IMAGEJ_STRAIGHT:
        info->zero = zero;
        info->scale = scale;
        info->type_max = 1.0;
        break;
    case V2V_IMAGEJ_CURVED:
        info->is_curved = 1;
        break;
    }
}

/* What the tags say, which a description goes before. */
static void read_tags(struct v2v_tiff *tiff, const char *description)
{
    struct v2v_tiff_info *info = &tiff->info;
    struct v2v_imagej imagej;
    char *software = NULL;
    uint16_t resolution_unit = 0;
    if (TIFFGetField(tiff->handle, TIFFTAG_SOFTWARE, &software)) {
        v2v_tiff_software_parse(info, software);
    }
    info->is_own = v2v_tiff_has_sum(tiff);
    calibrate(tiff, description);
    v2v_imagej_parse(&imagej, description);
    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_RESOLUTIONUNIT, &resolution_unit);
    /* Inches are dots per inch of a printer, not an object's size; centimetres are meant. */
    const double tag_um = resolution_unit == RESUNIT_CENTIMETER ? 1e4 : 0;
    const double x_um = imagej.images > 0 ? imagej.unit_um : tag_um;
    const double y_um = imagej.images > 0 ? imagej.unit_y_um : tag_um;
    info->pixel_size_um =
        v2v_tiff_pixel_size(tiff->path, pixel_size(tiff->handle, TIFFTAG_XRESOLUTION, x_um),
                            pixel_size(tiff->handle, TIFFTAG_YRESOLUTION, y_um));
}

enum v2v_status v2v_tiff_describe(struct v2v_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    char *description = NULL;
    int found = 0;
    (void)TIFFGetField(tiff->handle, TIFFTAG_IMAGEDESCRIPTION, &description);
    read_tags(tiff, description);
    /* tifffile's truncate=True: more pages follow the first, told of by a shape in JSON only. */
    if (tiff->info.pages == 1 && description != NULL &&
        strstr(description, "\"truncated\": true")) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: tifffile wrote it with truncate=True: its pages after the first have "
                         "no directory; write it again without",
                         tiff->path));
    }
    if (description != NULL) {
        V2V_TRY(v2v_ome_read(tiff, description, &found));
    }
    if (description != NULL && !found) {
        V2V_TRY(v2v_shaped_read(tiff, description, &found));
    }
    if (!found) {
        V2V_TRY(read_imagej(tiff, description));
    }
done:
    return rc;
}
