#include "io/file_internal.h"
#include "io/tiff_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

struct v2v_tiff_writer {
    char path[V2V_PATH_BYTES];
    char temporary[V2V_PATH_BYTES], lock_name[V2V_PATH_BYTES];
    int lock; /* holds lock_name while this is >= 0 */
    struct v2v_tiff_log log;
    struct v2v_tiff_info info;
    TIFF *handle;
    int64_t page_bytes, written;
    int64_t unsynced;   /* bytes */
    uint16_t *integers; /* [y,x] of a page; NULL: floats */
    char *description;
};

int v2v_tiff_needs_big(int64_t pages, int64_t page_bytes)
{
    /* Around its data a page has a directory of some 15 entries of 12 bytes and their values; the
     * description and the header fit once into 64 KiB. */
    const int64_t directory_bytes = 512;
    const int64_t once_bytes = 65536;
    int64_t bytes = v2v_mem_product(pages, page_bytes + directory_bytes, 1);

    return bytes < 0 || bytes > (int64_t)UINT32_MAX - once_bytes;
}

/* 0 stands for 1; the product must be the number of pages where that is given. */
static enum v2v_status settle_shape(struct v2v_tiff_writer *writer,
                                    const struct v2v_tiff_info *info)
{
    struct v2v_tiff_info *own = &writer->info;

    *own = *info;
    own->channels = info->channels == 0 ? 1 : info->channels;
    own->slices = info->slices == 0 ? 1 : info->slices;
    own->frames = info->frames == 0 ? 1 : info->frames;
    own->pages = v2v_mem_product(own->channels, own->slices, own->frames);
    own->bits = info->bits == 16 ? 16 : 32;
    writer->page_bytes = v2v_mem_product(own->height, own->width, own->bits / 8);
    if (own->pages < 1 || (info->pages != 0 && info->pages != own->pages)) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: a stack of %lld channels, %lld slices, %lld frames in "
                        "%lld pages cannot be written",
                        writer->path, (long long)info->channels, (long long)info->slices,
                        (long long)info->frames, (long long)info->pages);
    }
    if (own->height < 1 || own->width < 1 || writer->page_bytes < 1 ||
        own->height * own->width > V2V_TIFF_MOST_PIXELS) {
        return V2V_FAIL(V2V_E_INPUT, "%s: pages of %lld x %lld pixels cannot be written",
                        writer->path, (long long)own->height, (long long)own->width);
    }
    return V2V_OK;
}

/* ImageJ's description, or OME's. */
static enum v2v_status describe(struct v2v_tiff_writer *writer)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_tiff_info *info = &writer->info;
    const int64_t bytes = info->is_ome ? v2v_ome_bytes(info) : 512;
    V2V_TRY(V2V_ALLOC(writer->description, "io.tiff_writer", bytes));
    V2V_TRY((info->is_ome ? v2v_ome_format : v2v_imagej_format)(writer->description, (size_t)bytes,
                                                                info));
done:
    return rc;
}

static enum v2v_status open_temporary(struct v2v_tiff_writer *writer)
{
    int big = v2v_tiff_needs_big(writer->info.pages, writer->page_bytes);
    enum v2v_status rc = V2V_OK;
    int descriptor = -1;

    if (!writer->info.is_packed) {
        V2V_TRY(v2v_file_lock_output(&writer->lock, writer->lock_name, writer->path));
    }
    V2V_TRY(v2v_file_clear(writer->temporary)); /* a killed run's */
    V2V_TRY(v2v_file_check_room(writer->temporary,
                                v2v_mem_product(writer->info.pages, writer->page_bytes, 1)));
    V2V_TRY(v2v_file_create(&descriptor, writer->temporary));
    writer->handle = v2v_tiff_wrap(descriptor, writer->temporary, big ? "w8" : "w", &writer->log);
    if (writer->handle == NULL) {
        (void)close(descriptor);
        (void)unlink(writer->temporary);
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", writer->temporary, v2v_tiff_log_reason(&writer->log)));
    }
done:
    return rc;
}

/* The lock and the memory; accepts NULL. */
static void give_back(struct v2v_tiff_writer **writer)
{
    if (*writer != NULL) {
        v2v_file_unlock_output(&(*writer)->lock, (*writer)->lock_name);
        v2v_mem_free((*writer)->integers);
        v2v_mem_free((*writer)->description);
        v2v_mem_free(*writer);
        *writer = NULL;
    }
}

enum v2v_status v2v_tiff_create(struct v2v_tiff_writer **writer_out, const char *path,
                                const struct v2v_tiff_info *info)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_writer *writer = NULL;

    *writer_out = NULL;
    V2V_TRY(V2V_ALLOC(writer, "io.tiff_writer", 1));
    writer->lock = -1;
    V2V_TRY(v2v_text_format(writer->path, sizeof writer->path, "%s", path));
    V2V_TRY(info->is_packed
                ? v2v_text_format(writer->temporary, sizeof writer->temporary, "%s", path)
                : v2v_file_temporary(writer->temporary, path));
    V2V_TRY(settle_shape(writer, info));
    V2V_TRY(describe(writer));
    if (writer->info.bits == 16) {
        V2V_TRY(V2V_ALLOC(writer->integers, "io.tiff_writer",
                          v2v_mem_product(info->height, info->width, 1)));
    }
    V2V_TRY(open_temporary(writer));
    *writer_out = writer;
    writer = NULL;
done:
    give_back(&writer);
    return rc;
}

static enum v2v_status page_failed(const struct v2v_tiff_writer *writer)
{
    return V2V_FAIL(V2V_E_IO, "%s: page %lld: %s", writer->temporary,
                    (long long)writer->written + 1, v2v_tiff_log_reason(&writer->log));
}

void v2v_tiff_name_page(char name[V2V_TIFF_PAGE_NAME_BYTES], const float *pixels, int64_t count)
{
    const uint32_t crc = v2v_file_crc32c(0, pixels, count * (int64_t)sizeof *pixels);
    (void)snprintf(name, V2V_TIFF_PAGE_NAME_BYTES, "crc32c %08" PRIx32, crc);
}

static int set_tags(TIFF *handle, const struct v2v_tiff_info *info)
{
    int ok = TIFFSetField(handle, TIFFTAG_IMAGEWIDTH, (uint32_t)info->width) &&
             TIFFSetField(handle, TIFFTAG_IMAGELENGTH, (uint32_t)info->height) &&
             TIFFSetField(handle, TIFFTAG_ROWSPERSTRIP, (uint32_t)info->height) &&
             TIFFSetField(handle, TIFFTAG_BITSPERSAMPLE, info->bits) &&
             TIFFSetField(handle, TIFFTAG_SAMPLEFORMAT,
                          info->bits == 16 ? SAMPLEFORMAT_UINT : SAMPLEFORMAT_IEEEFP) &&
             TIFFSetField(handle, TIFFTAG_SAMPLESPERPIXEL, 1) &&
             TIFFSetField(handle, TIFFTAG_COMPRESSION, COMPRESSION_NONE) &&
             TIFFSetField(handle, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) &&
             TIFFSetField(handle, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);

    if (ok && info->pixel_size_um > 0) {
        /* ImageJ takes the unit from the description and wants none here; others centimetres. */
        const double unit_um = info->is_ome ? 1e4 : 1.0;
        ok = TIFFSetField(handle, TIFFTAG_XRESOLUTION, unit_um / info->pixel_size_um) &&
             TIFFSetField(handle, TIFFTAG_YRESOLUTION, unit_um / info->pixel_size_um) &&
             TIFFSetField(handle, TIFFTAG_RESOLUTIONUNIT,
                          info->is_ome ? RESUNIT_CENTIMETER : RESUNIT_NONE);
    }
    return ok;
}

/* The pixels as they are stored. */
static const void *stored_page(const struct v2v_tiff_writer *writer, const float *page)
{
    const int64_t pixels = writer->info.height * writer->info.width;
    if (writer->integers == NULL) {
        return page;
    }
    for (int64_t i = 0; i < pixels; i++) {
        writer->integers[i] = (uint16_t)page[i];
    }
    return writer->integers;
}

enum v2v_status v2v_tiff_write_page(struct v2v_tiff_writer *writer, const float *page)
{
    enum v2v_status rc = V2V_OK;
    char software[V2V_TIFF_SOFTWARE_BYTES], name[V2V_TIFF_PAGE_NAME_BYTES];
    /* libtiff's prototype lacks a const; uncompressed data in native byte order are only read. */
    void *data = (void *)(uintptr_t)stored_page(writer, page);

    V2V_TRY(V2V_FAULT_POINT("tiff.write_page"));
    if (writer->written == writer->info.pages) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "%s: more than the %lld pages announced",
                         writer->temporary, (long long)writer->info.pages));
    }
    v2v_tiff_log_clear(&writer->log);
    V2V_TRY(v2v_tiff_software_format(software, sizeof software, &writer->info));
    v2v_tiff_name_page(name, page, writer->info.height * writer->info.width);
    if (!set_tags(writer->handle, &writer->info) ||
        (writer->written == 0 &&
         !TIFFSetField(writer->handle, TIFFTAG_IMAGEDESCRIPTION, writer->description)) ||
        (writer->written == 0 && software[0] != '\0' &&
         !TIFFSetField(writer->handle, TIFFTAG_SOFTWARE, software)) ||
        !TIFFSetField(writer->handle, TIFFTAG_PAGENAME, name) ||
        TIFFWriteEncodedStrip(writer->handle, 0, data, (tmsize_t)writer->page_bytes) !=
            (tmsize_t)writer->page_bytes ||
        !TIFFWriteDirectory(writer->handle) || writer->log.error[0] != '\0') {
        V2V_TRY(page_failed(writer));
    }
    writer->written++;
    V2V_TRY(v2v_file_sync_piece(&writer->unsynced, writer->page_bytes, writer->temporary));
done:
    return rc;
}

enum v2v_status v2v_tiff_finish(struct v2v_tiff_writer **writer_in)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff_writer *writer = *writer_in;

    if (writer->written != writer->info.pages) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "%s: %lld of %lld pages were written", writer->path,
                         (long long)writer->written, (long long)writer->info.pages));
    }
    v2v_tiff_log_clear(&writer->log);
    /* libtiff drops what close() says; after fsync close has nothing left to say. */
    if (!TIFFFlush(writer->handle)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", writer->temporary, v2v_tiff_log_reason(&writer->log)));
    }
    if (fsync(TIFFFileno(writer->handle)) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: cannot reach the disk: %s", writer->temporary,
                         strerror(errno)));
    }
    TIFFClose(writer->handle);
    writer->handle = NULL;
    if (writer->log.error[0] != '\0') {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", writer->temporary, writer->log.error));
    }
    if (!writer->info.is_packed) {
        V2V_TRY(v2v_file_commit(writer->temporary, writer->path));
    }
    give_back(writer_in);
done:
    v2v_tiff_abandon(writer_in);
    return rc;
}

void v2v_tiff_abandon(struct v2v_tiff_writer **writer_in)
{
    struct v2v_tiff_writer *writer = *writer_in;

    if (writer == NULL) {
        return;
    }
    if (writer->handle != NULL) {
        TIFFClose(writer->handle);
    }
    (void)unlink(writer->temporary);
    give_back(writer_in);
}
