#include "support.h"

#include "io/tiff_internal.h"
#include "tiff_bytes.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"

#include <float.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

enum { PAGES = 3, HEIGHT = 37, WIDTH = 53, PIXELS = HEIGHT * WIDTH };

static char folder[256];

static const char *in_folder(const char *name)
{
    static char path[512];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

struct variant {
    const char *name, *mode; /* of TIFFOpen: b big-endian, l little-endian, 8 BigTIFF */
    int bits, format, compression, predictor;
    uint32_t tile, rows; /* pixels of a tile's side, 0: strips; rows of a strip */
};

static const struct variant variants[] = {
    {"u8 one strip", "wl", 8, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 0, HEIGHT},
    {"u8 packbits", "wl", 8, SAMPLEFORMAT_UINT, COMPRESSION_PACKBITS, 1, 0, 10},
    {"u16 little-endian", "wl", 16, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 0, 10},
    {"u16 big-endian", "wb", 16, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 0, 10},
    {"u16 big-endian BigTIFF", "wb8", 16, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 0, 1},
    {"u16 deflate predictor", "wl", 16, SAMPLEFORMAT_UINT, COMPRESSION_ADOBE_DEFLATE, 2, 0, 16},
    {"u16 old deflate", "wb", 16, SAMPLEFORMAT_UINT, COMPRESSION_DEFLATE, 1, 0, 16},
    {"u16 LZW tiles", "wl", 16, SAMPLEFORMAT_UINT, COMPRESSION_LZW, 2, 16, 0},
    {"u32", "wl", 32, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 0, 5},
    {"u32 big-endian tiles", "wb", 32, SAMPLEFORMAT_UINT, COMPRESSION_NONE, 1, 32, 0},
    {"f32", "wl", 32, SAMPLEFORMAT_IEEEFP, COMPRESSION_NONE, 1, 0, 7},
    {"f32 big-endian", "wb", 32, SAMPLEFORMAT_IEEEFP, COMPRESSION_NONE, 1, 0, HEIGHT},
    {"f32 deflate float predictor", "wl", 32, SAMPLEFORMAT_IEEEFP, COMPRESSION_ADOBE_DEFLATE, 3, 0,
     9},
    {"f32 zstd BigTIFF tiles", "wl8", 32, SAMPLEFORMAT_IEEEFP, COMPRESSION_ZSTD, 1, 64, 0},
    {"f32 rows per strip above the height", "wl", 32, SAMPLEFORMAT_IEEEFP, COMPRESSION_NONE, 1, 0,
     UINT32_MAX},
};

/* A value that every sample type and float32 hold exactly, different for neighbours and pages. */
static float value_at(int64_t page, int64_t y, int64_t x)
{
    return (float)((page * 31 + y * 7 + x * 3) % 256);
}

static void store(unsigned char *buffer, int64_t index, const struct variant *variant, float value)
{
    const uint8_t byte = (uint8_t)value;
    const uint16_t half = (uint16_t)value;
    const uint32_t word = (uint32_t)value;
    const size_t bytes = (size_t)variant->bits / 8;
    const void *from = variant->format == SAMPLEFORMAT_IEEEFP ? (const void *)&value
                       : bytes == 1                           ? (const void *)&byte
                       : bytes == 2                           ? (const void *)&half
                                                              : (const void *)&word;
    memcpy(buffer + (size_t)index * bytes, from, bytes);
}

static void write_page(TIFF *handle, const struct variant *variant, int64_t page)
{
    unsigned char buffer[64 * 64 * 4];
    const uint32_t side_x = variant->tile ? variant->tile : WIDTH;
    const uint32_t side_y = variant->tile ? variant->tile : 1;

    TIFFSetField(handle, TIFFTAG_IMAGEWIDTH, WIDTH);
    TIFFSetField(handle, TIFFTAG_IMAGELENGTH, HEIGHT);
    TIFFSetField(handle, TIFFTAG_BITSPERSAMPLE, variant->bits);
    TIFFSetField(handle, TIFFTAG_SAMPLEFORMAT, variant->format);
    TIFFSetField(handle, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(handle, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(handle, TIFFTAG_COMPRESSION, variant->compression);
    if (variant->predictor != 1) {
        TIFFSetField(handle, TIFFTAG_PREDICTOR, variant->predictor);
    }
    if (variant->tile) {
        TIFFSetField(handle, TIFFTAG_TILEWIDTH, variant->tile);
        TIFFSetField(handle, TIFFTAG_TILELENGTH, variant->tile);
    } else {
        TIFFSetField(handle, TIFFTAG_ROWSPERSTRIP, variant->rows);
    }
    for (uint32_t y0 = 0; y0 < HEIGHT; y0 += side_y) {
        for (uint32_t x0 = 0; x0 < WIDTH; x0 += side_x) {
            for (uint32_t y = 0; y < side_y; y++) {
                for (uint32_t x = 0; x < side_x; x++) {
                    store(buffer, (int64_t)y * side_x + x, variant, value_at(page, y0 + y, x0 + x));
                }
            }
            int done = variant->tile ? TIFFWriteTile(handle, buffer, x0, y0, 0, 0) > 0
                                     : TIFFWriteScanline(handle, buffer, y0, 0) == 1;
            assert_true(done);
        }
    }
    assert_int_equal(TIFFWriteDirectory(handle), 1);
}

static void every_kind_of_lossless_stack_is_read_exactly(void **state)
{
    (void)state;
    static float found[PAGES * PIXELS];
    const char *path = in_folder("variant.tif");

    for (size_t i = 0; i < sizeof variants / sizeof *variants; i++) {
        const struct variant *variant = &variants[i];
        struct v2v_tiff *tiff = NULL;
        TIFF *handle = TIFFOpen(path, variant->mode);
        assert_non_null(handle);
        for (int64_t page = 0; page < PAGES; page++) {
            write_page(handle, variant, page);
        }
        TIFFClose(handle);
        print_message("%s\n", variant->name);
        assert_ok(v2v_tiff_open(&tiff, path));
        const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
        assert_int_equal(info->pages, PAGES);
        assert_int_equal(info->height, HEIGHT);
        assert_int_equal(info->width, WIDTH);
        assert_int_equal(info->bits, variant->bits);
        assert_int_equal(info->is_float, variant->format == SAMPLEFORMAT_IEEEFP);
        assert_true(info->type_max == (info->is_float ? 1 : ldexp(1, variant->bits) - 1));
        /* The last page first: pages are found in any order. */
        assert_ok(v2v_tiff_read(tiff, found + 2 * PIXELS, 2, 1));
        assert_ok(v2v_tiff_read(tiff, found, 0, 2));
        for (int64_t page = 0; page < PAGES; page++) {
            for (int64_t y = 0; y < HEIGHT; y++) {
                for (int64_t x = 0; x < WIDTH; x++) {
                    assert_true(found[page * PIXELS + y * WIDTH + x] == value_at(page, y, x));
                }
            }
        }
        assert_int_equal(v2v_tiff_read(tiff, found, 1, PAGES), V2V_E_INPUT);
        assert_int_equal(v2v_tiff_read(tiff, found, -1, 1), V2V_E_INPUT);
        v2v_tiff_close(&tiff);
        assert_null(tiff);
        assert_int_equal(v2v_mem_held(), 0);
    }
}

static const struct v2v_tiff_info hyperstack = {.pages = 6,
                                                .height = HEIGHT,
                                                .width = WIDTH,
                                                .slices = 3,
                                                .frames = 2,
                                                .pixel_size_um = 0.65,
                                                .slice_spacing_um = 4.25,
                                                .frame_interval_s = 0.1};

static void fill(float *page, int64_t number)
{
    for (int64_t i = 0; i < PIXELS; i++) {
        page[i] = (float)number + (float)i / 3;
    }
}

static void a_written_hyperstack_is_read_back(void **state)
{
    (void)state;
    static float page[PIXELS], found[PIXELS];
    struct v2v_tiff_writer *writer = NULL;
    struct v2v_tiff *tiff = NULL;
    const char *path = in_folder("hyperstack.tif");

    assert_ok(v2v_tiff_create(&writer, path, &hyperstack));
    for (int64_t i = 0; i < 6; i++) {
        fill(page, i);
        assert_ok(v2v_tiff_write_page(writer, page));
        assert_false(v2v_file_exists(path));
    }
    assert_ok(v2v_tiff_finish(&writer));
    assert_null(writer);
    assert_false(v2v_file_exists(in_folder("hyperstack.tif.v2v3d-part")));
    assert_ok(v2v_tiff_open(&tiff, in_folder("hyperstack.tif")));
    const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
    assert_int_equal(info->pages, 6);
    assert_int_equal(info->channels, 1);
    assert_int_equal(info->slices, 3);
    assert_int_equal(info->frames, 2);
    /* Pixels a micron are a ratio of two 32-bit integers that libtiff hands out as float: two
     * roundings of 2^-24, and the ratio's own error below 2^-24. Text has nine digits. */
    assert_true(fabs(info->pixel_size_um / 0.65 - 1) < 3 * (double)FLT_EPSILON);
    assert_true(fabs(info->slice_spacing_um / 4.25 - 1) < 1e-9);
    assert_true(fabs(info->frame_interval_s / 0.1 - 1) < 1e-9);
    for (int64_t i = 0; i < 6; i++) {
        fill(page, i);
        assert_ok(v2v_tiff_read(tiff, found, i, 1));
        assert_memory_equal(found, page, sizeof page);
    }
    v2v_tiff_close(&tiff);
    assert_int_equal(v2v_mem_held(), 0);
}

static void an_unfinished_file_leaves_nothing(void **state)
{
    (void)state;
    static const float page[PIXELS];
    struct v2v_tiff_writer *writer = NULL;
    const char *path = in_folder("unfinished.tif");

    v2v_tiff_abandon(&writer);
    assert_ok(v2v_tiff_create(&writer, path, &hyperstack));
    assert_ok(v2v_tiff_write_page(writer, page));
    v2v_tiff_abandon(&writer);
    assert_null(writer);
    assert_ok(v2v_tiff_create(&writer, path, &hyperstack));
    assert_ok(v2v_tiff_write_page(writer, page));
    assert_int_equal(v2v_tiff_finish(&writer), V2V_E_INTERNAL);
    assert_null(writer);
    assert_false(v2v_file_exists(path));
    assert_false(v2v_file_exists(in_folder("unfinished.tif.v2v3d-part")));
    assert_int_equal(v2v_mem_held(), 0);
}

static void two_writers_of_one_file_are_refused(void **state)
{
    (void)state;
    static const float page[PIXELS];
    struct v2v_tiff_writer *first = NULL, *second = NULL;
    const char *path = in_folder("twice.tif");

    assert_ok(v2v_tiff_create(&first, path, &hyperstack));
    assert_int_equal(v2v_tiff_create(&second, path, &hyperstack), V2V_E_BUSY);
    assert_null(second);
    for (int64_t i = 0; i < hyperstack.pages; i++) {
        assert_ok(v2v_tiff_write_page(first, page));
    }
    assert_ok(v2v_tiff_finish(&first));
    assert_true(v2v_file_exists(path));
    assert_ok(v2v_tiff_create(&second, path, &hyperstack));
    v2v_tiff_abandon(&second);
    assert_false(v2v_file_exists(in_folder("twice.tif.v2v3d-lock")));
}

static void shapes_that_cannot_be_written_are_refused(void **state)
{
    (void)state;
    struct v2v_tiff_writer *writer = NULL;
    const struct v2v_tiff_info bad[] = {
        {.pages = 5, .height = 2, .width = 2, .slices = 3, .frames = 2},
        {.pages = 1, .height = 0, .width = 2},
        {.pages = 1, .height = 2, .width = -2},
        {.pages = 1, .height = 65536, .width = 65536},
        {.pages = 1, .height = INT64_MAX, .width = INT64_MAX},
        {.slices = INT64_MAX, .frames = 2, .height = 2, .width = 2},
    };

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(v2v_tiff_create(&writer, in_folder("shape.tif"), &bad[i]), V2V_E_INPUT);
        assert_null(writer);
    }
    assert_int_equal(v2v_tiff_create(&writer, in_folder("no/such.tif"), &hyperstack), V2V_E_IO);
    assert_null(writer);
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_stack_larger_than_the_disk_is_refused_at_once(void **state)
{
    (void)state;
    struct v2v_tiff_writer *writer = NULL;
    const struct v2v_tiff_info large = {.slices = INT64_C(1) << 30, .height = 512, .width = 512};

    assert_int_equal(v2v_tiff_create(&writer, in_folder("large.tif"), &large), V2V_E_IO);
    assert_null(writer);
    assert_non_null(strstr(v2v_status_message(), "the disk has"));
    assert_false(v2v_file_exists(in_folder("large.tif.v2v3d-part")));
    assert_false(v2v_file_exists(in_folder("large.tif.v2v3d-lock")));
    assert_int_equal(v2v_mem_held(), 0);
}

/* A limit on the size of files stands for a full disk: write() fails with EFBIG. */
static void a_failing_write_is_an_io_error_that_leaves_nothing(void **state)
{
    (void)state;
    static const float page[PIXELS];
    struct v2v_tiff_writer *writer = NULL;
    struct rlimit before, little;
    enum v2v_status rc = V2V_OK;

    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    little = before;
    little.rlim_cur = 2 * sizeof page + 100;
    void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
    assert_ok(v2v_tiff_create(&writer, in_folder("full.tif"), &hyperstack));
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &little), 0);
    for (int64_t i = 0; i < 6 && rc == V2V_OK; i++) {
        rc = v2v_tiff_write_page(writer, page);
    }
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
    (void)signal(SIGXFSZ, handler);
    assert_int_equal(rc, V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "full.tif.v2v3d-part: page"));
    v2v_tiff_abandon(&writer);
    assert_false(v2v_file_exists(in_folder("full.tif")));
    assert_false(v2v_file_exists(in_folder("full.tif.v2v3d-part")));
}

static void more_than_65536_pages_are_written_and_read(void **state)
{
    (void)state;
    const struct v2v_tiff_info info = {.frames = 70000, .height = 1, .width = 2};
    struct v2v_tiff_writer *writer = NULL;
    struct v2v_tiff *tiff = NULL;
    float page[2] = {0}, found[4];

    assert_ok(v2v_tiff_create(&writer, in_folder("many.tif"), &info));
    for (int64_t i = 0; i < info.frames; i++) {
        page[0] = (float)i;
        assert_ok(v2v_tiff_write_page(writer, page));
    }
    assert_ok(v2v_tiff_finish(&writer));
    assert_ok(v2v_tiff_open(&tiff, in_folder("many.tif")));
    assert_int_equal(v2v_tiff_info(tiff)->frames, 70000);
    assert_ok(v2v_tiff_read(tiff, found, 69998, 2));
    assert_true(found[0] == 69998 && found[2] == 69999);
    v2v_tiff_close(&tiff);
}

static void bigtiff_is_used_from_4_gb_on(void **state)
{
    (void)state;
    const int64_t mebi = (int64_t)1 << 20;

    assert_false(v2v_tiff_needs_big(1, 4));
    assert_false(v2v_tiff_needs_big(1023, 4 * mebi));
    assert_true(v2v_tiff_needs_big(1024, 4 * mebi));
    assert_true(v2v_tiff_needs_big(INT64_MAX / 8, 4 * mebi));
    /* Small pages: their directories count too. */
    assert_true(v2v_tiff_needs_big((int64_t)8 << 20, 4));
}

static void imagej_descriptions_are_understood(void **state)
{
    (void)state;
    const struct {
        const char *text;
        struct v2v_imagej imagej;
    } cases[] = {
        {"ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\n"
         "unit=micron\nspacing=2.5\nfinterval=0.5\nloop=false\n",
         {12, 2, 3, 2, 1, 1, 2.5, 0.5}},
        {"ImageJ=1.53t\r\nimages=3\r\nslices=3\r\nunit=\\u00B5m\r\nspacing=-2\r\n",
         {3, 1, 3, 1, 1, 1, 2, 0}},
        {"ImageJ=1\nimages=2\nunit=\xc2\xb5m", {2, 1, 1, 1, 1, 1, 0, 0}},
        {"ImageJ=1\nimages=2\nunit=nm\nfinterval=200\ntunit=ms\n",
         {2, 1, 1, 1, 1e-3, 1e-3, 0, 0.2}},
        {"ImageJ=1\nunit=um\nzunit=nm\nspacing=500\n", {1, 1, 1, 1, 1, 1, 0.5, 0}},
        {"ImageJ=1\nunit=um\nyunit=nm\nspacing=2\n", {1, 1, 1, 1, 1, 1e-3, 2, 0}},
        {"ImageJ=1\nunit=um\nyunit=pixel\nzunit=furlong\nspacing=2\n", {1, 1, 1, 1, 1, 0, 0, 0}},
        {"ImageJ=1\nunit=furlong\nzunit=um\nspacing=2\n", {1, 1, 1, 1, 0, 0, 2, 0}},
        {"ImageJ=1\nimages=-4\nslices=99999999999999999999\nunit=furlong\nspacing=nan\n",
         {1, 1, 1, 1, 0, 0, 0, 0}},
        {"ImageJ=1\nximages=5\nimages\nimages=\nspacing=1e999\n", {1, 1, 1, 1, 0, 0, 0, 0}},
        {"{\"shape\": [39, 128, 128]}", {0, 1, 1, 1, 0, 0, 0, 0}},
        {"", {0, 1, 1, 1, 0, 0, 0, 0}},
        {NULL, {0, 1, 1, 1, 0, 0, 0, 0}},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct v2v_imagej *wanted = &cases[i].imagej;
        struct v2v_imagej found;
        v2v_imagej_parse(&found, cases[i].text);
        assert_int_equal(found.images, wanted->images);
        assert_int_equal(found.channels, wanted->channels);
        assert_int_equal(found.slices, wanted->slices);
        assert_int_equal(found.frames, wanted->frames);
        assert_true(found.unit_um == wanted->unit_um);
        assert_true(found.unit_y_um == wanted->unit_y_um);
        assert_true(found.spacing_um == wanted->spacing_um);
        /* 200 ms: one rounding of a product */
        assert_true(fabs(found.frame_interval_s - wanted->frame_interval_s) <= DBL_EPSILON);
    }
}

static void times_are_seconds_however_they_are_spelt(void **state)
{
    (void)state;
    static const struct {
        const char *unit;
        double seconds;
    } cases[] = {
        {"s", 1},
        {"Sec", 1},
        {"second", 1},
        {"seconds", 1},
        {"ms", 1e-3},
        {"msec", 1e-3},
        {"milliseconds", 1e-3},
        {"us", 1e-6},
        {"usec", 1e-6},
        {"\\u00B5s", 1e-6},
        {"\xc2\xb5s", 1e-6},
        {"\xb5s", 1e-6},
        {"min", 60},
        {"minutes", 60},
        {"minute", 60},
        {"h", 3600},
        {"hours", 3600},
        {"hour", 3600},
        {"frame", 0},
        {"secondes", 0},
        {"", 0},
        {"microseconds", 1e-6},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_true(v2v_tiff_seconds(cases[i].unit) == cases[i].seconds);
    }
}

static void imagej_calibrates_samples_by_a_straight_line(void **state)
{
    (void)state;
    const struct {
        const char *text;
        enum v2v_imagej_values values;
        double zero, scale;
    } cases[] = {
        {"ImageJ=1.53t\nimages=2\ncf=0\nc0=-32768.0\nc1=1.0\nvunit=gray value\n",
         V2V_IMAGEJ_STRAIGHT, -32768, 1},
        {"ImageJ=1.53t\r\nc0=1.5e-3\r\nc1=-2\r\nvunit=mV\r\n", V2V_IMAGEJ_STRAIGHT, 1.5e-3, -2},
        {"ImageJ=1.53t\nc0=3\nvunit=mV\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {"ImageJ=1.53t\nc1=3\nvunit=mV\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {"ImageJ=1.53t\nc0=3\nc1=0\nvunit=mV\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {"ImageJ=1.53t\nc0=3\nc1=nan\nvunit=mV\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {"ImageJ=1.53t\ncf=1\nc0=3\nc1=2\nc2=1\nvunit=mV\n", V2V_IMAGEJ_CURVED, 0, 0},
        {"ImageJ=1.53t\ncf=21\nvunit=OD\n", V2V_IMAGEJ_CURVED, 0, 0},
        {"ImageJ=1.53t\nc0=-32768\nc1=1\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {"c0=3\nc1=2\nvunit=mV\n", V2V_IMAGEJ_AS_STORED, 0, 0},
        {NULL, V2V_IMAGEJ_AS_STORED, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double zero = 0.0, scale = 0.0;
        const enum v2v_imagej_values values = v2v_imagej_values(&zero, &scale, cases[i].text);
        assert_int_equal(values, cases[i].values);
        if (values == V2V_IMAGEJ_STRAIGHT) {
            assert_true(zero == cases[i].zero && scale == cases[i].scale);
        }
    }
}

/* Above 4 GB ImageJ stores one directory and all pages behind each other. */
static void an_imagej_file_with_one_directory_is_read_whole(void **state)
{
    (void)state;
    enum { COUNT = 4 * 3 * 5 };
    struct tiff_bytes file;
    float found[COUNT];

    for (int big_endian = 0; big_endian <= 1; big_endian++) {
        struct v2v_tiff *tiff = NULL;
        tiff_bytes_make(&file, big_endian, 1, 4, 3, 5,
                        "ImageJ=1.53t\nimages=4\nslices=2\nframes=2\nhyperstack=true\n");
        assert_true(tiff_bytes_save(in_folder("block.tif"), file.data, file.size));
        assert_ok(v2v_tiff_open(&tiff, in_folder("block.tif")));
        assert_int_equal(v2v_tiff_info(tiff)->pages, 4);
        assert_int_equal(v2v_tiff_info(tiff)->slices, 2);
        assert_int_equal(v2v_tiff_info(tiff)->frames, 2);
        assert_ok(v2v_tiff_read(tiff, found, 0, 4));
        for (int i = 0; i < COUNT; i++) {
            assert_true(found[i] == (float)(i + 1));
        }
        assert_ok(v2v_tiff_read(tiff, found, 3, 1));
        assert_true(found[0] == 46);
        v2v_tiff_close(&tiff);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void an_imagej_description_of_fewer_images_is_set_aside(void **state)
{
    (void)state;
    static const char *const cases[] = {
        "ImageJ=1.53t\nimages=3\nslices=2\n", "ImageJ=1.53t\nimages=2\nslices=2\n",
        "ImageJ=1.53t\nimages=2\n", "ImageJ=1.53t\nslices=3\n", "ImageJ=1.53t\n"};
    struct tiff_bytes file;
    struct v2v_tiff *tiff = NULL;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        tiff_bytes_make(&file, 0, 3, 3, 3, 5, cases[i]);
        assert_true(tiff_bytes_save(in_folder("other.tif"), file.data, file.size));
        assert_ok(v2v_tiff_open(&tiff, in_folder("other.tif")));
        const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
        assert_int_equal(info->pages, 3);
        assert_int_equal(info->slices, 3);
        assert_int_equal(info->channels * info->frames, 1);
        v2v_tiff_close(&tiff);
    }
}

/* Pages are missing, or which page is whose nobody knows. */
static void an_imagej_description_of_more_images_is_refused(void **state)
{
    (void)state;
    static const struct {
        int pages;
        const char *description, *reason;
    } cases[] = {
        {3, "images=8\nslices=4\nframes=2\n",
         "has 3 pages, but ImageJ's description says 8 images"},
        {3, "slices=4\n", "1 channels of 4 slices and 1 frames: it is cut off or damaged"},
        {3, "images=3\nframes=4\n", "cut off or damaged"},
        {3, "images=4\nslices=3\n", "has 3 pages, but ImageJ's description says 4 images"},
        {3, "images=4\n", "cut off or damaged"},
        {3, "images=4\nchannels=2\nslices=2\n", "2 channels of 2 slices"},
        {3, "images=2\nchannels=2\n", "2 channels of 1 slices"},
        {3, "slices=2000000000\nframes=2000000000\nchannels=2000000000\n", "cut off or damaged"},
        {1, "slices=4\n", "has 1 pages"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct tiff_bytes file;
        struct v2v_tiff *tiff = NULL;
        char text[128];
        (void)snprintf(text, sizeof text, "ImageJ=1.53t\n%s", cases[i].description);
        tiff_bytes_make(&file, 0, cases[i].pages, cases[i].pages, 3, 5, text);
        assert_true(tiff_bytes_save(in_folder("other.tif"), file.data, file.size));
        assert_int_equal(v2v_tiff_open(&tiff, in_folder("other.tif")), V2V_E_INPUT);
        assert_non_null(strstr(v2v_status_message(), cases[i].reason));
    }
}

static void real_stacks_are_read(void **state)
{
    (void)state;
    const struct {
        const char *name;
        int64_t pages, height, width;
        int bits;
    } cases[] = {{"psf/2psam/psf_1.tif", 39, 128, 128, 32},
                 {"psf/vessels9/psf_9.tif", 57, 99, 99, 32},
                 {"recordings/vessels9.tif", 9, 303, 303, 16},
                 {"volumes/microglia_timelapse.tif", 234, 220, 382, 16}};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct v2v_tiff *tiff = NULL;
        float *pixels = NULL;
        const char *path = test_shared(cases[i].name);
        if (path == NULL) {
            skip();
        }
        assert_ok(v2v_tiff_open(&tiff, path));
        const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
        assert_int_equal(info->pages, cases[i].pages);
        assert_int_equal(info->height, cases[i].height);
        assert_int_equal(info->width, cases[i].width);
        assert_int_equal(info->bits, cases[i].bits);
        assert_ok(V2V_ALLOC(pixels, "test.pixels", info->pages * info->height * info->width));
        assert_ok(v2v_tiff_read(tiff, pixels, 0, info->pages));
        v2v_mem_free(pixels);
        v2v_tiff_close(&tiff);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_of_lossless_stack_is_read_exactly),
        cmocka_unit_test(a_written_hyperstack_is_read_back),
        cmocka_unit_test(an_unfinished_file_leaves_nothing),
        cmocka_unit_test(two_writers_of_one_file_are_refused),
        cmocka_unit_test(shapes_that_cannot_be_written_are_refused),
        cmocka_unit_test(a_stack_larger_than_the_disk_is_refused_at_once),
        cmocka_unit_test(a_failing_write_is_an_io_error_that_leaves_nothing),
        cmocka_unit_test(more_than_65536_pages_are_written_and_read),
        cmocka_unit_test(bigtiff_is_used_from_4_gb_on),
        cmocka_unit_test(imagej_descriptions_are_understood),
        cmocka_unit_test(times_are_seconds_however_they_are_spelt),
        cmocka_unit_test(imagej_calibrates_samples_by_a_straight_line),
        cmocka_unit_test(an_imagej_file_with_one_directory_is_read_whole),
        cmocka_unit_test(an_imagej_description_of_fewer_images_is_set_aside),
        cmocka_unit_test(an_imagej_description_of_more_images_is_refused),
        cmocka_unit_test(real_stacks_are_read),
    };
    (void)snprintf(folder, sizeof folder, "%s", test_folder(NULL));
    /* It warns of the old deflate number that a test writes on purpose. */
    (void)TIFFSetWarningHandler(NULL);
    return cmocka_run_group_tests_name("io.tiff", tests, NULL, NULL);
}
