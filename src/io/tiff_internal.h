#ifndef V2V_IO_TIFF_INTERNAL_H
#define V2V_IO_TIFF_INTERNAL_H

#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include <stdarg.h>
#include <tiffio.h>

/** What libtiff said about one file: the first error, and the last warning, since it calls some
 *  failures (a loop of directories) warnings. */
struct v2v_tiff_log {
    char error[384];
    char warning[384];
    int miscounted; /**< the warning says that libtiff made up the number of stored bytes */
    int lost;       /**< the warning says that it passed over a tag that matters here */
};

/** Hand an open descriptor to libtiff, its messages going to `log` instead of stderr. The handle
 *  owns the descriptor; when NULL comes back the caller still does. @kind Local. */
TIFF *v2v_tiff_wrap(int descriptor, const char *path, const char *mode, struct v2v_tiff_log *log);

/** Forget what was said so far. @kind Local. */
void v2v_tiff_log_clear(struct v2v_tiff_log *log);

/** The reason to print: never empty. @kind Local. */
const char *v2v_tiff_log_reason(const struct v2v_tiff_log *log);

/** The tag `Software` of files of which info->told or info->step say something, "" of others:
 *  "v2v3d; task X; first_frame T; recording_sum R; offset O; step S", without what is not known.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (does not fit) */
enum { V2V_TIFF_SOFTWARE_BYTES = 256 };
enum v2v_status v2v_tiff_software_format(char *text, size_t bytes,
                                         const struct v2v_tiff_info *info) V2V_MUST_CHECK;

/** Likewise read; the tag of other programs says nothing. @kind Local. */
void v2v_tiff_software_parse(struct v2v_tiff_info *info, const char *software);

/** A beat of the watchdog once every so many pages that are looked at. @kind Local. */
void v2v_tiff_beat(int64_t page);

/** A page's checksum as the tag `PageName`. @kind Local. @param pixels float32, as stored */
enum { V2V_TIFF_PAGE_NAME_BYTES = 24 };
void v2v_tiff_name_page(char name[V2V_TIFF_PAGE_NAME_BYTES], const float *pixels, int64_t count);

/** Has libtiff's current directory such a name? @kind Local. */
int v2v_tiff_has_sum(const struct v2v_tiff *tiff);

/** Pixels of the largest page that is read or written. */
#define V2V_TIFF_MOST_PIXELS INT32_MAX

/** A lossless codec, and the most bytes that it can make of one byte in the file: what a file
 * declares cannot pass what it holds. */
struct v2v_tiff_codec {
    uint16_t tag;
    int64_t expansion;
};

struct v2v_tiff_sample_type {
    uint16_t bits, format;
    double most;
};

/** What must be the same on every page. */
struct v2v_tiff_shape {
    int64_t height, width;
    const struct v2v_tiff_sample_type *type;
};

/** How one page is cut into pieces that are stored one by one: strips or tiles. */
struct v2v_tiff_grid {
    int64_t rows, columns; /* of a piece */
    int64_t across, count; /* pieces */
    int64_t bytes;         /* of a whole piece, decoded */
    const struct v2v_tiff_codec *codec;
    int tiled;
};

struct v2v_tiff {
    char path[V2V_PATH_BYTES];
    struct v2v_tiff_log log;
    struct v2v_tiff_info info;
    struct v2v_tiff_shape shape;
    TIFF *handle;
    int64_t file_bytes;
    uint64_t *directories; /* [room] offset of the directory of each page */
    int64_t room;
    int64_t current;    /* the page whose directory libtiff holds */
    int64_t *order;     /* [pages] of the file, in the order c, z, t; NULL: it is the file's own */
    int64_t block_from; /* offset of the pages of an ImageJ file with one directory, else 0 */
    unsigned char *piece;
    int64_t piece_bytes;
};

/** Record what is wrong with a page, which messages count from 1 as ImageJ does. @kind Local. */
enum v2v_status v2v_tiff_page_fail(const struct v2v_tiff *tiff, int64_t page, const char *file,
                                   int line, const char *format, ...)
    __attribute__((format(printf, 5, 6))) V2V_MUST_CHECK;
#define V2V_PAGE_FAIL(tiff, page, ...)                                                             \
    v2v_tiff_page_fail((tiff), (page), __FILE__, __LINE__, __VA_ARGS__)

/** How libtiff's current directory, that of `page`, cuts it into pieces. @kind Local. */
enum v2v_status v2v_tiff_describe_grid(const struct v2v_tiff *tiff, int64_t page,
                                       const struct v2v_tiff_shape *shape,
                                       struct v2v_tiff_grid *grid) V2V_MUST_CHECK;

/** Shape and pieces of libtiff's current directory, that of `page`: checked against what the
 *  program reads, against the file's length and, once tiff->shape is known, against that.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_tiff_check_page(const struct v2v_tiff *tiff, int64_t page,
                                    struct v2v_tiff_shape *shape,
                                    struct v2v_tiff_grid *grid) V2V_MUST_CHECK;

/** Rows that a piece has of the page: the last strip and the last tiles may hold fewer. */
int64_t v2v_tiff_piece_rows(const struct v2v_tiff_shape *shape, const struct v2v_tiff_grid *grid,
                            int64_t piece);

/** Bytes of a piece, decoded: the last strip is short, tiles are always whole. */
int64_t v2v_tiff_decoded_bytes(const struct v2v_tiff_shape *shape, const struct v2v_tiff_grid *grid,
                               int64_t piece);

/** Go to a page's directory. What libtiff said of the page before goes. @kind Local. */
enum v2v_status v2v_tiff_go_to(struct v2v_tiff *tiff, int64_t page) V2V_MUST_CHECK;

/** Fill tiff->info, and find the order of the pages, by tags and description of the first page,
 *  which is libtiff's current one. @kind Local. @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_tiff_describe(struct v2v_tiff *tiff) V2V_MUST_CHECK;

/** The axes of the pages, channels, slices, frames: image (c,z,t) is number sum of index * stride
 *  in the file, or that entry of `page`. @kind Local. @param size their product is the pages
 *  @param page may be NULL. @return V2V_OK | V2V_E_MEMORY */
enum { V2V_TIFF_AXES = 3 };
enum v2v_status v2v_tiff_set_axes(struct v2v_tiff *tiff, const int64_t size[V2V_TIFF_AXES],
                                  const int64_t stride[V2V_TIFF_AXES],
                                  const int64_t *page) V2V_MUST_CHECK;

/** OME-XML, and tifffile's JSON: axes, lengths, and the order of the pages. *found = 0 where the
 *  description is another text, or says nothing of the pages. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT (it contradicts the pages, or is not read: why) | V2V_E_MEMORY */
enum v2v_status v2v_ome_read(struct v2v_tiff *tiff, const char *description,
                             int *found) V2V_MUST_CHECK;
enum v2v_status v2v_shaped_read(struct v2v_tiff *tiff, const char *description,
                                int *found) V2V_MUST_CHECK;

/** Of square pixels, micrometres; others are warned of. 0: not known. @kind Local. */
double v2v_tiff_pixel_size(const char *path, double x, double y);

/** A unit as programs write it in micrometres, or in seconds; 0: unknown. @kind Local. */
double v2v_tiff_length_um(const char *unit);
double v2v_tiff_seconds(const char *unit);

/** ImageJ's own description of a stack, as far as it says something; `images` is 0 when the text
 *  is not ImageJ's. */
struct v2v_imagej {
    int64_t images, channels, slices, frames;
    double unit_um, unit_y_um; /**< lengths of the units of x and y; 0 unknown */
    double spacing_um;         /**< of slices; 0 unknown */
    double frame_interval_s;   /**< 0 unknown */
};

/** Read the lines "key=value" of a description (NULL is fine). @kind Local. */
void v2v_imagej_parse(struct v2v_imagej *imagej, const char *description);

/** How ImageJ makes values of samples. @kind Local. @param description may be NULL */
enum v2v_imagej_values {
    V2V_IMAGEJ_AS_STORED,
    V2V_IMAGEJ_STRAIGHT, /**< *zero + *scale * sample, scale not 0 */
    V2V_IMAGEJ_CURVED    /**< another function */
};
enum v2v_imagej_values v2v_imagej_values(double *zero, double *scale, const char *description);

/** The description of a hyperstack. @kind Local. @return V2V_OK | V2V_E_INPUT (does not fit) */
enum v2v_status v2v_imagej_format(char *text, size_t bytes,
                                  const struct v2v_tiff_info *info) V2V_MUST_CHECK;

/** OME-XML of a file whose pages are in the order c, z, t, and room enough for it. In ASCII, which
 *  is all that TIFF allows. @kind Local. @return V2V_OK | V2V_E_INPUT (does not fit)
 *  @source https://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd */
int64_t v2v_ome_bytes(const struct v2v_tiff_info *info);
enum v2v_status v2v_ome_format(char *text, size_t bytes,
                               const struct v2v_tiff_info *info) V2V_MUST_CHECK;

/** Does a file of so many pages need BigTIFF's 64-bit offsets? @kind Local. */
int v2v_tiff_needs_big(int64_t pages, int64_t page_bytes);

#endif
