/** make_bad FOLDER: good small files and broken ones, for bad_input.sh and contracts.sh.
 *
 *  TIFF files are put together byte by byte: libtiff would refuse to write most of them. */
#include <hdf5.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "make_bad: line %d: %s\n", __LINE__, #condition);                      \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

/* What a page of a TIFF file says, 0 for what is usual; `pages` of them follow each other. */
struct tiff {
    const char *name;
    uint32_t pages, width, height, bits, samples, format, compression, planar, rows_per_strip;
    uint32_t byte_count; /* of the one strip; 0: the right number */
    uint32_t offset;     /* of the one strip; 0: the right place */
    uint32_t next;       /* after the last page: where the next directory is said to be */
    uint32_t odd_page;   /* this page (from 1) ... */
    uint32_t odd_width;  /* ... says this width */
    uint32_t odd_bits;   /* ... or this depth */
    int no_counts;       /* StripByteCounts is missing */
    int fill;            /* byte that the data consist of */
};

enum { PAGES = 3, WIDTH = 16, HEIGHT = 12, FIRST_DIRECTORY = 8, MOST_BYTES = 1 << 16 };
enum { UNSIGNED = 1, FLOAT = 3, NO_COMPRESSION = 1, DEFLATE = 8, LZW = 5, JPEG = 7 };

static const struct tiff tiffs[] = {
    {.name = "good.tif"},
    {.name = "width_0.tif", .width = UINT32_MAX /* stands for 0 */},
    {.name = "width_2g.tif", .width = 0x80000000u},
    {.name = "height_4g.tif", .height = 0xfffffffeu},
    {.name = "overflow.tif", .width = 0x7fffffffu, .height = 0x7fffffffu, .bits = 32},
    {.name = "bits_1.tif", .bits = 1},
    {.name = "bits_12.tif", .bits = 12},
    {.name = "float_64.tif", .bits = 64, .format = FLOAT},
    {.name = "bits_mixed.tif", .odd_page = 2, .odd_bits = 8},
    {.name = "size_changes.tif", .odd_page = 3, .odd_width = 15},
    {.name = "samples_3.tif", .samples = 3},
    {.name = "samples_65535.tif", .samples = 65535},
    {.name = "planar.tif", .samples = 3, .planar = 2},
    {.name = "counts_missing_data.tif", .byte_count = 10},
    {.name = "counts_huge.tif", .byte_count = 0xfffffff0u},
    {.name = "no_counts.tif", .no_counts = 1, .offset = 0x7fffff00u},
    {.name = "offset_past_end.tif", .offset = 0x7fffff00u},
    {.name = "deflate_corrupt.tif", .compression = DEFLATE, .fill = 0x5a},
    {.name = "lzw_corrupt.tif", .compression = LZW, .fill = 0xff},
    {.name = "jpeg_corrupt.tif", .compression = JPEG, .bits = 8, .fill = 0x11},
    {.name = "compression_unknown.tif", .compression = 4711},
    {.name = "loop.tif", .next = FIRST_DIRECTORY},
    {.name = "directory_past_end.tif", .next = 0x7ffffff0u},
    {.name = "nan.tif", .bits = 32, .format = FLOAT, .fill = 0xff},
};

static uint32_t or_usual(uint32_t value, uint32_t otherwise)
{
    return value != 0 ? value : otherwise;
}

static void write_file(const char *name, const void *bytes, size_t count)
{
    FILE *file = fopen(name, "wb");
    CHECK(file != NULL && fwrite(bytes, 1, count, file) == count && fclose(file) == 0);
}

static void put(uint8_t *bytes, size_t *end, uint32_t value, int width)
{
    CHECK(*end + (size_t)width <= MOST_BYTES);
    for (int i = 0; i < width; i++) {
        bytes[(*end)++] = (uint8_t)(value >> (8 * i));
    }
}

static void put_tag(uint8_t *bytes, size_t *end, uint32_t tag, uint32_t value)
{
    enum { LONG = 4 };
    put(bytes, end, tag, 2);
    put(bytes, end, LONG, 2);
    put(bytes, end, 1, 4);
    put(bytes, end, value, 4);
}

static void write_tiff(const struct tiff *row)
{
    enum { TAGS = 10 };
    uint8_t *bytes = calloc(1, MOST_BYTES);
    size_t end = 0;
    uint32_t pages = or_usual(row->pages, PAGES);
    CHECK(bytes != NULL);
    put(bytes, &end, 'I' | 'I' << 8, 2);
    put(bytes, &end, 42, 2);
    put(bytes, &end, FIRST_DIRECTORY, 4);
    for (uint32_t page = 1; page <= pages; page++) {
        int is_odd = page == row->odd_page;
        uint32_t tags = TAGS - (row->no_counts ? 1u : 0u);
        uint32_t data = (uint32_t)end + 2 + tags * 12 + 4;
        uint32_t bits = is_odd && row->odd_bits != 0 ? row->odd_bits : or_usual(row->bits, 16);
        uint32_t count = WIDTH * HEIGHT * bits / 8;
        uint32_t width = or_usual(row->width, WIDTH);
        width = is_odd && row->odd_width != 0 ? row->odd_width : width;
        width = width == UINT32_MAX ? 0 : width;
        put(bytes, &end, tags, 2);
        put_tag(bytes, &end, 256, width);
        put_tag(bytes, &end, 257, or_usual(row->height, HEIGHT));
        put_tag(bytes, &end, 258, bits);
        put_tag(bytes, &end, 259, or_usual(row->compression, NO_COMPRESSION));
        put_tag(bytes, &end, 273, or_usual(row->offset, data));
        put_tag(bytes, &end, 277, or_usual(row->samples, 1));
        put_tag(bytes, &end, 278, or_usual(row->rows_per_strip, HEIGHT));
        if (!row->no_counts) {
            put_tag(bytes, &end, 279, or_usual(row->byte_count, count));
        }
        put_tag(bytes, &end, 284, or_usual(row->planar, 1));
        put_tag(bytes, &end, 339, or_usual(row->format, UNSIGNED));
        put(bytes, &end, page < pages ? data + count : row->next, 4);
        for (uint32_t i = 0; i < count; i++) {
            put(bytes, &end, row->fill != 0 ? (uint32_t)row->fill : i * 7 % 251, 1);
        }
    }
    write_file(row->name, bytes, end);
    free(bytes);
}

/* One dataset of floats, filled by a smooth positive pattern. */
struct set {
    const char *file, *dataset;
    int rank;
    hsize_t shape[5];
    double at_start, at_end; /* written over the first and the last element unless 0 */
    int zero_halves;         /* the first half of the elements is 0; 2: the second, too */
};

enum { VIEWS = 5, SLICES = 7, SIDE = 64, KERNEL = 9 };

static const struct set sets[] = {
    {"volume.h5", "/volume", 4, {2, SLICES, SIDE, SIDE}, 0, 0, 0},
    {"volume_nan.h5", "/volume", 3, {SLICES, SIDE, SIDE}, 0, NAN, 0},
    {"volume_vast.h5", "/volume", 3, {SLICES, SIDE, SIDE}, 3e38, 3e38, 0},
    {"volume_8_slices.h5", "/volume", 3, {SLICES + 1, SIDE, SIDE}, 0, 0, 0},
    {"volume_2d.h5", "/volume", 2, {SIDE, SIDE}, 0, 0, 0},
    {"volume_5d.h5", "/volume", 5, {1, 1, SLICES, SIDE, SIDE}, 0, 0, 0},
    {"volume_small.h5", "/volume", 3, {SLICES, 20, 20}, 0, 0, 0},
    {"other_name.h5", "/something", 3, {SLICES, SIDE, SIDE}, 0, 0, 0},
    {"recording.h5", "/views", 4, {2, VIEWS, SIDE, SIDE}, 0, 0, 0},
    {"recording_inf.h5", "/views", 4, {2, VIEWS, SIDE, SIDE}, INFINITY, 0, 0},
    {"recording_nan.h5", "/views", 4, {2, VIEWS, SIDE, SIDE}, 0, NAN, 0},
    {"recording_dark.h5", "/views", 4, {2, VIEWS, SIDE, SIDE}, 0, 0, 2},
    {"recording_late.h5", "/views", 4, {2, VIEWS, SIDE, SIDE}, 0, 0, 1}, /* frame 0 is dark */
    {"recording_vast.h5", "/views", 4, {1, VIEWS, SIDE, SIDE}, 3e38, 3e38, 0},
    {"recording_dark_view.h5", "/views", 4, {1, 3, SIDE, SIDE}, 0, 0, 1},
    {"recording_two_views.h5", "/views", 4, {1, 2, SIDE, SIDE}, 0, 0, 0},
    {"recording_small.h5", "/views", 4, {2, VIEWS, 24, 40}, 0, 0, 0},
    {"recording_odd.h5", "/views", 4, {2, VIEWS, 47, 61}, 0, 0, 0},
    {"recording_pixel.h5", "/views", 4, {1, VIEWS, 1, 1}, 0, 0, 0},
    {"recording_one_view.h5", "/views", 4, {1, 1, SIDE, SIDE}, 0, 0, 0},
    {"recording_4_views.h5", "/views", 3, {4, SIDE, SIDE}, 0, 0, 0},
    {"psf.h5", "/psf", 4, {VIEWS, SLICES, KERNEL, KERNEL}, 0, 0, 0},
    {"psf_nan.h5", "/psf", 4, {VIEWS, SLICES, KERNEL, KERNEL}, 0, NAN, 0},
    {"psf_negative.h5", "/psf", 4, {VIEWS, SLICES, KERNEL, KERNEL}, -1, 0, 0},
    {"psf_dark_view.h5", "/psf", 4, {2, SLICES, KERNEL, KERNEL}, 0, 0, 1},
    {"psf_one_view.h5", "/psf", 4, {1, SLICES, KERNEL, KERNEL}, 0, 0, 0},
    {"psf_two_views.h5", "/psf", 4, {2, SLICES, KERNEL, KERNEL}, 0, 0, 0},
    {"psf_three_views.h5", "/psf", 4, {3, SLICES, KERNEL, KERNEL}, 0, 0, 0},
    {"psf_large.h5", "/psf", 4, {VIEWS, SLICES, SIDE + 17, SIDE + 17}, 0, 0, 0},
    {"psf_3d.h5", "/psf", 3, {SLICES, KERNEL, KERNEL}, 0, 0, 0},
    {"psf_8_slices.h5", "/psf", 4, {VIEWS, SLICES + 1, KERNEL, KERNEL}, 0, 0, 0},
};

static void write_set(const struct set *row)
{
    hsize_t count = 1;
    for (int i = 0; i < row->rank; i++) {
        count *= row->shape[i];
    }
    float *x = calloc(count, sizeof *x);
    CHECK(x != NULL);
    for (hsize_t i = (hsize_t)row->zero_halves * count / 2; i < count; i++) {
        x[i] = (float)(0.5 + 0.4 * sin(0.01 * (double)i));
    }
    x[0] = row->at_start != 0 ? (float)row->at_start : x[0];
    x[count - 1] = row->at_end != 0 ? (float)row->at_end : x[count - 1];
    hid_t file = H5Fcreate(row->file, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    hid_t space = H5Screate_simple(row->rank, row->shape, NULL);
    hid_t set = H5Dcreate2(file, row->dataset, H5T_IEEE_F32LE, space, H5P_DEFAULT, H5P_DEFAULT,
                           H5P_DEFAULT);
    CHECK(H5Dwrite(set, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, x) >= 0);
    H5Dclose(set);
    H5Sclose(space);
    CHECK(H5Fclose(file) >= 0);
    free(x);
}

/* An empty dataset of any type, shape and storage. */
static void write_odd_set(const char *name, hid_t type, int rank, const hsize_t *shape,
                          hid_t storage)
{
    hid_t file = H5Fcreate(name, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    hid_t space = H5Screate_simple(rank, shape, NULL);
    hid_t set = H5Dcreate2(file, "/volume", type, space, H5P_DEFAULT, storage, H5P_DEFAULT);
    CHECK(set >= 0);
    H5Dclose(set);
    H5Sclose(space);
    CHECK(H5Fclose(file) >= 0);
}

/* A filter that only this program knows. */
static size_t pass(unsigned flags, size_t count, const unsigned values[], size_t bytes,
                   size_t *room, void **data)
{
    (void)flags, (void)count, (void)values, (void)room, (void)data;
    return bytes;
}

static void write_odd_sets(void)
{
    static const hsize_t shape[] = {SLICES, SIDE, SIDE}, empty[] = {0, SIDE, SIDE};
    static const hsize_t huge[] = {(hsize_t)1 << 31, (hsize_t)1 << 31, 64}, chunk[] = {1, 64, 64};
    static const H5Z_class2_t filter = {H5Z_CLASS_T_VERS, 32001, 1,    1,
                                        "nobody's",       NULL,  NULL, pass};
    hid_t text = H5Tcopy(H5T_C_S1);
    hid_t pair = H5Tcreate(H5T_COMPOUND, 8);
    hid_t chunked = H5Pcreate(H5P_DATASET_CREATE), external = H5Pcreate(H5P_DATASET_CREATE);
    hid_t filtered = H5Pcreate(H5P_DATASET_CREATE);
    CHECK(H5Tset_size(text, 8) >= 0 && H5Tinsert(pair, "re", 0, H5T_IEEE_F32LE) >= 0 &&
          H5Tinsert(pair, "im", 4, H5T_IEEE_F32LE) >= 0);
    CHECK(H5Pset_chunk(chunked, 3, chunk) >= 0 && H5Pset_chunk(filtered, 3, chunk) >= 0);
    CHECK(H5Pset_external(external, "/etc/passwd", 0, H5F_UNLIMITED) >= 0);
    CHECK(H5Zregister(&filter) >= 0 && H5Pset_filter(filtered, 32001, 0, 0, NULL) >= 0);
    write_odd_set("volume_text.h5", text, 3, shape, H5P_DEFAULT);
    write_odd_set("volume_compound.h5", pair, 3, shape, H5P_DEFAULT);
    write_odd_set("volume_empty.h5", H5T_IEEE_F32LE, 3, empty, H5P_DEFAULT);
    write_odd_set("volume_huge.h5", H5T_IEEE_F32LE, 3, huge, chunked);
    write_odd_set("volume_external.h5", H5T_IEEE_F32LE, 3, shape, external);
    write_odd_set("volume_filter.h5", H5T_IEEE_F32LE, 3, shape, filtered);
    write_odd_set("volume_unwritten.h5", H5T_IEEE_F32LE, 3, shape, chunked);
    H5Pclose(filtered);
    H5Pclose(external);
    H5Pclose(chunked);
    H5Tclose(pair);
    H5Tclose(text);
}

/* Recordings of a chunk a view, of whose index one entry is changed: what HDF5 records of the size
 * of a chunk, and which filters it was written without. */
static const struct {
    const char *name;
    int shuffled, latest;
    uint32_t bytes, left_out;
} odd_chunks[] = {{"chunk_short.h5", 0, 0, 16, 0},
                  {"chunk_past_memory.h5", 0, 0, 0xfffffff0u, 0},
                  {"chunk_past_end.h5", 1, 0, 0x7fffffffu, 0},
                  {"chunk_shuffled.h5", 1, 0, 16, 0},
                  {"chunk_unshuffled.h5", 1, 0, 16, UINT32_MAX},
                  {"chunk_latest.h5", 1, 1, 16, 0}};

/* Of the middle entry: in a B-tree's leaf (version 1, a key of 8 + 5 * 8 bytes, an address), or in
 * a fixed array, whose entries are an address, 3 bytes for the size and a mask. */
static void patch_chunk(const char *name, int latest, uint32_t bytes, uint32_t left_out)
{
    static char content[1 << 18];
    const char *sign = latest ? "FADB" : "TREE";
    const size_t entry = latest ? 15 : 56, first = latest ? 14 + 8 : 24;
    size_t at = 0;
    FILE *file = fopen(name, "rb");
    CHECK(file != NULL);
    size_t size = fread(content, 1, sizeof content, file);
    CHECK(fclose(file) == 0 && size < sizeof content);
    while (at < size && (memcmp(content + at, sign, 4) != 0 || (!latest && content[at + 4] != 1))) {
        at++;
    }
    CHECK(at + first + 6 * entry < size);
    memcpy(content + at + first + 5 * entry, &bytes, latest ? 3 : 4);
    if (!latest) {
        memcpy(content + at + first + 5 * entry + 4, &left_out, 4);
    }
    write_file(name, content, size);
}

static void write_odd_chunks(void)
{
    static const hsize_t shape[] = {2, VIEWS, SIDE, SIDE}, chunk[] = {1, 1, SIDE, SIDE};
    float *x = calloc(2 * VIEWS * SIDE * SIDE, sizeof *x);
    CHECK(x != NULL);
    for (int i = 0; i < 2 * VIEWS * SIDE * SIDE; i++) {
        x[i] = (float)(1 + i % 97);
    }
    for (size_t i = 0; i < sizeof odd_chunks / sizeof odd_chunks[0]; i++) {
        hid_t access = H5Pcreate(H5P_FILE_ACCESS), storage = H5Pcreate(H5P_DATASET_CREATE);
        CHECK(!odd_chunks[i].latest ||
              H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST) >= 0);
        CHECK(H5Pset_chunk(storage, 4, chunk) >= 0 &&
              (!odd_chunks[i].shuffled || H5Pset_shuffle(storage) >= 0));
        hid_t file = H5Fcreate(odd_chunks[i].name, H5F_ACC_TRUNC, H5P_DEFAULT, access);
        hid_t space = H5Screate_simple(4, shape, NULL);
        hid_t set =
            H5Dcreate2(file, "/views", H5T_IEEE_F32LE, space, H5P_DEFAULT, storage, H5P_DEFAULT);
        CHECK(H5Dwrite(set, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, x) >= 0);
        H5Dclose(set);
        H5Sclose(space);
        CHECK(H5Fclose(file) >= 0);
        H5Pclose(storage);
        H5Pclose(access);
        patch_chunk(odd_chunks[i].name, odd_chunks[i].latest, odd_chunks[i].bytes,
                    odd_chunks[i].left_out);
    }
    free(x);
}

static void write_links(void)
{
    hid_t file = H5Fcreate("volume_link.h5", H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    CHECK(H5Lcreate_external("/etc/passwd", "/volume", file, "/volume", H5P_DEFAULT, H5P_DEFAULT) >=
              0 &&
          H5Fclose(file) >= 0);
    file = H5Fcreate("volume_link_loop.h5", H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    CHECK(H5Lcreate_soft("/volume", file, "/volume", H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
          H5Fclose(file) >= 0);
}

/* Bytes 0 .. keep-1 of a file. */
static void cut(const char *from, const char *to, double keep)
{
    FILE *file = fopen(from, "rb");
    CHECK(file != NULL && fseek(file, 0, SEEK_END) == 0);
    size_t size = (size_t)ftell(file), count = (size_t)((double)size * keep);
    char *bytes = malloc(size);
    rewind(file);
    CHECK(bytes != NULL && fread(bytes, 1, size, file) == size && fclose(file) == 0);
    write_file(to, bytes, count);
    free(bytes);
}

static void write_cuts(void)
{
    write_file("empty", "", 0);
    write_file("four_bytes.tif", "II*\0", 4);
    write_file("magic.tif", "this is no picture", 18);
    write_file("text.h5", "this is no HDF5 file", 20);
    for (int i = 1; i < 16; i++) {
        char name[32];
        snprintf(name, sizeof name, "cut_%02d.tif", i);
        cut("good.tif", name, i / 16.0);
    }
    cut("volume.h5", "cut_quarter.h5", 0.25);
    cut("volume.h5", "cut_tail.h5", 0.98);
}

static void write_psf_folders(void)
{
    CHECK(mkdir("psf_gap", 0777) == 0 && mkdir("psf_shapes", 0777) == 0 &&
          mkdir("psf_none", 0777) == 0);
    cut("good.tif", "psf_gap/psf_1.tif", 1);
    cut("good.tif", "psf_gap/psf_3.tif", 1);
    cut("good.tif", "psf_shapes/psf_1.tif", 1);
    struct tiff other = {.name = "psf_shapes/psf_2.tif", .pages = 2};
    write_tiff(&other);
}

int main(int argc, char **argv)
{
    CHECK(argc == 2 && chdir(argv[1]) == 0);
    for (size_t i = 0; i < sizeof tiffs / sizeof tiffs[0]; i++) {
        write_tiff(&tiffs[i]);
    }
    for (size_t i = 0; i < sizeof sets / sizeof sets[0]; i++) {
        write_set(&sets[i]);
    }
    write_odd_sets();
    write_odd_chunks();
    write_links();
    write_cuts();
    write_psf_folders();
    CHECK(mkfifo("fifo.tif", 0666) == 0);
    return 0;
}
