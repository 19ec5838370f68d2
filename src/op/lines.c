#include "v2v3d/op/lines.h"
#include "op/pixels.h"
#include "v2v3d/base/memory.h"
#include <string.h>

/** Floats of a cache line: column 0 of every row begins one. */
enum { UNIT = 16 };

/** A column of zeros on either side; the left one is the last of the row before. An odd number of
 *  cache lines, for an even one would put the same columns of all rows into few sets of a cache. */
static int64_t pitch_of(int64_t width)
{
    return ((width + 2 + UNIT - 1) / UNIT | 1) * UNIT;
}

/** Before the first row for its left column, behind the last one for vectors that end beyond it. */
int64_t v2v_lines_floats(int64_t channels, int64_t held, int64_t width)
{
    int64_t floats = v2v_mem_product(channels, held, pitch_of(width));
    return floats < 0 ? -1 : floats + 2 * (int64_t)UNIT;
}

struct v2v_lines v2v_lines_view(float *memory, int64_t channels, int64_t held, int64_t height,
                                int64_t width)
{
    return (struct v2v_lines){memory + UNIT, channels, height, width, held, pitch_of(width)};
}

struct v2v_lines v2v_lines_of_image(float *image, int64_t channels, int64_t height, int64_t width)
{
    return (struct v2v_lines){image, channels, height, width, height, width};
}

struct v2v_lines v2v_lines_channels(const struct v2v_lines *lines, int64_t first, int64_t channels)
{
    struct v2v_lines part = *lines;
    part.data += first * v2v_lines_stride(lines);
    part.channels = channels;
    return part;
}

static void clear_row(const struct v2v_lines *lines, int64_t y)
{
    float *row = v2v_lines_at(lines, y);
    for (int64_t c = 0; c < lines->channels; c++, row += v2v_lines_stride(lines)) {
        memset(row - 1, 0, (size_t)(lines->width + 2) * sizeof *row);
    }
}

void v2v_lines_frame(const struct v2v_lines *lines, int64_t first, int64_t rows)
{
    for (int64_t y = first; y < first + rows; y++) {
        float *row = v2v_lines_at(lines, y);
        for (int64_t c = 0; c < lines->channels; c++, row += v2v_lines_stride(lines)) {
            row[-1] = 0.0f;
            row[lines->width] = 0.0f;
        }
    }
    if (first == 0 && rows > 0) {
        clear_row(lines, -1);
    }
    if (first + rows == lines->height && rows > 0) {
        clear_row(lines, lines->height);
    }
}

void v2v_lines_add(const struct v2v_lines *lines, const struct v2v_lines *other, int64_t first,
                   int64_t rows)
{
    for (int64_t y = first; y < first + rows; y++) {
        float *sum = v2v_lines_at(lines, y);
        const float *x = v2v_lines_at(other, y);
        for (int64_t c = 0; c < lines->channels; c++) {
            v2v_pixels_add(sum + c * v2v_lines_stride(lines), x + c * v2v_lines_stride(other),
                           lines->width);
        }
    }
}
