/* One branch's decoder of REFERENCE.md 4: alignment + U-Net. */
#ifndef V2V3D_V2V_UNET_H
#define V2V3D_V2V_UNET_H

#include "v2v/align_conv.h"
#include "v2v/scene.h"
#include "v2v/slabs.h"
#include "v2v3d/nn/layer.h"

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
/* Another workspace for the same parameters. */
enum v2v_status v2v_unet_twin(struct v2v_unet **twin, const struct v2v_unet *unet,
                              const struct v2v_shifts *shifts) V2V_MUST_CHECK;
void v2v_unet_destroy(struct v2v_unet **unet);

/* What a U-Net computes of a frame. */
struct v2v_unet_size {
    int64_t height, width; /* of the frame */
    struct v2v_slab slab;  /* the rows of its full- and half-size layers */
    int has_middle;        /* 1: the layers of a quarter of the frame's sides and less, too */
    int counts_middle;     /* 1: their gradients are this U-Net's, not another rank's */
    int64_t strip_floats;  /* that strips of rows may take */
    int is_listed;         /* 1: in bf16 full-size layers compute strips and a scene's tiles, too */
    int training;          /* enum v2v_training */
};

/* Floats of workspace for that size; then plan with that much memory, borrowed, and for features of
 * the sizes of `like`, whose frame is the rows that the slab computes. Two U-Nets that don't train
 * may share one workspace: what one leaves the other overwrites. */
int64_t v2v_unet_workspace(struct v2v_unet *unet, const struct v2v_unet_size *size);
enum v2v_status v2v_unet_plan(struct v2v_unet *unet, float *workspace,
                              const struct v2v_padded *like) V2V_MUST_CHECK;
void v2v_unet_weights_changed(struct v2v_unet *unet, const struct v2v_parameters *parameters);

/* Forward in three parts, so that slabs can meet where the images are small.
 * enter: E1 (a quarter of the sides) of the rows computed; it is v2v_unet_e1 when the slab is the
 * frame, else the caller gathers that from all slabs.
 * middle: what lies below E1.
 * leave: the network's output [z,rows computed,x] from a middle's results, this U-Net's own or
 * another's with the same weights; it lives in the U-Net until the next call.
 * With a scene the full-size layers compute its tiles alone; NULL: all. */
const float *v2v_unet_enter(struct v2v_unet *unet, const struct v2v_padded *features,
                            const struct v2v_scene *scene);
float *v2v_unet_e1(struct v2v_unet *unet);
struct v2v_slabs_images v2v_unet_e1_images(const struct v2v_unet *unet);
void v2v_unet_middle(struct v2v_unet *unet);
const float *v2v_unet_leave(struct v2v_unet *unet, const struct v2v_unet *middle,
                            const struct v2v_slabs *slabs, int64_t local,
                            const struct v2v_scene *scene);

/* The same backwards; gradients of the parameters are set, those of the features added to.
 * leave: from `doutput` [z,rows computed,x], the gradient after the last activation, to that of
 * E1 and of the deeper layer joined [3n,rows,x], which the next call of the U-Net overwrites; the
 * middle takes the sum of all slabs' (v2v_unet_joined_images) in v2v_unet_gradient.
 * middle: to the gradient of E1.
 * enter: from the slab's own rows of that (v2v_unet_cut_gradient, unless the slab is the frame). */
const float *v2v_unet_leave_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                                     const float *doutput);
float *v2v_unet_gradient(struct v2v_unet *unet);
struct v2v_slabs_images v2v_unet_joined_images(const struct v2v_unet *unet);
const float *v2v_unet_middle_backward(struct v2v_unet *unet,
                                      const struct v2v_parameters *parameters);
void v2v_unet_cut_gradient(struct v2v_unet *unet, const float *de1, const struct v2v_slabs *slabs,
                           int64_t local);
void v2v_unet_enter_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features);

#endif
