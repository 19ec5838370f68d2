#include "io/tiff_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* An ImageJ block is read in pieces of about this size. */
static const int64_t block_piece_bytes = (int64_t)8 << 20;

static enum v2v_status open_handle(struct v2v_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    struct stat status;
    /* Not blocking: should a pipe have taken the file's place meanwhile, open() would wait. */
    int descriptor = open(tiff->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);

    if (descriptor < 0 || fstat(descriptor, &status) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", tiff->path, strerror(errno)));
    }
    tiff->file_bytes = status.st_size;
    /* h: header only, so that the pages' failures name the page; m: no memory map, a file cut off
     * meanwhile would be a SIGBUS; c: strips as they are. */
    tiff->handle = v2v_tiff_wrap(descriptor, tiff->path, "rhmc", &tiff->log);
    if (tiff->handle == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: not a TIFF file that can be read: %s", tiff->path,
                         v2v_tiff_log_reason(&tiff->log)));
    }
    descriptor = -1;
done:
    if (descriptor >= 0) {
        (void)close(descriptor);
    }
    return rc;
}

static enum v2v_status directory_fail(const struct v2v_tiff *tiff, int64_t page)
{
    return V2V_PAGE_FAIL(tiff, page, "its directory cannot be read: %s",
                         v2v_tiff_log_reason(&tiff->log));
}

static enum v2v_status go_to_page(struct v2v_tiff *tiff, int64_t page)
{
    if (tiff->current == page) {
        return V2V_OK;
    }
    tiff->current = -1;
    v2v_tiff_log_clear(&tiff->log);
    if (!TIFFSetSubDirectory(tiff->handle, tiff->directories[page])) {
        return directory_fail(tiff, page);
    }
    tiff->current = page;
    return V2V_OK;
}

static enum v2v_status remember_directory(struct v2v_tiff *tiff, int64_t page)
{
    enum v2v_status rc = V2V_OK;
    uint64_t *larger = NULL;

    if (page == tiff->room) {
        int64_t room = tiff->room == 0 ? 64 : 2 * tiff->room;
        V2V_TRY(V2V_ALLOC(larger, "io.tiff_directories", room));
        if (page > 0) {
            memcpy(larger, tiff->directories, (size_t)page * sizeof *larger);
        }
        v2v_mem_free(tiff->directories);
        tiff->directories = larger;
        tiff->room = room;
    }
    tiff->directories[page] = TIFFCurrentDirOffset(tiff->handle);
done:
    return rc;
}

static enum v2v_status walk_pages(struct v2v_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_shape shape;
    struct v2v_tiff_grid grid;
    int64_t page = 0;

    do {
        v2v_tiff_log_clear(&tiff->log);
        if (!TIFFReadDirectory(tiff->handle)) {
            V2V_TRY(directory_fail(tiff, page));
        }
        V2V_TRY(v2v_tiff_check_page(tiff, page, &shape, &grid));
        V2V_TRY(remember_directory(tiff, page));
        tiff->shape = shape;
        page++;
    } while (!TIFFLastDirectory(tiff->handle));
    tiff->info.pages = page;
    tiff->current = page - 1;
done:
    return rc;
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

/* Must be called while libtiff holds the first page. */
static enum v2v_status read_description(struct v2v_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_info *info = &tiff->info;
    struct v2v_imagej imagej;
    char *description = NULL, *software = NULL;
    float per_unit = 0;
    uint16_t resolution_unit = 0;

    (void)TIFFGetField(tiff->handle, TIFFTAG_IMAGEDESCRIPTION, &description);
    (void)TIFFGetField(tiff->handle, TIFFTAG_XRESOLUTION, &per_unit);
    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_RESOLUTIONUNIT, &resolution_unit);
    v2v_imagej_parse(&imagej, description);
    if (TIFFGetField(tiff->handle, TIFFTAG_SOFTWARE, &software) &&
        strncmp(software, V2V_TIFF_SOFTWARE, strlen(V2V_TIFF_SOFTWARE)) == 0) {
        (void)snprintf(info->task, sizeof info->task, "%s", software + strlen(V2V_TIFF_SOFTWARE));
    }
    /* tifffile's truncate=True: more pages follow the first, told of by a shape in JSON only. */
    if (info->pages == 1 && description != NULL && strstr(description, "\"truncated\": true")) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: tifffile wrote it with truncate=True: its pages after the first have "
                         "no directory; write it again without",
                         tiff->path));
    }
    if (info->pages == 1 && imagej.images > 1) {
        V2V_TRY(find_block(tiff, &imagej));
    }
    info->channels = imagej.channels;
    info->slices = imagej.slices;
    info->frames = imagej.frames;
    if (v2v_mem_product(imagej.channels, imagej.slices, imagej.frames) != info->pages) {
        if (imagej.channels > 1) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                             "%s: has %lld pages, but ImageJ's description says %lld channels of "
                             "%lld slices and %lld frames: it is cut off or damaged",
                             tiff->path, (long long)info->pages, (long long)imagej.channels,
                             (long long)imagej.slices, (long long)imagej.frames));
        }
        info->channels = 1;
        info->slices = info->pages;
        info->frames = 1;
    }
    /* Inches are dots per inch of a printer, not an object's size; centimetres are meant. */
    double unit_um =
        imagej.images > 0 ? imagej.unit_um : (resolution_unit == RESUNIT_CENTIMETER ? 1e4 : 0);
    info->pixel_size_um = per_unit > 0 && per_unit < 1e12F ? unit_um / (double)per_unit : 0;
    info->slice_spacing_um = imagej.spacing * imagej.unit_um;
    info->frame_interval_s = imagej.frame_interval_s;
done:
    return rc;
}

enum v2v_status v2v_tiff_open(struct v2v_tiff **tiff_out, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;

    *tiff_out = NULL;
    V2V_TRY(v2v_file_check_input(path));
    V2V_TRY(V2V_ALLOC(tiff, "io.tiff", 1));
    V2V_TRY(v2v_text_format(tiff->path, sizeof tiff->path, "%s", path));
    V2V_TRY(open_handle(tiff));
    V2V_TRY(walk_pages(tiff));
    tiff->info.height = tiff->shape.height;
    tiff->info.width = tiff->shape.width;
    tiff->info.bits = tiff->shape.type->bits;
    tiff->info.is_float = tiff->shape.type->format == SAMPLEFORMAT_IEEEFP;
    tiff->info.type_max = tiff->shape.type->most;
    V2V_TRY(go_to_page(tiff, 0));
    V2V_TRY(read_description(tiff));
    *tiff_out = tiff;
    tiff = NULL;
done:
    v2v_tiff_close(&tiff);
    return rc;
}

const struct v2v_tiff_info *v2v_tiff_info(const struct v2v_tiff *tiff)
{
    return &tiff->info;
}

static enum v2v_status take_piece(struct v2v_tiff *tiff, int64_t bytes)
{
    if (bytes <= tiff->piece_bytes) {
        return V2V_OK;
    }
    v2v_mem_free(tiff->piece);
    tiff->piece_bytes = 0;
    enum v2v_status rc = V2V_ALLOC(tiff->piece, "io.tiff_piece", bytes);
    if (rc == V2V_OK) {
        tiff->piece_bytes = bytes;
    }
    return rc;
}

/* `in` is aligned for its type: rows of whole samples in memory that v2v_mem_alloc gave. */
static void to_float(float *out, const void *in, int64_t count, const struct v2v_tiff_info *info)
{
    if (info->is_float) {
        memcpy(out, in, (size_t)count * sizeof *out);
    } else if (info->bits == 8) {
        const uint8_t *samples = in;
        for (int64_t x = 0; x < count; x++) {
            out[x] = (float)samples[x];
        }
    } else if (info->bits == 16) {
        const uint16_t *samples = in;
        for (int64_t x = 0; x < count; x++) {
            out[x] = (float)samples[x];
        }
    } else {
        const uint32_t *samples = in;
        for (int64_t x = 0; x < count; x++) {
            out[x] = (float)samples[x];
        }
    }
}

static enum v2v_status read_pieces(struct v2v_tiff *tiff, float *out, int64_t page)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_shape shape;
    struct v2v_tiff_grid grid;
    const int64_t width = tiff->info.width;

    V2V_TRY(go_to_page(tiff, page));
    /* Once more: another program may have changed the file since it was opened. */
    V2V_TRY(v2v_tiff_check_page(tiff, page, &shape, &grid));
    V2V_TRY(take_piece(tiff, grid.bytes));
    for (int64_t i = 0; i < grid.count; i++) {
        int64_t wanted = v2v_tiff_decoded_bytes(&shape, &grid, i);
        v2v_tiff_log_clear(&tiff->log);
        int64_t got = grid.tiled
                          ? TIFFReadEncodedTile(tiff->handle, (uint32_t)i, tiff->piece, wanted)
                          : TIFFReadEncodedStrip(tiff->handle, (uint32_t)i, tiff->piece, wanted);
        if (got != wanted) {
            V2V_TRY(V2V_PAGE_FAIL(tiff, page, "%s %lld of %lld: %s", grid.tiled ? "tile" : "strip",
                                  (long long)i + 1, (long long)grid.count,
                                  v2v_tiff_log_reason(&tiff->log)));
        }
        int64_t y0 = i / grid.across * grid.rows;
        int64_t x0 = i % grid.across * grid.columns;
        int64_t columns = width - x0 < grid.columns ? width - x0 : grid.columns;
        for (int64_t y = 0; y < v2v_tiff_piece_rows(&shape, &grid, i); y++) {
            to_float(out + (y0 + y) * width + x0,
                     tiff->piece + y * grid.columns * (tiff->info.bits / 8), columns, &tiff->info);
        }
    }
done:
    return rc;
}

static enum v2v_status read_whole(struct v2v_tiff *tiff, int64_t page, int64_t bytes, int64_t from)
{
    int64_t done = 0;

    while (done < bytes) {
        ssize_t got = pread(TIFFFileno(tiff->handle), tiff->piece + done, (size_t)(bytes - done),
                            (off_t)(from + done));
        if (got < 0 && errno == EINTR) {
            continue;
        }
        if (got <= 0) {
            return V2V_PAGE_FAIL(tiff, page, "at byte %lld: %s", (long long)(from + done),
                                 got < 0 ? strerror(errno) : "the file ends");
        }
        done += got;
    }
    return V2V_OK;
}

static void swap_bytes(void *samples, int64_t count, int bits)
{
    if (bits == 16) {
        TIFFSwabArrayOfShort(samples, (tmsize_t)count);
    } else if (bits == 32) {
        TIFFSwabArrayOfLong(samples, (tmsize_t)count);
    }
}

static enum v2v_status read_block_page(struct v2v_tiff *tiff, float *out, int64_t page)
{
    enum v2v_status rc = V2V_OK;
    const int64_t sample_bytes = tiff->info.bits / 8;
    const int64_t pixels = tiff->info.height * tiff->info.width;
    const int64_t most = block_piece_bytes / sample_bytes;
    const int64_t page_from = tiff->block_from + page * pixels * sample_bytes;

    V2V_TRY(take_piece(tiff, block_piece_bytes));
    for (int64_t first = 0; first < pixels; first += most) {
        int64_t count = pixels - first < most ? pixels - first : most;
        V2V_TRY(read_whole(tiff, page, count * sample_bytes, page_from + first * sample_bytes));
        if (TIFFIsByteSwapped(tiff->handle)) {
            swap_bytes(tiff->piece, count, tiff->info.bits);
        }
        to_float(out + first, tiff->piece, count, &tiff->info);
    }
done:
    return rc;
}

static enum v2v_status check_finite(const struct v2v_tiff *tiff, const float *pixels, int64_t page)
{
    const int64_t width = tiff->info.width;

    for (int64_t i = 0; i < tiff->info.height * width; i++) {
        if (!isfinite(pixels[i])) {
            return V2V_PAGE_FAIL(tiff, page, "pixel y = %lld, x = %lld (from 0) is %s",
                                 (long long)(i / width), (long long)(i % width),
                                 isnan(pixels[i]) ? "NaN" : "infinite");
        }
    }
    return V2V_OK;
}

/* Of a page that v2v_tiff_write_page wrote. */
static enum v2v_status check_sum(struct v2v_tiff *tiff, const float *page, int64_t number)
{
    char name[V2V_TIFF_PAGE_NAME_BYTES];
    const char *stored = NULL;
    if (tiff->block_from > 0 || !TIFFGetField(tiff->handle, TIFFTAG_PAGENAME, &stored) ||
        strncmp(stored, "crc32c ", 7) != 0) {
        return V2V_OK;
    }
    v2v_tiff_name_page(name, page, tiff->info.height * tiff->info.width);
    return strcmp(name, stored) == 0
               ? V2V_OK
               : V2V_PAGE_FAIL(tiff, number, "is not as it was written: its checksum differs");
}

enum v2v_status v2v_tiff_read(struct v2v_tiff *tiff, float *out, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = tiff->info.height * tiff->info.width;

    V2V_TRY(V2V_FAULT_POINT("tiff.read"));
    if (first < 0 || count < 0 || first > tiff->info.pages - count) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: pages %lld to %lld are asked for, the file has %lld",
                         tiff->path, (long long)first + 1, (long long)(first + count),
                         (long long)tiff->info.pages));
    }
    for (int64_t i = 0; i < count; i++) {
        float *page = out + i * pixels;
        V2V_TRY(tiff->block_from > 0 ? read_block_page(tiff, page, first + i)
                                     : read_pieces(tiff, page, first + i));
        if (tiff->info.is_float) {
            V2V_TRY(check_sum(tiff, page, first + i));
            V2V_TRY(check_finite(tiff, page, first + i));
        }
    }
done:
    return rc;
}

void v2v_tiff_close(struct v2v_tiff **tiff_in)
{
    struct v2v_tiff *tiff = *tiff_in;

    if (tiff == NULL) {
        return;
    }
    if (tiff->handle != NULL) {
        TIFFClose(tiff->handle);
    }
    v2v_mem_free(tiff->directories);
    v2v_mem_free(tiff->piece);
    v2v_mem_free(tiff);
    *tiff_in = NULL;
}
