/* One branch's decoder of REFERENCE.md 4: alignment + U-Net. */
#ifndef V2V3D_NN_UNET_H
#define V2V3D_NN_UNET_H

#include "nn/align_conv.h"
#include "nn/layer.h"
#include "nn/scene.h"

struct v2v_unet;

struct v2v_unet_spec {
    const char *prefix;   /* "unet1" or "unet2" */
    const int32_t *views; /* network order */
    int64_t view_count;
    int64_t features, slices, width;
    int every_slice;
    struct v2v_conv_method method;
};

enum v2v_status v2v_unet_create(struct v2v_unet **unet, struct v2v_fields *fields,
                                const struct v2v_unet_spec *spec,
                                const struct v2v_shifts *shifts) V2V_MUST_CHECK;
void v2v_unet_destroy(struct v2v_unet **unet);

/* Floats of workspace for frames of [height,width], of which strips of rows may take
 * `strip_floats`; then plan with that much memory, borrowed, and for features of the sizes of
 * `like`. Two U-Nets that don't train may share one workspace: what one leaves the other
 * overwrites. */
int64_t v2v_unet_workspace(struct v2v_unet *unet, int64_t height, int64_t width,
                           int64_t strip_floats, int training);
enum v2v_status v2v_unet_plan(struct v2v_unet *unet, float *workspace,
                              const struct v2v_padded *like, int training) V2V_MUST_CHECK;
void v2v_unet_weights_changed(struct v2v_unet *unet, const struct v2v_parameters *parameters);

/* Can it compute a scene's tiles alone? Only by minimal filtering, and not in training. */
int v2v_unet_knows_scenes(const struct v2v_unet *unet);

/* The network's output [z,y,x]; it lives in the U-Net until the next call. With a scene the
 * full-size layers compute its tiles alone; NULL: the whole frame. */
const float *v2v_unet_forward(struct v2v_unet *unet, const struct v2v_padded *features,
                              const struct v2v_scene *scene);

/* Add the gradients of the parameters and of the features; `doutput` [z,y,x] is the gradient after
 * the last activation. */
void v2v_unet_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                       struct v2v_padded *dfeatures, const struct v2v_padded *features,
                       const float *doutput);

#endif
