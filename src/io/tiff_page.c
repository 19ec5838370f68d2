#include "io/tiff_internal.h"
#include "v2v3d/base/memory.h"

#include <stdio.h>

static const struct v2v_tiff_codec codecs[] = {
    {COMPRESSION_NONE, 1},
    {COMPRESSION_PACKBITS, 64},        /* 2 bytes repeat one 128 times */
    {COMPRESSION_LZW, 4096},           /* a code of at least 9 bits stands for at most 4096 bytes */
    {COMPRESSION_DEFLATE, 1032},       /* 258 bytes for 2 bits (zlib's technical details) */
    {COMPRESSION_ADOBE_DEFLATE, 1032}, /* the same under its registered number */
    {COMPRESSION_ZSTD, 32768},         /* a block of 128 KiB in 4 bytes (RFC 8878, 3.1.1.2) */
};

static const struct v2v_tiff_sample_type sample_types[] = {
    {8, SAMPLEFORMAT_UINT, UINT8_MAX},
    {16, SAMPLEFORMAT_UINT, UINT16_MAX},
    {32, SAMPLEFORMAT_UINT, UINT32_MAX},
    {32, SAMPLEFORMAT_IEEEFP, 1},
};

/* A tile may be larger than the page it belongs to, a strip not: only tiles need a limit. */
static const int64_t largest_tile_bytes = (int64_t)256 << 20;

enum v2v_status v2v_tiff_page_fail(const struct v2v_tiff *tiff, int64_t page, const char *file,
                                   int line, const char *format, ...)
{
    char reason[V2V_MESSAGE_BYTES];
    va_list arguments;

    va_start(arguments, format);
    (void)vsnprintf(reason, sizeof reason, format, arguments);
    va_end(arguments);
    return v2v_status_fail(V2V_E_INPUT, file, line, "%s: page %lld: %s", tiff->path,
                           (long long)page + 1, reason);
}

static enum v2v_status find_sample_type(const struct v2v_tiff *tiff, int64_t page,
                                        const struct v2v_tiff_sample_type **type)
{
    uint16_t bits = 0;
    uint16_t format = 0;
    uint16_t samples = 0;
    uint16_t photometric = PHOTOMETRIC_MINISBLACK;

    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_BITSPERSAMPLE, &bits);
    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_SAMPLEFORMAT, &format);
    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_SAMPLESPERPIXEL, &samples);
    (void)TIFFGetField(tiff->handle, TIFFTAG_PHOTOMETRIC, &photometric);
    if (samples != 1) {
        return V2V_PAGE_FAIL(tiff, page, "%d samples a pixel; only 1 (grey) is read", (int)samples);
    }
    if (photometric == PHOTOMETRIC_PALETTE) {
        return V2V_PAGE_FAIL(tiff, page, "colours of a palette; only grey is read");
    }
    for (size_t i = 0; i < sizeof sample_types / sizeof *sample_types; i++) {
        if (sample_types[i].bits == bits && sample_types[i].format == format) {
            *type = &sample_types[i];
            return V2V_OK;
        }
    }
    const char *kind = format == SAMPLEFORMAT_UINT     ? "unsigned"
                       : format == SAMPLEFORMAT_INT    ? "signed"
                       : format == SAMPLEFORMAT_IEEEFP ? "floating-point"
                                                       : "unknown";
    return V2V_PAGE_FAIL(tiff, page,
                         "%d-bit %s samples; only 8, 16 and 32 bits unsigned and 32-bit "
                         "floating-point are read",
                         (int)bits, kind);
}

static enum v2v_status describe_shape(const struct v2v_tiff *tiff, int64_t page,
                                      struct v2v_tiff_shape *shape)
{
    enum v2v_status rc = V2V_OK;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t depth = 1;

    (void)TIFFGetField(tiff->handle, TIFFTAG_IMAGEWIDTH, &width);
    (void)TIFFGetField(tiff->handle, TIFFTAG_IMAGELENGTH, &height);
    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_IMAGEDEPTH, &depth);
    *shape = (struct v2v_tiff_shape){.height = height, .width = width};
    int64_t pixels = v2v_mem_product(height, width, 1);
    if (width == 0 || height == 0 || depth != 1 || pixels < 0 || pixels > V2V_TIFF_MOST_PIXELS) {
        V2V_TRY(V2V_PAGE_FAIL(tiff, page,
                              "%u x %u pixels (height x width), depth %u, cannot be read", height,
                              width, depth));
    }
    V2V_TRY(find_sample_type(tiff, page, &shape->type));
done:
    return rc;
}

static enum v2v_status find_codec(const struct v2v_tiff *tiff, int64_t page,
                                  const struct v2v_tiff_codec **codec)
{
    uint16_t tag = COMPRESSION_NONE;

    (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_COMPRESSION, &tag);
    for (size_t i = 0; i < sizeof codecs / sizeof *codecs; i++) {
        if (codecs[i].tag == tag && TIFFIsCODECConfigured(tag)) {
            *codec = &codecs[i];
            return V2V_OK;
        }
    }
    const TIFFCodec *known = TIFFFindCODEC(tag);
    return V2V_PAGE_FAIL(tiff, page,
                         "compression %d (%s); only none, deflate, LZW, PackBits and Zstandard are "
                         "read: all lossless",
                         (int)tag, known != NULL ? known->name : "unknown");
}

enum v2v_status v2v_tiff_describe_grid(const struct v2v_tiff *tiff, int64_t page,
                                       const struct v2v_tiff_shape *shape,
                                       struct v2v_tiff_grid *grid)
{
    enum v2v_status rc = V2V_OK;
    uint32_t rows = 0;
    uint32_t columns = (uint32_t)shape->width;
    uint32_t depth = 1;
    const int64_t sample_bytes = shape->type->bits / 8;

    *grid = (struct v2v_tiff_grid){.tiled = TIFFIsTiled(tiff->handle)};
    V2V_TRY(find_codec(tiff, page, &grid->codec));
    if (grid->tiled) {
        (void)TIFFGetField(tiff->handle, TIFFTAG_TILEWIDTH, &columns);
        (void)TIFFGetField(tiff->handle, TIFFTAG_TILELENGTH, &rows);
        (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_TILEDEPTH, &depth);
    } else {
        (void)TIFFGetFieldDefaulted(tiff->handle, TIFFTAG_ROWSPERSTRIP, &rows);
        rows = rows > shape->height ? (uint32_t)shape->height : rows;
    }
    int64_t expected = v2v_mem_product(rows, columns, sample_bytes);
    if (rows == 0 || columns == 0 || depth != 1 || expected < 0 ||
        (grid->tiled && expected > largest_tile_bytes)) {
        V2V_TRY(V2V_PAGE_FAIL(tiff, page, "%s of %u x %u pixels, depth %u, cannot be read",
                              grid->tiled ? "tiles" : "strips", rows, columns, depth));
    }
    grid->rows = rows;
    grid->columns = columns;
    grid->across = (shape->width + columns - 1) / columns;
    grid->count = grid->across * ((shape->height + rows - 1) / rows);
    grid->bytes = grid->tiled ? TIFFTileSize(tiff->handle) : TIFFStripSize(tiff->handle);
    int64_t count =
        grid->tiled ? TIFFNumberOfTiles(tiff->handle) : TIFFNumberOfStrips(tiff->handle);
    if (grid->bytes != expected || grid->count != count) {
        V2V_TRY(V2V_PAGE_FAIL(tiff, page, "its sizes contradict each other: %s",
                              v2v_tiff_log_reason(&tiff->log)));
    }
done:
    return rc;
}

int64_t v2v_tiff_piece_rows(const struct v2v_tiff_shape *shape, const struct v2v_tiff_grid *grid,
                            int64_t piece)
{
    int64_t left = shape->height - piece / grid->across * grid->rows;

    return left < grid->rows ? left : grid->rows;
}

int64_t v2v_tiff_decoded_bytes(const struct v2v_tiff_shape *shape, const struct v2v_tiff_grid *grid,
                               int64_t piece)
{
    return grid->tiled ? grid->bytes
                       : grid->bytes / grid->rows * v2v_tiff_piece_rows(shape, grid, piece);
}

/* Every piece lies within the file, and has enough bytes there to become what it shall. */
static enum v2v_status check_pieces(const struct v2v_tiff *tiff, int64_t page,
                                    const struct v2v_tiff_shape *shape,
                                    const struct v2v_tiff_grid *grid)
{
    for (int64_t i = 0; i < grid->count; i++) {
        int64_t wanted = v2v_tiff_decoded_bytes(shape, grid, i);
        uint64_t from = TIFFGetStrileOffset(tiff->handle, (uint32_t)i);
        uint64_t stored = TIFFGetStrileByteCount(tiff->handle, (uint32_t)i);
        if (grid->codec->tag == COMPRESSION_NONE && stored > (uint64_t)wanted) {
            stored = (uint64_t)wanted;
        }
        if (from == 0 || stored == 0) {
            return V2V_PAGE_FAIL(tiff, page, "%s %lld has no data", grid->tiled ? "tile" : "strip",
                                 (long long)i + 1);
        }
        if (from > (uint64_t)tiff->file_bytes || stored > (uint64_t)tiff->file_bytes - from) {
            return V2V_PAGE_FAIL(tiff, page,
                                 "%s %lld lies beyond the end of the file (%lld bytes): "
                                 "the file is cut off or damaged",
                                 grid->tiled ? "tile" : "strip", (long long)i + 1,
                                 (long long)tiff->file_bytes);
        }
        const int64_t expansion = grid->codec->expansion;
        if ((int64_t)stored < (wanted + expansion - 1) / expansion) {
            return V2V_PAGE_FAIL(tiff, page,
                                 "%s %lld: %llu bytes cannot hold the %lld bytes declared",
                                 grid->tiled ? "tile" : "strip", (long long)i + 1,
                                 (unsigned long long)stored, (long long)wanted);
        }
    }
    return V2V_OK;
}

enum v2v_status v2v_tiff_check_page(const struct v2v_tiff *tiff, int64_t page,
                                    struct v2v_tiff_shape *shape, struct v2v_tiff_grid *grid)
{
    enum v2v_status rc = V2V_OK;

    V2V_TRY(describe_shape(tiff, page, shape));
    V2V_TRY(v2v_tiff_describe_grid(tiff, page, shape, grid));
    V2V_TRY(check_pieces(tiff, page, shape, grid));
    /* libtiff guesses then; what it reads may be another page's pixels. */
    if (tiff->log.miscounted) {
        V2V_TRY(V2V_PAGE_FAIL(tiff, page, "%s", tiff->log.warning));
    }
    /* Without its description the pages would be taken in another order. */
    if (tiff->log.lost) {
        V2V_TRY(V2V_PAGE_FAIL(tiff, page, "%s: the file is cut off or damaged", tiff->log.warning));
    }
    if (tiff->shape.type != NULL &&
        (shape->height != tiff->shape.height || shape->width != tiff->shape.width ||
         shape->type != tiff->shape.type)) {
        V2V_TRY(V2V_PAGE_FAIL(
            tiff, page, "%lld x %lld pixels of %d bits, but page 1 has %lld x %lld of %d bits%s",
            (long long)shape->height, (long long)shape->width, (int)shape->type->bits,
            (long long)tiff->shape.height, (long long)tiff->shape.width,
            (int)tiff->shape.type->bits,
            shape->type->format != tiff->shape.type->format ? " of another kind" : ""));
    }
done:
    return rc;
}
