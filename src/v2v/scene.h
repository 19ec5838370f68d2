/* What of a slab of a frame is computed: tiles that may hold light, and one square of background
 * that stands for all others. */
#ifndef V2V3D_V2V_SCENE_H
#define V2V3D_V2V_SCENE_H

#include "v2v/scene_half.h"
#include "v2v/slabs.h"
#include "v2v3d/op/tiles.h"
#include "v2v3d/optics/carve.h"

/* Tiles of the sample's side; what counts is the inside, without the outermost tiles. Its first row
 * is a multiple of that. */
enum { V2V_SAMPLE_TILES = 8 };

struct v2v_scene {
    struct v2v_carve *carve;
    int64_t tiles;                     /* of the frame */
    float *light;                      /* [rows of the frame,columns] of tiles */
    const float *own_light;            /* those of the slab [rows,columns] */
    uint8_t *mask;                     /* [rows,columns] of what is computed */
    struct v2v_tiles computed;         /* may hold light, or are the sample */
    struct v2v_tiles dark;             /* hold no light: all others and the sample */
    int64_t sample_row, sample_column; /* of the sample's first tile */
    struct v2v_scene_half half;        /* the same for images of half the sides */
};

/* For a frame of [height,width]; the tiles are those of the rows that the slab computes. */
enum v2v_status v2v_scene_init(struct v2v_scene *scene, const struct v2v_shifts *shifts,
                               int64_t height, int64_t width,
                               const struct v2v_slab *slab) V2V_MUST_CHECK;
void v2v_scene_fini(struct v2v_scene *scene);

/* Sort the tiles by the views [v,y,x]: those are computed whose light is more than `tolerance`
 * times the brightest tiles' and more than noise alone would show. Returns 0 when it is not worth
 * while: nearly all tiles may hold light, or there is no square of background. */
int v2v_scene_look(struct v2v_scene *scene, const float *views, double tolerance);

#endif
