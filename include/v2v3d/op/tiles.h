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

/** Lines [y0,y1) of the listed tiles become value[channel * step]; these may lie in the image, in
 *  other tiles. @kind Local. */
void v2v_tiles_fill(const struct v2v_tiles *tiles, const struct v2v_tiles_image *image, int64_t y0,
                    int64_t y1, const float *value, int64_t step);

#ifdef __cplusplus
}
#endif

#endif
