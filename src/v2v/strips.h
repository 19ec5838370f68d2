/* A chain of full-size layers, by Winograd or in bf16, in strips of rows, for inference: what lies
 * between the layers never exists for a large frame as a whole, nor where nothing asks for it. */
#ifndef V2V3D_V2V_STRIPS_H
#define V2V3D_V2V_STRIPS_H

#include "v2v/align_conv.h"
#include "v2v/scene.h"
#include "v2v3d/nn/layer.h"

struct v2v_strips;

/* Floats of all strips that are worth their memory: a frame of 256 x 256 pixels at width 128 is
 * one strip still, and a scene's few tiles share a reading of the weights; and the fewest that are
 * tried. */
#define V2V_STRIPS_FLOATS ((int64_t)128 << 20)
#define V2V_STRIPS_LEAST_FLOATS ((int64_t)1 << 20)

enum { V2V_STRIPS_MOST = 4 };

/* The chain begins with the alignment, or with the first layer, which reads whole images. A strip
 * has 32 rows at least, whatever that takes. */
struct v2v_strips_spec {
    struct v2v_align_conv *align; /* NULL: none */
    struct v2v_layer *layer[V2V_STRIPS_MOST];
    int64_t layers;
    int64_t height, width; /* of the frame */
    int64_t most_floats;   /* of all strips */
    int in_bf16;           /* 0: by Winograd; needs v2v_tile_conv_usable */
    struct v2v_workspace *workspace;
    struct v2v_pool *pool; /* of transformed weights; or NULL */
};

/* The layers' own operators are given up. `like` as in v2v_align_conv_plan. */
enum v2v_status v2v_strips_create(struct v2v_strips **strips, const struct v2v_strips_spec *spec,
                                  const struct v2v_padded *like) V2V_MUST_CHECK;
void v2v_strips_destroy(struct v2v_strips **strips);

/* Floats of the strips that forward needs. */
int64_t v2v_strips_floats(const struct v2v_strips_spec *spec);

void v2v_strips_weights_changed(struct v2v_strips *strips, const struct v2v_parameters *parameters);

struct v2v_strips_data {
    const struct v2v_padded *features; /* with alignment, or */
    const float *images;               /* [first layer's in,y,x] */
    float *strips;                     /* scratch, v2v_strips_floats */
    float *out;                        /* [last layer's out,y,x] */
};

/* With a scene only its tiles are computed; elsewhere every channel has the mean of the sample,
 * whose strip comes first. NULL: all tiles. */
void v2v_strips_forward(struct v2v_strips *strips, const struct v2v_strips_data *data,
                        const struct v2v_scene *scene);

#endif
