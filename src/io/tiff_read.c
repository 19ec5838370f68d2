#include "io/tiff_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/file.h"
#include "v2v3d/par/watchdog.h"

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

enum v2v_status v2v_tiff_go_to(struct v2v_tiff *tiff, int64_t page)
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

void v2v_tiff_beat(int64_t page)
{
    const int64_t every = 4096; /* directories are read in some microseconds each */
    if (page % every == 0) {
        v2v_watchdog_beat("looking at the pages of a TIFF");
    }
}

static enum v2v_status walk_pages(struct v2v_tiff *tiff)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_shape shape;
    struct v2v_tiff_grid grid;
    int64_t page = 0;

    do {
        v2v_tiff_beat(page);
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
    V2V_TRY(v2v_tiff_go_to(tiff, 0));
    V2V_TRY(v2v_tiff_describe(tiff));
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

    V2V_TRY(v2v_tiff_go_to(tiff, page));
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

static const char *stored_sum(const struct v2v_tiff *tiff)
{
    const char *stored = NULL;
    return TIFFGetField(tiff->handle, TIFFTAG_PAGENAME, &stored) &&
                   strncmp(stored, "crc32c ", 7) == 0
               ? stored
               : NULL;
}

int v2v_tiff_has_sum(const struct v2v_tiff *tiff)
{
    return stored_sum(tiff) != NULL;
}

/* Of a page that v2v_tiff_write_page wrote. */
static enum v2v_status check_sum(struct v2v_tiff *tiff, const float *page, int64_t number)
{
    char name[V2V_TIFF_PAGE_NAME_BYTES];
    const char *stored = tiff->block_from > 0 ? NULL : stored_sum(tiff);
    if (stored == NULL) {
        return V2V_OK;
    }
    v2v_tiff_name_page(name, page, tiff->info.height * tiff->info.width);
    return strcmp(name, stored) == 0
               ? V2V_OK
               : V2V_PAGE_FAIL(tiff, number, "is not as it was written: its checksum differs");
}

/* In double precision: a sample has 16 bits at most, a value is rounded once. */
static void to_values(float *page, int64_t count, const struct v2v_tiff_info *info)
{
    for (int64_t i = 0; i < count; i++) {
        page[i] = (float)(info->zero + info->scale * (double)page[i]);
    }
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
        const int64_t at = tiff->order != NULL ? tiff->order[first + i] : first + i;
        V2V_TRY(tiff->block_from > 0 ? read_block_page(tiff, page, at)
                                     : read_pieces(tiff, page, at));
        V2V_TRY(check_sum(tiff, page, at));
        if (tiff->info.is_float) {
            V2V_TRY(check_finite(tiff, page, at));
        }
        if (tiff->info.scale != 0.0) {
            to_values(page, pixels, &tiff->info);
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
    v2v_mem_free(tiff->order);
    v2v_mem_free(tiff->piece);
    v2v_mem_free(tiff);
    *tiff_in = NULL;
}
