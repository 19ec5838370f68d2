/** A U-Net (Ronneberger et al., MICCAI 2015) over images or stacks of images, for methods whose
 *  network is nothing else; those of the paper's are in the room v2v.
 *
 *  Arrays are [depth,channels,y,x]. A flat U-Net computes every image by itself; in a deep one
 *  every 3 x 3 kernel is 3 x 3 x 3, and pools and repeats halve and double the depth, too. Level l
 *  has width << l channels: two convolutions with leaky ReLU going down, maximum pool by 2; on the
 *  way up [skip, what lies below, repeated by 2], two convolutions; at the end a 1 x 1 convolution
 *  alone. Padding is with zeros on all sides.
 *
 *  Invariants: nothing is allocated in forward and backward; the same bits at any thread count. */
#ifndef V2V3D_NN_UNET_H
#define V2V3D_NN_UNET_H

#include "v2v3d/nn/layer.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_PLAIN_UNET_MOST_LEVELS = 6 };

struct v2v_plain_unet_spec {
    int64_t in, out; /**< channels */
    int64_t width;   /**< channels of the first level */
    int levels;      /**< 1 .. V2V_PLAIN_UNET_MOST_LEVELS; 1: no pool */
    int is_deep;     /**< bool */
    float slope;     /**< negative slope of the activation, above 0; 0: 0.01 */
};

struct v2v_plain_unet;

/** Sides, and of a deep one the depth, are multiples of that. @kind Local. */
int64_t v2v_plain_unet_unit(const struct v2v_plain_unet_spec *spec);

/** Append PREFIX.downL.0, PREFIX.downL.1, from the bottom up PREFIX.upL.0, PREFIX.upL.1, and
 *  PREFIX.last, a weight [out,in,k,k] and a bias [out] each. A deep kernel has three times the
 *  channels in: those of the image before, of the image itself, of the one after.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL (a name is known, too long) */
enum v2v_status v2v_plain_unet_declare(struct v2v_fields *fields,
                                       const struct v2v_plain_unet_spec *spec,
                                       const char *prefix) V2V_MUST_CHECK;

/** @param first_field place in the table of the first field that v2v_plain_unet_declare appended
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_plain_unet_create(struct v2v_plain_unet **unet,
                                      const struct v2v_plain_unet_spec *spec,
                                      int64_t first_field) V2V_MUST_CHECK;
void v2v_plain_unet_destroy(struct v2v_plain_unet **unet);

/** For [depth,in,height,width]; again with another size replaces the plan. Weights are to be given
 *  afterwards (v2v_plain_unet_weights_changed).
 *  @param method its workspace is borrowed @param training enum v2v_training
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL */
enum v2v_status v2v_plain_unet_plan(struct v2v_plain_unet *unet, int64_t depth, int64_t height,
                                    int64_t width, const struct v2v_conv_method *method,
                                    int training) V2V_MUST_CHECK;

/** What a plan takes, without the convolutions' own (packed weights, workspace); INT64_MAX: more
 *  than can be. @kind Local. */
int64_t v2v_plain_unet_bytes(const struct v2v_plain_unet_spec *spec, int64_t depth, int64_t height,
                             int64_t width, int training);

/** @kind Local. */
void v2v_plain_unet_weights_changed(struct v2v_plain_unet *unet,
                                    const struct v2v_parameters *parameters);

/** out [depth,out,y,x] from in [depth,in,y,x]. @kind Local. */
void v2v_plain_unet_forward(struct v2v_plain_unet *unet, float *out, const float *in);

/** Set the gradients of all parameters to what the last forward makes of dout [depth,out,y,x], from
 *  the last layer to the first, and tell of each that it is ready. @kind Local. */
void v2v_plain_unet_backward(struct v2v_plain_unet *unet, const struct v2v_parameters *parameters,
                             const float *dout);

#ifdef __cplusplus
}
#endif

#endif
