/** Rows of an image that is computed from top to bottom: of each channel memory holds some rows, in
 *  a ring, between columns of zeros, so that what convolves them asks for no border. */
#ifndef V2V3D_OP_LINES_H
#define V2V3D_OP_LINES_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct v2v_lines {
    float *data; /**< channel 0, row 0, column 0 */
    int64_t channels, height, width;
    int64_t held; /**< rows of a channel in memory: row y is at place y mod held */
    int64_t pitch;
};

/** Floats of memory for `held` rows. @kind Local. */
int64_t v2v_lines_floats(int64_t channels, int64_t held, int64_t width);

/** Lay lines out in borrowed memory, aligned to 64 bytes. More rows than the image has are held to
 *  read the rows of zeros above and below it. @kind Local. */
struct v2v_lines v2v_lines_view(float *memory, int64_t channels, int64_t held, int64_t height,
                                int64_t width);

/** A plain image [channel,y,x] as lines: to be written alone, for it has no columns of zeros.
 *  @kind Local. */
struct v2v_lines v2v_lines_of_image(float *image, int64_t channels, int64_t height, int64_t width);

/** Channels [first, first + channels) of the same lines. @kind Local. */
struct v2v_lines v2v_lines_channels(const struct v2v_lines *lines, int64_t first, int64_t channels);

/** Where row y >= -held lies in the ring. */
static inline int64_t v2v_lines_place(const struct v2v_lines *lines, int64_t y)
{
    return (y + lines->held) % lines->held;
}

/** Row y of the first channel; that of the next one lies v2v_lines_stride floats further. */
static inline float *v2v_lines_at(const struct v2v_lines *lines, int64_t y)
{
    return lines->data + v2v_lines_place(lines, y) * lines->pitch;
}

static inline int64_t v2v_lines_stride(const struct v2v_lines *lines)
{
    return lines->held * lines->pitch;
}

/** Zeros about rows [first, first + rows): the columns beside them, the row above the image's first
 *  and that below its last. @kind Local; by one thread alone. */
void v2v_lines_frame(const struct v2v_lines *lines, int64_t first, int64_t rows);

/** Rows of `lines` += those of `other`. @kind Local; by one thread alone. */
void v2v_lines_add(const struct v2v_lines *lines, const struct v2v_lines *other, int64_t first,
                   int64_t rows);

#ifdef __cplusplus
}
#endif

#endif
