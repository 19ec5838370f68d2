/** Hostile TIFF files: each is refused with a message that names file and reason, or read; none
 *  crashes, hangs, or makes the program believe in more data than the file can hold. */
#include "support.h"

#include "tiff_bytes.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <tiffio.h>
#include <unistd.h>

enum { PAGES = 3, HEIGHT = 6, WIDTH = 8 };

/* The places of the entries that tiff_bytes_make writes. */
enum entry {
    E_WIDTH,
    E_HEIGHT,
    E_BITS,
    E_COMPRESSION,
    E_PHOTOMETRIC,
    E_DESCRIPTION,
    E_OFFSET,
    E_SAMPLES,
    E_ROWS,
    E_BYTES,
    E_FORMAT
};

static char folder[256];

static const char *in_folder(const char *name)
{
    static char path[512];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* Open and read everything; the larger of the two statuses. The declared size must be credible: at
 * most what the best codec (Zstandard, 32768) makes of the file's bytes. */
static enum v2v_status read_all(const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    float *pixels = NULL;
    struct stat status;

    V2V_TRY(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
    const int64_t bytes =
        v2v_mem_product(info->height, info->width, info->bits / 8); /* pages may share data */
    assert_int_equal(stat(path, &status), 0);
    assert_true(bytes > 0 && bytes / 32768 <= status.st_size);
    assert_true(info->pages >= 1 && info->pages <= status.st_size);
    V2V_TRY(V2V_ALLOC(pixels, "test.pixels", info->height * info->width));
    for (int64_t page = 0; page < info->pages; page++) {
        V2V_TRY(v2v_tiff_read(tiff, pixels, page, 1));
        for (int64_t i = 0; i < info->height * info->width; i++) {
            assert_true(isfinite(pixels[i]));
        }
    }
done:
    v2v_mem_free(pixels);
    v2v_tiff_close(&tiff);
    return rc;
}

static void assert_refused(const char *name, const char *path, const char *says)
{
    enum v2v_status rc = read_all(path);

    if (rc != V2V_E_INPUT || strstr(v2v_status_message(), path) == NULL ||
        strstr(v2v_status_message(), says) == NULL) {
        fail_msg("%s: %s: %s", name, v2v_status_name(rc),
                 rc == V2V_OK ? "was read" : v2v_status_message());
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static const struct field_case {
    const char *name;
    int page, entry, tag, type;
    uint32_t count, value;
    const char *says;
} field_cases[] = {
    {"width 0", 0, E_WIDTH, 256, TIFF_LONG, 1, 0, ""},
    {"width 2^31", 1, E_WIDTH, 256, TIFF_LONG, 1, 0x80000000, "page 2"},
    {"width 2^32-1", 0, E_WIDTH, 256, TIFF_LONG, 1, 0xffffffff, "page 1"},
    {"width is text", 0, E_WIDTH, 256, TIFF_ASCII, 1, 8, ""},
    {"width is an array", 0, E_WIDTH, 256, TIFF_LONG, 1000000, 8, ""},
    {"width is missing", 0, E_WIDTH, 65000, TIFF_LONG, 1, 8, ""},
    {"height 0", 2, E_HEIGHT, 257, TIFF_LONG, 1, 0, "page 3"},
    {"height 2^32-1", 0, E_HEIGHT, 257, TIFF_LONG, 1, 0xffffffff, "page 1"},
    {"height 65536", 0, E_HEIGHT, 257, TIFF_LONG, 1, 65536, "page 1"},
    {"page of another size", 1, E_HEIGHT, 257, TIFF_LONG, 1, 5, "page 2"},
    {"1 bit", 0, E_BITS, 258, TIFF_SHORT, 1, 1, "page 1: 1-bit"},
    {"12 bits", 0, E_BITS, 258, TIFF_SHORT, 1, 12, "12-bit unsigned"},
    {"64 bits", 0, E_BITS, 258, TIFF_SHORT, 1, 64, "64-bit"},
    {"0 bits", 0, E_BITS, 258, TIFF_SHORT, 1, 0, "page 1"},
    {"page of another type", 2, E_BITS, 258, TIFF_SHORT, 1, 8, "page 3"},
    {"signed", 0, E_FORMAT, 339, TIFF_SHORT, 1, 2, "16-bit signed"},
    {"half precision", 0, E_FORMAT, 339, TIFF_SHORT, 1, 3, "16-bit floating-point"},
    {"unknown kind", 1, E_FORMAT, 339, TIFF_SHORT, 1, 77, "page 2"},
    {"JPEG", 0, E_COMPRESSION, 259, TIFF_SHORT, 1, 7, "JPEG"},
    {"fax", 0, E_COMPRESSION, 259, TIFF_SHORT, 1, 4, "compression 4"},
    {"unknown compression", 1, E_COMPRESSION, 259, TIFF_SHORT, 1, 60000, "page 2"},
    {"deflate of no such data", 1, E_COMPRESSION, 259, TIFF_SHORT, 1, 8, "page 2: strip 1"},
    {"LZW of no such data", 1, E_COMPRESSION, 259, TIFF_SHORT, 1, 5, "page 2: strip 1"},
    {"zstd of no such data", 1, E_COMPRESSION, 259, TIFF_SHORT, 1, 50000, "page 2: strip 1"},
    {"0 samples", 0, E_SAMPLES, 277, TIFF_SHORT, 1, 0, ""},
    {"3 samples", 0, E_SAMPLES, 277, TIFF_SHORT, 1, 3, "page 1"},
    {"65535 samples", 0, E_SAMPLES, 277, TIFF_SHORT, 1, 65535, ""},
    {"0 rows per strip", 0, E_ROWS, 278, TIFF_LONG, 1, 0, "page 1"},
    {"1 row per strip, one strip", 0, E_ROWS, 278, TIFF_LONG, 1, 1, "page 1"},
    {"0 bytes in the strip", 2, E_BYTES, 279, TIFF_LONG, 1, 0, "page 3"},
    {"2^32-1 bytes in the strip", 1, E_BYTES, 279, TIFF_LONG, 1, 0xffffffff, "page 2"},
    {"bytes in the strip missing", 1, E_BYTES, 65000, TIFF_LONG, 1, 96, "page 2"},
    {"too few bytes in the strip", 1, E_BYTES, 279, TIFF_LONG, 1, 50, "page 2"},
    {"offset 0", 0, E_OFFSET, 273, TIFF_LONG, 1, 0, "page 1"},
    {"offset beyond the end", 2, E_OFFSET, 273, TIFF_LONG, 1, 0xfffffff0, "beyond the end"},
    {"offset just before the end", 1, E_OFFSET, 273, TIFF_LONG, 1, 800, "page 2"},
    {"offset missing", 0, E_OFFSET, 65000, TIFF_LONG, 1, 8, ""},
    {"array of offsets beyond the end", 0, E_OFFSET, 273, TIFF_LONG, 0x10000000, 0xfffffff0, ""},
    {"tile width 0", 0, E_ROWS, 322, TIFF_LONG, 1, 0, ""},
    {"tile of 2^31 columns", 0, E_ROWS, 322, TIFF_LONG, 1, 0x80000000, "page 1"},
    {"depth 7", 0, E_SAMPLES, 32997, TIFF_LONG, 1, 7, "page 1"},
};

static void a_field_that_lies_is_refused(void **state)
{
    (void)state;
    struct tiff_bytes file;
    const char *path = in_folder("field.tif");

    for (size_t i = 0; i < sizeof field_cases / sizeof *field_cases; i++) {
        const struct field_case *one = &field_cases[i];
        for (int big_endian = 0; big_endian <= 1; big_endian++) {
            tiff_bytes_make(&file, big_endian, PAGES, PAGES, HEIGHT, WIDTH, "");
            tiff_bytes_entry(&file, one->page, one->entry, one->tag, one->type, one->count,
                             one->value);
            assert_true(tiff_bytes_save(path, file.data, file.size));
            assert_refused(one->name, path, one->says);
        }
    }
}

static void a_harmless_oddity_is_read(void **state)
{
    (void)state;
    static const struct field_case odd[] = {
        {"nothing", 0, E_WIDTH, 256, TIFF_LONG, 1, WIDTH, ""},
        {"rows per strip 2^32-1", 0, E_ROWS, 278, TIFF_LONG, 1, 0xffffffff, ""},
        {"too many bytes in the strip", 0, E_BYTES, 279, TIFF_LONG, 1, 150, ""},
        {"inverted grey", 0, E_PHOTOMETRIC, 262, TIFF_SHORT, 1, 0, ""},
        {"pages share data", 1, E_OFFSET, 273, TIFF_LONG, 1, 500, ""},
        {"separate planes of one sample", 0, E_PHOTOMETRIC, 284, TIFF_SHORT, 1, 2, ""},
    };
    struct tiff_bytes file;

    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
        tiff_bytes_entry(&file, odd[i].page, odd[i].entry, odd[i].tag, odd[i].type, odd[i].count,
                         odd[i].value);
        assert_true(tiff_bytes_save(in_folder("odd.tif"), file.data, file.size));
        enum v2v_status rc = read_all(in_folder("odd.tif"));
        if (rc != V2V_OK) {
            fail_msg("%s: %s", odd[i].name, v2v_status_message());
        }
    }
}

static void directories_that_lead_astray_are_refused(void **state)
{
    (void)state;
    const struct {
        const char *name;
        int page;
        uint32_t next;
    } cases[] = {{"last points at itself", 2, (uint32_t)tiff_bytes_directory(2)},
                 {"last points at the first", 2, (uint32_t)tiff_bytes_directory(0)},
                 {"first points at itself", 0, (uint32_t)tiff_bytes_directory(0)},
                 {"second beyond the end", 0, 0x7fffffff},
                 {"second in the middle of another", 0, (uint32_t)tiff_bytes_directory(1) + 1}};
    struct tiff_bytes file;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
        tiff_bytes_put(&file, tiff_bytes_next(cases[i].page), cases[i].next, 4);
        assert_true(tiff_bytes_save(in_folder("loop.tif"), file.data, file.size));
        assert_refused(cases[i].name, in_folder("loop.tif"), "page");
    }
    tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
    tiff_bytes_put(&file, 4, 0, 4);
    assert_true(tiff_bytes_save(in_folder("loop.tif"), file.data, file.size));
    assert_refused("no directory", in_folder("loop.tif"), "");
}

static void a_file_cut_anywhere_is_refused(void **state)
{
    (void)state;
    struct tiff_bytes file;

    tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
    for (size_t bytes = 0; bytes < file.size; bytes += bytes < 16 ? 1 : 13) {
        assert_true(tiff_bytes_save(in_folder("cut.tif"), file.data, bytes));
        assert_refused("cut", in_folder("cut.tif"), "");
    }
    tiff_bytes_make(&file, 1, 1, 4, HEIGHT, WIDTH, "ImageJ=1.53t\nimages=4\nslices=4\n");
    assert_true(tiff_bytes_save(in_folder("cut.tif"), file.data, file.size - 1));
    assert_refused("cut ImageJ block", in_folder("cut.tif"), "declares 4 pages, the file holds 3");
}

/* tifffile writes what is long at the end of the file: libtiff only warns when it is cut off. */
static void a_tag_beyond_the_end_of_the_file_is_refused(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int tag, type;
        uint32_t count;
    } cases[] = {{"ImageDescription", 270, TIFF_ASCII, 40},
                 {"ImageDescription", 270, TIFF_ASCII, 2000000000},
                 {"PageName", 285, TIFF_ASCII, 40},
                 {"XResolution", 282, TIFF_RATIONAL, 1}};
    struct tiff_bytes file;
    char text[64];

    for (int page = 0; page < PAGES; page++) {
        for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
            tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "text");
            const uint32_t past = (uint32_t)file.size - (cases[i].count == 1 ? 7 : 39);
            tiff_bytes_entry(&file, page, E_DESCRIPTION, cases[i].tag, cases[i].type,
                             cases[i].count, past);
            assert_true(tiff_bytes_save(in_folder("end.tif"), file.data, file.size));
            assert_refused(cases[i].name, in_folder("end.tif"), "cut off or damaged");
            (void)snprintf(text, sizeof text, "page %d: ", page + 1);
            assert_refused(cases[i].name, in_folder("end.tif"), text);
            assert_refused(cases[i].name, in_folder("end.tif"), cases[i].name);
        }
    }
    /* up to the last byte, or of no use here */
    tiff_bytes_make(&file, 0, 1, 1, HEIGHT, WIDTH, "text");
    tiff_bytes_entry(&file, 0, E_DESCRIPTION, 270, TIFF_ASCII, 40, (uint32_t)file.size - 40);
    assert_true(tiff_bytes_save(in_folder("end.tif"), file.data, file.size));
    assert_int_equal(read_all(in_folder("end.tif")), V2V_OK);
    tiff_bytes_entry(&file, 0, E_DESCRIPTION, 271, TIFF_ASCII, 40, (uint32_t)file.size);
    assert_true(tiff_bytes_save(in_folder("end.tif"), file.data, file.size));
    assert_int_equal(read_all(in_folder("end.tif")), V2V_OK);
}

static void an_imagej_block_that_lies_is_refused(void **state)
{
    (void)state;
    struct tiff_bytes file;

    tiff_bytes_make(&file, 0, 1, 4, HEIGHT, WIDTH, "ImageJ=1.53t\nimages=2147483647\n");
    assert_true(tiff_bytes_save(in_folder("block.tif"), file.data, file.size));
    assert_refused("too many pages", in_folder("block.tif"), "declares 2147483647 pages");
    tiff_bytes_make(&file, 0, 1, 4, HEIGHT, WIDTH, "ImageJ=1.53t\nimages=4\n");
    tiff_bytes_entry(&file, 0, E_COMPRESSION, 259, TIFF_SHORT, 1, COMPRESSION_PACKBITS);
    assert_true(tiff_bytes_save(in_folder("block.tif"), file.data, file.size));
    assert_refused("compressed block", in_folder("block.tif"), "not stored as ImageJ");
}

static void a_stack_without_directories_is_not_taken_for_one_page(void **state)
{
    (void)state;
    struct tiff_bytes file;

    tiff_bytes_make(&file, 0, 1, 4, HEIGHT, WIDTH, "{\"shape\": [4, 6, 8], \"truncated\": true}");
    assert_true(tiff_bytes_save(in_folder("truncated.tif"), file.data, file.size));
    assert_refused("truncated", in_folder("truncated.tif"), "truncate=True");
}

static void what_is_no_file_is_refused(void **state)
{
    (void)state;
    char path[512];

    (void)snprintf(path, sizeof path, "%s", in_folder("pipe.tif"));
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_refused("pipe", path, "");
    assert_refused("folder", folder, "folder");
    assert_refused("device", "/dev/zero", "device");
    assert_refused("missing", in_folder("absent.tif"), "");
    (void)snprintf(path, sizeof path, "%s", in_folder("text.tif"));
    assert_true(tiff_bytes_save(path, (const unsigned char *)"GIF89a, not TIFF", 16));
    assert_refused("another format", path, "not a TIFF file");
}

/* Deflate makes at most 1032 bytes of one: 40000 x 40000 pixels can't come out of 96 bytes. */
static void a_bomb_is_refused_before_memory_is_taken(void **state)
{
    (void)state;
    struct tiff_bytes file;

    tiff_bytes_make(&file, 0, 1, 1, HEIGHT, WIDTH, "");
    tiff_bytes_entry(&file, 0, E_WIDTH, 256, TIFF_LONG, 1, 40000);
    tiff_bytes_entry(&file, 0, E_HEIGHT, 257, TIFF_LONG, 1, 40000);
    tiff_bytes_entry(&file, 0, E_ROWS, 278, TIFF_LONG, 1, 40000);
    tiff_bytes_entry(&file, 0, E_COMPRESSION, 259, TIFF_SHORT, 1, 8);
    assert_true(tiff_bytes_save(in_folder("bomb.tif"), file.data, file.size));
    size_t before = v2v_mem_peak();
    assert_refused("bomb", in_folder("bomb.tif"), "cannot hold");
    /* What was taken at most: the handle and the first table of directories, a few KiB. */
    assert_true(v2v_mem_peak() <= before + 65536);
}

static void write_floats(const char *path, const float *pixels, int64_t pages, uint16_t codec)
{
    TIFF *handle = TIFFOpen(path, "w");
    float page[HEIGHT * WIDTH];

    assert_non_null(handle);
    for (int64_t i = 0; i < pages; i++) {
        memcpy(page, pixels + i * HEIGHT * WIDTH, sizeof page);
        TIFFSetField(handle, TIFFTAG_IMAGEWIDTH, WIDTH);
        TIFFSetField(handle, TIFFTAG_IMAGELENGTH, HEIGHT);
        TIFFSetField(handle, TIFFTAG_BITSPERSAMPLE, 32);
        TIFFSetField(handle, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
        TIFFSetField(handle, TIFFTAG_COMPRESSION, codec);
        assert_true(TIFFWriteEncodedStrip(handle, 0, page, sizeof page) > 0);
        assert_int_equal(TIFFWriteDirectory(handle), 1);
    }
    TIFFClose(handle);
}

static void a_value_that_is_no_number_is_refused_with_its_place(void **state)
{
    (void)state;
    const struct {
        float value;
        const char *says;
    } cases[] = {{NAN, "page 2: pixel y = 3, x = 5 (from 0) is NaN"},
                 {INFINITY, "page 2: pixel y = 3, x = 5 (from 0) is infinite"},
                 {-INFINITY, "is infinite"}};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        float pixels[PAGES * HEIGHT * WIDTH] = {0};
        pixels[HEIGHT * WIDTH + 3 * WIDTH + 5] = cases[i].value;
        write_floats(in_folder("nan.tif"), pixels, PAGES, COMPRESSION_NONE);
        assert_refused("not a number", in_folder("nan.tif"), cases[i].says);
    }
}

/* A directory that changes between opening and reading must not overrun the caller's memory. */
static void a_file_that_changes_while_it_is_open_is_refused(void **state)
{
    (void)state;
    struct tiff_bytes file;
    struct v2v_tiff *tiff = NULL;
    float found[HEIGHT * WIDTH];
    char path[512];

    (void)snprintf(path, sizeof path, "%s", in_folder("change.tif"));
    tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
    assert_true(tiff_bytes_save(path, file.data, file.size));
    assert_ok(v2v_tiff_open(&tiff, path));
    tiff_bytes_entry(&file, 1, E_HEIGHT, 257, TIFF_LONG, 1, 2 * HEIGHT);
    tiff_bytes_entry(&file, 1, E_ROWS, 278, TIFF_LONG, 1, 2 * HEIGHT);
    tiff_bytes_entry(&file, 1, E_BYTES, 279, TIFF_LONG, 1, 4 * HEIGHT * WIDTH);
    assert_true(tiff_bytes_save(path, file.data, file.size));
    assert_int_equal(v2v_tiff_read(tiff, found, 1, 1), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "page 2"));
    assert_int_equal(truncate(path, 700), 0);
    assert_int_equal(v2v_tiff_read(tiff, found, 2, 1), V2V_E_INPUT);
    v2v_tiff_close(&tiff);
    assert_int_equal(v2v_mem_held(), 0);
}

/* The limit on memory stands for a full machine: every allocation on the way fails once. */
static void short_memory_is_a_failure_without_a_leak(void **state)
{
    (void)state;
    struct tiff_bytes file;
    enum v2v_status rc = V2V_E_MEMORY;
    int failures = 0;

    tiff_bytes_make(&file, 0, PAGES, PAGES, HEIGHT, WIDTH, "");
    assert_true(tiff_bytes_save(in_folder("short.tif"), file.data, file.size));
    for (size_t limit = 64; rc != V2V_OK; limit += 64) {
        v2v_mem_set_limit(limit);
        rc = read_all(in_folder("short.tif"));
        v2v_mem_set_limit(0);
        assert_true(rc == V2V_OK || rc == V2V_E_MEMORY);
        assert_int_equal(v2v_mem_held(), 0);
        failures += rc == V2V_E_MEMORY;
    }
    assert_true(failures > 0);
}

/* One to four bytes changed anywhere, many times, in files of each codec: read or refused. */
static void mutated_files_are_read_or_refused(void **state)
{
    (void)state;
    enum { ROUNDS = 400, MOST = 8192 };
    const uint16_t used[] = {COMPRESSION_NONE, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_LZW,
                             COMPRESSION_PACKBITS, COMPRESSION_ZSTD};
    float pixels[PAGES * HEIGHT * WIDTH];
    static unsigned char good[MOST], bad[MOST];
    uint64_t draw = 0;
    int refused = 0;

    for (int i = 0; i < PAGES * HEIGHT * WIDTH; i++) {
        pixels[i] = (float)(i % 17);
    }
    for (size_t c = 0; c < sizeof used / sizeof *used; c++) {
        write_floats(in_folder("mutant.tif"), pixels, PAGES, used[c]);
        FILE *stream = fopen(in_folder("mutant.tif"), "rb");
        assert_non_null(stream);
        size_t size = fread(good, 1, MOST, stream);
        assert_int_equal(fclose(stream), 0);
        for (int round = 0; round < ROUNDS; round++) {
            memcpy(bad, good, size);
            int64_t changes = 1 + v2v_random_below(1, 0, draw++, 4);
            for (int64_t i = 0; i < changes; i++) {
                int64_t at = v2v_random_below(1, 0, draw++, (int64_t)size);
                bad[at] = (unsigned char)v2v_random_below(1, 0, draw++, 256);
            }
            assert_true(tiff_bytes_save(in_folder("mutant.tif"), bad, size));
            enum v2v_status rc = read_all(in_folder("mutant.tif"));
            assert_true(rc == V2V_OK || rc == V2V_E_INPUT);
            assert_int_equal(v2v_mem_held(), 0);
            refused += rc == V2V_E_INPUT;
        }
    }
    print_message("%d of %d refused\n", refused, (int)(ROUNDS * sizeof used / sizeof *used));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_field_that_lies_is_refused),
        cmocka_unit_test(a_harmless_oddity_is_read),
        cmocka_unit_test(directories_that_lead_astray_are_refused),
        cmocka_unit_test(a_file_cut_anywhere_is_refused),
        cmocka_unit_test(a_tag_beyond_the_end_of_the_file_is_refused),
        cmocka_unit_test(an_imagej_block_that_lies_is_refused),
        cmocka_unit_test(a_stack_without_directories_is_not_taken_for_one_page),
        cmocka_unit_test(what_is_no_file_is_refused),
        cmocka_unit_test(a_bomb_is_refused_before_memory_is_taken),
        cmocka_unit_test(a_value_that_is_no_number_is_refused_with_its_place),
        cmocka_unit_test(a_file_that_changes_while_it_is_open_is_refused),
        cmocka_unit_test(short_memory_is_a_failure_without_a_leak),
        cmocka_unit_test(mutated_files_are_read_or_refused),
    };
    (void)snprintf(folder, sizeof folder, "%s", test_folder(NULL));
    return cmocka_run_group_tests_name("io.tiff_bad", tests, NULL, NULL);
}
