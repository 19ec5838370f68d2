/** make_inputs FOLDER: one small recording as cameras, Fiji, Bio-Formats, tifffile and
 *  h5py write it, and files that are to be refused, for inputs.sh. Prints the names of those
 *  that libtiff here cannot write.
 *
 *  The counts are whole and below 251, so that every type holds them. */
#include "../unit/io/tiff_bytes.h"
#include <hdf5.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <tiffio.h>
#include <unistd.h>

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "make_inputs: line %d: %s\n", __LINE__, #condition);                   \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

enum { FRAMES = 4, VIEWS = 3, CHANNELS = 2, HEIGHT = 5, WIDTH = 7, MOST = 64 * 64 * 4 };

static int count_at(int t, int v, int c, int y, int x)
{
    return (t * 61 + v * 29 + c * 101 + y * 7 + x * 3) % 251;
}

/* ---- TIFF ---- */

#define IMAGEJ(pages, axes)                                                                        \
    "ImageJ=1.53t\nimages=" #pages "\n" axes "hyperstack=true\nunit=micron\nfinterval=0.25\n"      \
    "loop=false\n"
#define OME(order, c, z, t, inside)                                                                \
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/"        \
    "Schemas/OME/2016-06\" UUID=\"urn:uuid:1\"><Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" "     \
    "DimensionOrder=\"" order "\" Type=\"uint16\" SizeX=\"7\" SizeY=\"5\" SizeC=\"" #c             \
    "\" SizeZ=\"" #z "\" SizeT=\"" #t "\" PhysicalSizeX=\"500\" PhysicalSizeXUnit=\"nm\" "         \
    "PhysicalSizeY=\"500\" PhysicalSizeYUnit=\"nm\" TimeIncrement=\"250\" "                        \
    "TimeIncrementUnit=\"ms\">" inside "</Pixels></Image></OME>"

/* 0 is what is usual: u16, one strip, no compression. */
struct stack {
    const char *name, *order; /* of the pages, slowest axis first: letters t, v, c */
    const char *description;
    const char *mode; /* of TIFFOpen */
    int bits, is_float, compression, predictor, tile, rows, height, width;
    int samples, photometric, is_signed;
    int odd_page;   /* from 1: this one is a column wider */
    int every_page; /* has the description */
    int left_out;   /* pages at the end */
    int more;       /* samples are the counts and this */
};

static const struct stack stacks[] = {
    {.name = "u8.tif", .order = "tv", .bits = 8},
    {.name = "u16.tif", .order = "tv"},
    {.name = "u32.tif", .order = "tv", .bits = 32},
    {.name = "f32.tif", .order = "tv", .bits = 32, .is_float = 1},
    {.name = "big_endian.tif", .order = "tv", .mode = "wb"},
    {.name = "bigtiff.tif", .order = "tv", .mode = "w8"},
    {.name = "bigtiff_be.tif", .order = "tv", .mode = "wb8", .bits = 32, .is_float = 1},
    {.name = "tiled.tif", .order = "tv", .tile = 16},
    {.name = "tiled_deflate.tif", .order = "tv", .tile = 16, .compression = 8},
    {.name = "strips.tif", .order = "tv", .rows = 2},
    {.name = "lzw.tif", .order = "tv", .compression = COMPRESSION_LZW, .predictor = 2},
    {.name = "deflate.tif", .order = "tv", .compression = COMPRESSION_ADOBE_DEFLATE},
    {.name = "packbits.tif", .order = "tv", .compression = COMPRESSION_PACKBITS, .rows = 3},
    {.name = "zstd.tif", .order = "tv", .compression = COMPRESSION_ZSTD},
    {.name = "float_predictor.tif",
     .order = "tv",
     .bits = 32,
     .is_float = 1,
     .predictor = 3,
     .compression = COMPRESSION_ADOBE_DEFLATE},
    {.name = "one_row.tif", .order = "tv", .height = 1},
    {.name = "one_column.tif", .order = "tv", .width = 1},
    {.name = "prime.tif", .order = "tv", .height = 13, .width = 31},
    /* hyperstacks */
    {.name = "ij_zt.tif", .order = "tv", .description = IMAGEJ(12, "slices=3\nframes=4\n")},
    {.name = "ij_ct.tif", .order = "tv", .description = IMAGEJ(12, "channels=3\nframes=4\n")},
    {.name = "ij_slices.tif", .order = "tv", .description = IMAGEJ(12, "slices=12\n")},
    {.name = "ij_frames.tif", .order = "tv", .description = IMAGEJ(12, "frames=12\n")},
    {.name = "ij_czt.tif",
     .order = "tvc",
     .description = IMAGEJ(24, "channels=2\nslices=3\nframes=4\n")},
    {.name = "ij_c_frames.tif",
     .order = "tvc",
     .description = IMAGEJ(24, "channels=2\nframes=12\n")},
    {.name = "ij_cut.tif",
     .order = "tvc",
     .left_out = 1,
     .description = IMAGEJ(24, "channels=2\nslices=3\nframes=4\n")},
    {.name = "ij_cut_zt.tif",
     .order = "tv",
     .left_out = 1,
     .description = IMAGEJ(12, "slices=3\nframes=4\n")},
    {.name = "ij_signed.tif",
     .order = "tv",
     .more = 32768,
     .description =
         IMAGEJ(12, "slices=3\nframes=4\ncf=0\nc0=-32768.0\nc1=1.0\nvunit=gray value\n")},
    {.name = "ij_calibrated_8.tif",
     .order = "tv",
     .bits = 8,
     .more = 4,
     .description = IMAGEJ(12, "slices=3\nframes=4\nc0=-4\nc1=1\nvunit=counts\n")},
    {.name = "ij_curved.tif",
     .order = "tv",
     .description = IMAGEJ(12, "slices=3\nframes=4\ncf=4\nc0=2\nc1=3\nvunit=OD\n")},
    {.name = "ij_4_views.tif", .order = "tv", .description = IMAGEJ(12, "slices=4\nframes=3\n")},
    /* OME */
    {.name = "ome_xyzct.tif", .order = "tcv", .description = OME("XYZCT", 2, 3, 4, "<TiffData/>")},
    {.name = "ome_xyczt.tif", .order = "tvc", .description = OME("XYCZT", 2, 3, 4, "<TiffData/>")},
    {.name = "ome_xytzc.tif", .order = "cvt", .description = OME("XYTZC", 2, 3, 4, "")},
    {.name = "ome_xyztc.tif", .order = "ctv", .description = OME("XYZTC", 2, 3, 4, "<TiffData/>")},
    {.name = "ome_xytcz.tif", .order = "vct", .description = OME("XYTCZ", 2, 3, 4, "<TiffData/>")},
    {.name = "ome_xyctz.tif", .order = "vtc", .description = OME("XYCTZ", 2, 3, 4, "<TiffData/>")},
    {.name = "ome_views_last.tif", .order = "vt", .description = OME("XYTZC", 1, 3, 4, "")},
    {.name = "ome_channels.tif", .order = "tv", .description = OME("XYCZT", 3, 1, 4, "")},
    {.name = "ome_blocks.tif",
     .order = "vt",
     .description = OME("XYZTC", 1, 3, 4,
                        "<TiffData IFD=\"0\"/><TiffData IFD=\"1\" FirstT=\"1\"/>"
                        "<TiffData IFD=\"2\" FirstT=\"2\"/><TiffData IFD=\"3\" FirstT=\"3\"/>"
                        "<TiffData IFD=\"4\" FirstZ=\"1\"/>"
                        "<TiffData IFD=\"5\" FirstZ=\"1\" FirstT=\"1\"/>"
                        "<TiffData IFD=\"6\" FirstZ=\"1\" FirstT=\"2\"/>"
                        "<TiffData IFD=\"7\" FirstZ=\"1\" FirstT=\"3\"/>"
                        "<TiffData IFD=\"8\" FirstZ=\"2\"/>"
                        "<TiffData IFD=\"9\" FirstZ=\"2\" FirstT=\"1\"/>"
                        "<TiffData IFD=\"10\" FirstZ=\"2\" FirstT=\"2\"/>"
                        "<TiffData IFD=\"11\" FirstZ=\"2\" FirstT=\"3\"/>")},
    {.name = "ome_set.tif",
     .order = "tv",
     .description = OME("XYZTC", 1, 3, 8,
                        "<TiffData PlaneCount=\"12\"><UUID FileName=\"a.ome.tif\">urn:uuid:1</UUID>"
                        "</TiffData><TiffData FirstT=\"4\" PlaneCount=\"12\">"
                        "<UUID FileName=\"b.ome.tif\">urn:uuid:2</UUID></TiffData>")},
    {.name = "ome_short.tif",
     .order = "tv",
     .left_out = 1,
     .description = OME("XYZTC", 1, 3, 4, "<TiffData/>")},
    {.name = "ome_broken.tif", .order = "tv", .description = "<?xml version=\"1.0\"?><OME><Image>"},
    {.name = "ome_entities.tif",
     .order = "tv",
     .description = "<!DOCTYPE OME [<!ENTITY a SYSTEM \"file:///etc/passwd\">]><OME>&a;</OME>"},
    /* tifffile */
    {.name = "shaped.tif", .order = "tv", .description = "{\"shape\": [4, 3, 5, 7]}"},
    {.name = "shaped_axes.tif",
     .order = "vt",
     .description = "{\"shape\": [3, 4, 5, 7], \"axes\": \"ZTYX\"}"},
    {.name = "shaped_channels.tif",
     .order = "tcv",
     .description = "{\"shape\": [4, 2, 3, 5, 7], \"axes\": \"TCZYX\"}"},
    {.name = "shaped_by_frame.tif",
     .order = "tv",
     .every_page = 1,
     .description = "{\"shape\": [3, 5, 7]}"},
    {.name = "shaped_by_page.tif",
     .order = "tv",
     .every_page = 1,
     .description = "{\"shape\": [5, 7]}"},
    {.name = "shaped_wrong.tif", .order = "tv", .description = "{\"shape\": [5, 3, 5, 7]}"},
    {.name = "shaped_more.tif", .order = "tv", .description = "{\"shape\": [3, 5, 7]}"},
    {.name = "shaped_unnamed.tif", .order = "tvc", .description = "{\"shape\": [4, 3, 2, 5, 7]}"},
    /* refused */
    {.name = "rgb.tif", .order = "tv", .bits = 8, .samples = 3, .photometric = PHOTOMETRIC_RGB},
    {.name = "palette.tif", .order = "tv", .bits = 8, .photometric = PHOTOMETRIC_PALETTE},
    {.name = "signed.tif", .order = "tv", .is_signed = 1},
    {.name = "mixed.tif", .order = "tv", .odd_page = 5},
    {.name = "eleven.tif", .order = "tv", .left_out = 1},
};

static void put_sample(uint8_t *to, int value, const struct stack *row)
{
    const float real = (float)value;
    const uint32_t word = (uint32_t)value;
    const uint16_t half = (uint16_t)value;
    if (row->bits == 8) {
        *to = (uint8_t)value;
    } else if (row->bits != 32) {
        memcpy(to, &half, sizeof half);
    } else {
        memcpy(to, row->is_float ? (const void *)&real : (const void *)&word, sizeof word);
    }
}

static void set_fields(TIFF *tiff, const struct stack *row, int height, int width)
{
    static uint16_t map[256];
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, row->bits != 0 ? row->bits : 16);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, row->samples != 0 ? row->samples : 1);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
                 row->is_float    ? SAMPLEFORMAT_IEEEFP
                 : row->is_signed ? SAMPLEFORMAT_INT
                                  : SAMPLEFORMAT_UINT);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC,
                 row->photometric != 0 ? row->photometric : PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, row->compression != 0 ? row->compression : 1);
    if (row->predictor != 0) {
        TIFFSetField(tiff, TIFFTAG_PREDICTOR, row->predictor);
    }
    if (row->photometric == PHOTOMETRIC_PALETTE) {
        TIFFSetField(tiff, TIFFTAG_COLORMAP, map, map, map);
    }
    if (row->tile != 0) {
        TIFFSetField(tiff, TIFFTAG_TILEWIDTH, row->tile);
        TIFFSetField(tiff, TIFFTAG_TILELENGTH, row->tile);
    } else {
        TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, row->rows != 0 ? row->rows : height);
    }
}

static void put_page(TIFF *tiff, const struct stack *row, const int at[3], int number)
{
    static uint8_t samples[MOST];
    const int height = row->height != 0 ? row->height : HEIGHT;
    const int width = (row->width != 0 ? row->width : WIDTH) + (number + 1 == row->odd_page);
    const int bytes = row->bits != 0 ? row->bits / 8 : 2,
              times = row->samples != 0 ? row->samples : 1;
    const int pitch = (row->tile != 0 ? row->tile : width) * times * bytes;
    set_fields(tiff, row, height, width);
    if (row->description != NULL && (number == 0 || row->every_page)) {
        TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, row->description);
    }
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width * times; x++) {
            put_sample(samples + y * pitch + x * bytes,
                       count_at(at[0], at[1], at[2], y, x / times) + row->more, row);
        }
    }
    if (row->tile != 0) {
        CHECK(TIFFWriteTile(tiff, samples, 0, 0, 0, 0) > 0);
    }
    /* libtiff turns the bytes of what it is given */
    for (int y = 0; row->tile == 0 && y < height; y++) {
        CHECK(TIFFWriteScanline(tiff, samples + y * pitch, (uint32_t)y, 0) == 1);
    }
    CHECK(TIFFWriteDirectory(tiff) == 1);
}

/* Pages from..to-1 of the row's order, which stands for a slice of it. */
static void write_stack(const char *path, const struct stack *row, int from, int to)
{
    static const int sizes[] = {FRAMES, VIEWS, CHANNELS};
    TIFF *tiff = TIFFOpen(path, row->mode != NULL ? row->mode : "w");
    CHECK(tiff != NULL);
    for (int page = from; page < to; page++) {
        int at[3] = {0, 0, 0}, rest = page;
        for (int i = (int)strlen(row->order) - 1; i >= 0; i--) {
            const int axis = (int)(strchr("tvc", row->order[i]) - "tvc");
            at[axis] = rest % sizes[axis];
            rest /= sizes[axis];
        }
        put_page(tiff, row, at, page - from);
    }
    TIFFClose(tiff);
}

static void write_stacks(void)
{
    for (size_t i = 0; i < sizeof stacks / sizeof stacks[0]; i++) {
        const int pages = FRAMES * VIEWS * (strchr(stacks[i].order, 'c') != NULL ? CHANNELS : 1);
        if (stacks[i].compression != 0 && !TIFFIsCODECConfigured((uint16_t)stacks[i].compression)) {
            puts(stacks[i].name); /* the row of inputs.tsv is left out */
            continue;
        }
        write_stack(stacks[i].name, &stacks[i], 0, pages - stacks[i].left_out);
    }
}

/* ImageJ's form of more than 4 GB: one directory, the pages behind each other. */
static void write_block(void)
{
    struct tiff_bytes file;
    tiff_bytes_make(&file, 1, 1, FRAMES * VIEWS, HEIGHT, WIDTH, IMAGEJ(12, "slices=3\nframes=4\n"));
    CHECK(tiff_bytes_save("ij_block.tif", file.data, file.size));
}

/* ---- folders ---- */

static void write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    CHECK(file != NULL && fputs(text, file) >= 0 && fclose(file) == 0);
}

/* `each` pages of the row a file; numbers 8, 9, 10, ..: by name 10 would come before 8. */
static void write_folder(const char *folder, const char *order, int files, int each)
{
    const struct stack row = {.order = order};
    CHECK(mkdir(folder, 0777) == 0);
    for (int i = 0; i < files; i++) {
        char path[256];
        snprintf(path, sizeof path, "%s/part %d.tif", folder, i + 8);
        write_stack(path, &row, i * each, (i + 1) * each);
    }
}

static void write_folders(void)
{
    static const struct stack wide = {.order = "vt", .width = WIDTH + 1},
                              floats = {.order = "vt", .bits = 32};
    write_folder("by_view", "vt", VIEWS, FRAMES);
    write_text("by_view/notes.txt", "no TIFF");
    write_text("by_view/.hidden.tif", "no TIFF");
    write_folder("by_frame", "tv", FRAMES, VIEWS);
    write_folder("by_page", "tv", FRAMES * VIEWS, 1);
    write_folder("two_frames", "tv", FRAMES / 2, 2 * VIEWS);
    write_folder("first_three", "tv", VIEWS, VIEWS); /* 3 frames of 3 views, or 3 views */
    write_folder("uneven", "vt", VIEWS, FRAMES);
    write_stack("uneven/part 9.tif", &wide, 0, FRAMES);
    write_folder("shorter", "vt", VIEWS, FRAMES);
    write_stack("shorter/part 10.tif", &floats, 0, FRAMES - 1);
    write_folder("other_type", "vt", VIEWS, FRAMES);
    write_stack("other_type/part 10.tif", &floats, 0, FRAMES);
    CHECK(mkdir("no_tiffs", 0777) == 0);
    write_text("no_tiffs/notes.txt", "no TIFF");
}

/* ---- HDF5 ---- */

struct set {
    const char *name, *dataset;
    hid_t type;
    int frames, height, width; /* 0: the usual; frames -1: no axis */
    int is_packed;             /* in chunks, deflated */
    const char *axes;          /* the attribute */
    int is_counted;            /* element i is i + 1 */
};

static void write_set(const struct set *row)
{
    const int frames = row->frames > 0 ? row->frames : row->frames < 0 ? 1 : FRAMES;
    const hsize_t height = row->height > 0 ? (hsize_t)row->height : HEIGHT;
    const hsize_t width = row->width > 0 ? (hsize_t)row->width : WIDTH;
    const hsize_t shape[] = {(hsize_t)frames, VIEWS, height, width},
                  chunk[] = {1, 1, height, width};
    const int skipped = row->frames < 0, count = frames * VIEWS * (int)(height * width);
    int *values = malloc((size_t)count * sizeof *values);
    CHECK(values != NULL);
    for (int i = 0; i < count; i++) {
        const int x = i % (int)width, y = i / (int)width % (int)height;
        const int page = i / (int)(width * height);
        values[i] = row->is_counted ? i + 1 : count_at(page / VIEWS, page % VIEWS, 0, y, x);
    }
    hid_t file = H5Fcreate(row->name, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    hid_t links = H5Pcreate(H5P_LINK_CREATE), storage = H5Pcreate(H5P_DATASET_CREATE);
    CHECK(H5Pset_create_intermediate_group(links, 1) >= 0);
    CHECK(!row->is_packed ||
          (H5Pset_chunk(storage, 4, chunk) >= 0 && H5Pset_deflate(storage, 4) >= 0));
    hid_t space = H5Screate_simple(4 - skipped, shape + skipped, NULL);
    hid_t set = H5Dcreate2(file, row->dataset, row->type, space, links, storage, H5P_DEFAULT);
    CHECK(H5Dwrite(set, H5T_NATIVE_INT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
    if (row->axes != NULL) {
        hid_t text = H5Tcopy(H5T_C_S1), scalar = H5Screate(H5S_SCALAR);
        CHECK(H5Tset_size(text, strlen(row->axes)) >= 0);
        hid_t attribute = H5Acreate2(set, "axes", text, scalar, H5P_DEFAULT, H5P_DEFAULT);
        CHECK(H5Awrite(attribute, text, row->axes) >= 0 && H5Aclose(attribute) >= 0);
        H5Sclose(scalar);
        H5Tclose(text);
    }
    H5Dclose(set);
    H5Sclose(space);
    H5Pclose(storage);
    H5Pclose(links);
    CHECK(H5Fclose(file) >= 0);
    free(values);
}

static void write_sets(void)
{
    const struct set sets[] = {
        /* what the others are compared with */
        {.name = "plain.ref", .dataset = "/views", .type = H5T_IEEE_F32LE},
        {.name = "frame.ref", .dataset = "/views", .type = H5T_IEEE_F32LE, .frames = 1},
        {.name = "one_row.ref", .dataset = "/views", .type = H5T_IEEE_F32LE, .height = 1},
        {.name = "one_column.ref", .dataset = "/views", .type = H5T_IEEE_F32LE, .width = 1},
        {.name = "prime.ref",
         .dataset = "/views",
         .type = H5T_IEEE_F32LE,
         .height = 13,
         .width = 31},
        {.name = "counted.ref", .dataset = "/views", .type = H5T_IEEE_F32LE, .is_counted = 1},
        {.name = "three.ref", .dataset = "/views", .type = H5T_IEEE_F32LE, .frames = 3},
        {.name = "volume.ref", .dataset = "/volume", .type = H5T_IEEE_F32LE},
        /* inputs */
        {.name = "u8.h5", .dataset = "/views", .type = H5T_STD_U8LE},
        {.name = "u16.h5", .dataset = "/views", .type = H5T_STD_U16LE, .axes = "tvyx"},
        {.name = "u16_be.h5", .dataset = "/views", .type = H5T_STD_U16BE},
        {.name = "i16.h5", .dataset = "/views", .type = H5T_STD_I16LE},
        {.name = "i32_packed.h5", .dataset = "/views", .type = H5T_STD_I32LE, .is_packed = 1},
        {.name = "u64.h5", .dataset = "/views", .type = H5T_STD_U64LE},
        {.name = "f64.h5", .dataset = "/views", .type = H5T_IEEE_F64LE},
        {.name = "vyx.h5", .dataset = "/views", .type = H5T_STD_U16LE, .frames = -1, .axes = "vyx"},
        {.name = "other.h5", .dataset = "/stack", .type = H5T_STD_U16LE},
        {.name = "nested.h5", .dataset = "/exchange/data", .type = H5T_STD_U16LE},
        {.name = "axes.h5", .dataset = "/views", .type = H5T_STD_U16LE, .axes = "vtyx"},
        {.name = "newer.h5", .dataset = "/views", .type = H5T_STD_U16LE},
        {.name = "float_volume.h5", .dataset = "/stack", .type = H5T_IEEE_F32LE},
    };
    for (size_t i = 0; i < sizeof sets / sizeof sets[0]; i++) {
        write_set(&sets[i]);
    }
    /* the version of the superblock, of which the library knows 0 to 3 */
    FILE *file = fopen("newer.h5", "r+b");
    CHECK(file != NULL && fseek(file, 8, SEEK_SET) == 0 && fputc(9, file) == 9 &&
          fclose(file) == 0);
}

int main(int argc, char **argv)
{
    CHECK(argc == 2 && chdir(argv[1]) == 0);
    write_stacks();
    write_block();
    write_folders();
    write_sets();
    return 0;
}
