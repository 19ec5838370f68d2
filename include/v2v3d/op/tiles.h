/** Lists of tiles: which 4 x 4 pixels of a frame are computed. */
#ifndef V2V3D_OP_TILES_H
#define V2V3D_OP_TILES_H

#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Pixels of a tile's side. */
enum { V2V_TILE = 4 };

/** Neighbouring tiles of one row of tiles. */
struct v2v_tile_run {
    int64_t row, first, count;
};

/** Tiles of a frame, row after row, each in one run. */
struct v2v_tiles {
    int64_t rows, columns;    /**< of the frame */
    int64_t count;            /**< tiles listed */
    struct v2v_tile_run *run; /**< those of row r: run[first[r]] .. run[first[r + 1] - 1] */
    int64_t *first;           /**< [rows + 1] */
    int64_t *before;          /**< [rows + 1] tiles listed in the rows above */
    int32_t *number;          /**< [rows,columns] of a tile in the list; -1: it is not there */
};

/** All tiles of a frame of [height,width] pixels. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_tiles_init(struct v2v_tiles *tiles, int64_t height,
                               int64_t width) V2V_MUST_CHECK;
void v2v_tiles_fini(struct v2v_tiles *tiles);

/** List the tiles that `mask` [rows,columns] marks with something else than 0. @kind Local. */
void v2v_tiles_set(struct v2v_tiles *tiles, const uint8_t *mask);

/** Rows [first, last) of tiles of an image [channels,rows_held,width] whose memory begins with row
 *  `begin` of tiles. */
struct v2v_tiles_image {
    float *data;
    int64_t channels, rows_held, width;
    int64_t begin, first, last;
    int64_t size; /**< pixels of a tile's side in this image: V2V_TILE or half of it */
};

/** The listed tiles become value[channel * step]; these may lie in the image, in other tiles.
 *  @kind Local. */
void v2v_tiles_fill(const struct v2v_tiles *tiles, const struct v2v_tiles_image *image,
                    const float *value, int64_t step);

/** One line of a channel that holds listed tiles alone, each with its V2V_TILE x V2V_TILE pixels in
 *  a row, in the list's order. Line i of `run` (0: the one above it, V2V_TILE + 1: the one below)
 *  becomes line[V2V_TILE * count + 2], from the pixel to its left on. A pixel of a tile that is not
 *  listed is the nearest one of the run, one beyond the frame 0. The frame is whole tiles.
 *  @kind Local. @param run listed tiles side by side */
void v2v_tiles_line(float *line, const struct v2v_tiles *tiles, const float *channel,
                    const struct v2v_tile_run *run, int64_t i);

#ifdef __cplusplus
}
#endif

#endif
