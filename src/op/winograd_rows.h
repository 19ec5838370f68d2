/** Runs of tiles between images and panels of values: the transforms along both axes. The value of
 *  point p, tile t, channel c is at values[p * point + (t/32 * channels + c) * 32 + t%32].
 *  All functions take one channel and are called by one thread each.
 */
#ifndef OP_WINOGRAD_ROWS_H
#define OP_WINOGRAD_ROWS_H

#include "op/winograd_kernel.h"
#include "v2v3d/op/winograd.h"

/** Floats of a cache's line. */
enum { WINOGRAD_LINE = 16 };

struct rows {
    const struct winograd_kernel *kernel;
    const struct v2v_tile_run *run;
    int64_t runs;
    int64_t begun;         /**< tiles of the first run that are left out */
    int64_t tiles;         /**< of all runs that are taken: the last one may be cut, too */
    int64_t tiles_x;       /**< most tiles of a run */
    int64_t panels;        /**< of the values */
    int64_t height, width; /**< convolved */
    int64_t out_width;     /**< of the output image */
    int64_t first_row;     /**< row of tiles that comes first in the output image's memory */
    int stride2;           /**< the output image has every second row and column */
    int64_t shift;         /**< added to the planes' offsets */
    int64_t pitch;         /**< of the input planes */
    int half;
    int in_order; /**< whole rows are transformed one after the other */
    const struct v2v_tiles *in_list, *out_list; /**< v2v_winograd_part */
    float *lines;                               /**< scratch of all threads */
    int64_t line_floats;
};

/** Floats from point to point: not a power of two, which would lead all points of a tile to the
 *  same places of a cache. */
int64_t v2v_rows_point(int64_t panels, int64_t channels);

/** Scratch of one thread. */
int64_t v2v_rows_floats(int64_t tiles_x);

/** `values` points to the channel's first value of `channels`; this thread takes `following` next,
 *  or the same one. @param plane those of all channels */
void v2v_rows_input(const struct rows *rows, float *values, int64_t channels, const float *base,
                    const struct v2v_plane *plane, int64_t channel, int64_t following);
/** Adjoint: adds to the plane. */
void v2v_rows_input_turned(const struct rows *rows, float *base, const struct v2v_plane *plane,
                           const float *values, int64_t channels);

/** image = leaky(values transformed back + bias) */
void v2v_rows_output(const struct rows *rows, float *image, const float *values, int64_t channels,
                     float bias, float slope);
/** Adjoint, without bias and activation. */
void v2v_rows_output_turned(const struct rows *rows, float *values, int64_t channels,
                            const float *image);

#endif
