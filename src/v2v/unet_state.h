/* What the U-Net's files share: its layers, and what it holds of their images. */
#ifndef V2V3D_V2V_UNET_STATE_H
#define V2V3D_V2V_UNET_STATE_H

#include "v2v/strips.h"
#include "v2v/unet.h"

#define V2V_LEAKY 0.01f
#define V2V_LEAKY_BOTTOM 0.05f

enum { STEPS = 4, LEVELS = 4 };

/* The layers after the first, in the order of the computation; channels in units of the width n.
 * `in_slope`: of the activation that made the input, 0: none did.
 * `half`: how often the sides of what is convolved have been halved; `up`: the input is upsampled
 * to that, it has half the sides. An output of -1 is the slices. */
enum {
    INIT2,
    INIT4,
    INIT6,
    DOWN1,
    DOWN2,
    DOWN3,
    DOWN4,
    BOTTOM,
    UP1,
    UP2,
    UP3,
    UP4,
    FINAL0,
    FINAL2,
    FINAL4,
    LAYERS
};

/* The full-size layers, chained where they can be computed in strips. */
enum { HEAD, TAIL, CHAINS };

static const struct {
    int first, last;
} chain_table[CHAINS] = {[HEAD] = {INIT2, INIT6}, [TAIL] = {UP4, FINAL4}};

static const struct {
    const char *name;
    int in, out, stride, half, up;
    float in_slope, slope;
} layer_table[LAYERS] = {
    [INIT2] = {"init_conv.2", 8, 4, 1, 0, 0, V2V_LEAKY, V2V_LEAKY},
    [INIT4] = {"init_conv.4", 4, 2, 1, 0, 0, V2V_LEAKY, V2V_LEAKY},
    [INIT6] = {"init_conv.6", 2, 1, 2, 0, 0, V2V_LEAKY, V2V_LEAKY},
    [DOWN1] = {"encoder_1.conv.1", 1, 1, 1, 1, 0, V2V_LEAKY, 1.0f},
    [DOWN2] = {"encoder_2.conv.1", 1, 2, 1, 2, 0, V2V_LEAKY, 1.0f},
    [DOWN3] = {"encoder_3.conv.1", 2, 3, 1, 3, 0, V2V_LEAKY, 1.0f},
    [DOWN4] = {"encoder_4.conv.1", 3, 4, 1, 4, 0, V2V_LEAKY, 1.0f},
    [BOTTOM] = {"upscale_2.upscale.1", 4, 4, 1, 4, 1, V2V_LEAKY_BOTTOM, 1.0f},
    [UP1] = {"decoder_1.decoder.1.upscale.1", 7, 3, 1, 3, 1, V2V_LEAKY, 1.0f},
    [UP2] = {"decoder_2.decoder.1.upscale.1", 5, 2, 1, 2, 1, V2V_LEAKY, 1.0f},
    [UP3] = {"decoder_3.decoder.1.upscale.1", 3, 1, 1, 1, 1, V2V_LEAKY, 1.0f},
    [UP4] = {"decoder_4.decoder.1.upscale.1", 2, 1, 1, 0, 1, V2V_LEAKY, 1.0f},
    [FINAL0] = {"conv_final.0", 1, 2, 1, 0, 0, 0.0f, V2V_LEAKY},
    [FINAL2] = {"conv_final.2", 2, 1, 1, 0, 0, V2V_LEAKY, V2V_LEAKY},
    [FINAL4] = {"conv_final.4", 1, -1, 1, 0, 0, V2V_LEAKY, V2V_LEAKY},
};

/* Layers that convolve images of full or half size compute a slab of rows; what is smaller is
 * whole, and computed by the middle of one U-Net. */
enum { FIRST_WHOLE = 2 };

/* The computation, E0..E4 being the skips: aligned -> INIT2 -> INIT4 -> INIT6 = E0; then per level
 * entered = leaky(E), DOWN, pooled = E of the next level; bottom = leaky(E4), upsampled, BOTTOM;
 * then per step joined = leaky([E, f]), upsampled, UP = f of the next step; FINAL0 -> FINAL2 ->
 * FINAL4. */
struct v2v_unet {
    struct v2v_unet_spec spec;
    struct v2v_unet_size size;
    struct v2v_layer first; /* sizes and parameters only: align computes it */
    struct v2v_align_conv *align;
    struct v2v_layer layer[LAYERS];
    /* Inference by Winograd: the full-size layers in strips, before and after the rest;
     * NULL: one by one. */
    struct v2v_strips *chain[CHAINS];
    float *strips[CHAINS];
    float *aligned;         /* [8n,y,x], or blocked as INIT2 takes it */
    float *out[LAYERS];     /* of every layer, plain or blocked */
    float *entered[LEVELS]; /* input of DOWN */
    float *pooled[LEVELS];  /* E1..E4 */
    float *part;            /* E1 of a slab; the middle has that of the frame */
    float *cut;             /* [3n] the slab's rows of E1 and of UP2's output */
    uint8_t *which[LEVELS]; /* argmax, training only */
    float *bottom;          /* [4n], 1/32 of the sides: input of BOTTOM */
    float *joined[STEPS];   /* input of UP */
    float *gradient[2];     /* of the layer at hand, training only */
    float *dskip[STEPS];    /* of E0..E3 through the skips, training only */
};

static inline int64_t channels(const struct v2v_unet *unet, int in_units_of_n)
{
    return in_units_of_n < 0 ? unet->spec.slices : in_units_of_n * unet->spec.width;
}

static inline int is_whole(const struct v2v_unet *unet)
{
    return unet->size.slab.rows == unet->size.height;
}

static inline int is_of_middle(int i)
{
    return layer_table[i].half >= FIRST_WHOLE;
}

/* Rows and pixels of layer i's images when their sides have been halved `half` times. */
static inline int64_t rows_at(const struct v2v_unet *unet, int i, int half)
{
    int64_t rows = is_of_middle(i) ? unet->size.height : v2v_slab_computed(&unet->size.slab);
    return rows >> half;
}

static inline int64_t pixels_at(const struct v2v_unet *unet, int i, int half)
{
    return rows_at(unet, i, half) * (unet->size.width >> half);
}

static inline int64_t out_pixels(const struct v2v_unet *unet, int i)
{
    return pixels_at(unet, i, layer_table[i].half + (layer_table[i].stride == 2));
}

/* Output of layer i: channels * pixels. */
static inline int64_t out_count(const struct v2v_unet *unet, int i)
{
    return channels(unet, layer_table[i].out) * out_pixels(unet, i);
}

static inline int64_t in_pixels(const struct v2v_unet *unet, int i)
{
    return pixels_at(unet, i, layer_table[i].half + layer_table[i].up);
}

static inline int64_t in_count(const struct v2v_unet *unet, int i)
{
    return channels(unet, layer_table[i].in) * in_pixels(unet, i);
}

/* Of the input of UP1 + k, the part that is the skip E3 - k. */
static inline int64_t skip_count(const struct v2v_unet *unet, int k)
{
    return channels(unet, layer_table[DOWN4 - k].in) * in_pixels(unet, UP1 + k);
}

/* Can it compute a scene's tiles alone? By Winograd, or planned so in bf16, and not in training. */
int v2v_unet_knows_scenes(const struct v2v_unet *unet);

#endif
