/* What of a frame's images of half the sides is computed, given the tiles of the frame itself:
 * the first layer behind E0 need not compute background, nor the last one before the full-size
 * layers what these do not read. What is read equals whole images to
 * round-off. */
#ifndef V2V3D_V2V_SCENE_HALF_H
#define V2V3D_V2V_SCENE_HALF_H

#include "v2v3d/op/tiles.h"

/* Lists of tiles of half the frame's sides. */
struct v2v_scene_half {
    uint8_t *mask;
    struct v2v_tiles mixed; /* see more than background; and one that does not, for all others */
    struct v2v_tiles even;  /* all others */
    struct v2v_tiles read;  /* by the computed tiles of the frame */
    int64_t row, column;    /* of the one tile of background that is computed */
};

enum v2v_status v2v_scene_half_init(struct v2v_scene_half *half,
                                    const struct v2v_tiles *frame) V2V_MUST_CHECK;
void v2v_scene_half_fini(struct v2v_scene_half *half);

/* From the frame's `computed` and `dark` tiles; in a square of those that begins at
 * (row,column) the one tile has its place. */
void v2v_scene_half_set(struct v2v_scene_half *half, const struct v2v_tiles *computed,
                        const struct v2v_tiles *dark, int64_t row, int64_t column);

/* The even tiles of images [channels,y,x] become what the one tile is. */
void v2v_scene_half_level(const struct v2v_scene_half *half, float *images, int64_t channels);

#endif
