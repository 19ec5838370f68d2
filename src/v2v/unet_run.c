/* Forward and backward of a U-Net, in the three parts of its interface. */
#include "v2v/unet_state.h"

#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/bulk.h"

static void run(struct v2v_unet *unet, int i, const float *in)
{
    v2v_watchdog_beat("a layer of the U-Net");
    v2v_conv_forward(unet->layer[i].conv, unet->out[i], in);
}

/* The layers of half the sides know a scene: what sees background alone is computed once, and what
 * no computed tile reads is not. */
static void run_half(struct v2v_unet *unet, int i, const float *in, const struct v2v_scene *scene)
{
    struct v2v_conv *conv = unet->layer[i].conv;
    v2v_watchdog_beat("a layer of the U-Net");
    if (scene == NULL) {
        run(unet, i, in);
    } else if (i == DOWN1) {
        v2v_conv_forward_tiles(conv, unet->out[i], in, &scene->half.mixed);
        v2v_scene_half_level(&scene->half, unet->out[i], unet->layer[i].out);
    } else {
        v2v_conv_forward_tiles(conv, unet->out[i], in, &scene->half.read);
    }
}

/* E0 .. E4 */
static const float *skip_at(const struct v2v_unet *unet, int level)
{
    return level == 0 ? unet->out[INIT6] : unet->pooled[level - 1];
}

static void go_down(struct v2v_unet *unet, int k, float *pooled, const struct v2v_scene *scene)
{
    int i = DOWN1 + k, half = layer_table[i].half;
    v2v_leaky_forward(unet->entered[k], skip_at(unet, k), in_count(unet, i), V2V_LEAKY);
    run_half(unet, i, unet->entered[k], scene);
    v2v_maxpool2_forward(pooled, unet->which[k], unet->out[i], channels(unet, layer_table[i].out),
                         rows_at(unet, i, half), unet->size.width >> half);
}

static void join(struct v2v_unet *unet, int k, const float *skip, const float *deeper)
{
    int64_t skipped = skip_count(unet, k), count = in_count(unet, UP1 + k);
    v2v_leaky_forward(unet->joined[k], skip, skipped, V2V_LEAKY);
    v2v_leaky_forward(unet->joined[k] + skipped, deeper, count - skipped, V2V_LEAKY);
}

/* From the features to E0, and from the last joint to the volume, a layer after the other. */
static void run_head(struct v2v_unet *unet, const struct v2v_padded *features)
{
    v2v_align_conv_forward(unet->align, unet->aligned, features, NULL);
    run(unet, INIT2, unet->aligned);
    run(unet, INIT4, unet->out[INIT2]);
    run(unet, INIT6, unet->out[INIT4]);
}

static void run_tail(struct v2v_unet *unet)
{
    run(unet, UP4, unet->joined[STEPS - 1]);
    run(unet, FINAL0, unet->out[UP4]);
    run(unet, FINAL2, unet->out[FINAL0]);
    run(unet, FINAL4, unet->out[FINAL2]);
}

static void run_chain(struct v2v_unet *unet, int chain, const struct v2v_padded *features,
                      const struct v2v_scene *scene)
{
    struct v2v_strips_data data = {.features = features,
                                   .images = unet->joined[STEPS - 1],
                                   .strips = unet->strips[chain],
                                   .out = unet->out[chain_table[chain].last]};
    v2v_strips_forward(unet->chain[chain], &data, scene);
}

const float *v2v_unet_enter(struct v2v_unet *unet, const struct v2v_padded *features,
                            const struct v2v_scene *scene)
{
    if (v2v_unet_knows_scenes(unet)) {
        run_chain(unet, HEAD, features, scene);
    } else {
        run_head(unet, features);
    }
    float *e1 = is_whole(unet) ? unet->pooled[0] : unet->part;
    go_down(unet, 0, e1, scene);
    return e1;
}

float *v2v_unet_e1(struct v2v_unet *unet)
{
    return unet->pooled[0];
}

struct v2v_slabs_images v2v_unet_e1_images(const struct v2v_unet *unet)
{
    return (struct v2v_slabs_images){.channels = channels(unet, layer_table[DOWN2].in), .half = 2};
}

struct v2v_slabs_images v2v_unet_joined_images(const struct v2v_unet *unet)
{
    return (struct v2v_slabs_images){.channels = channels(unet, layer_table[UP3].in), .half = 2};
}

void v2v_unet_middle(struct v2v_unet *unet)
{
    V2V_ASSERT(unet->size.has_middle);
    for (int k = 1; k < LEVELS; k++) {
        go_down(unet, k, unet->pooled[k], NULL);
    }
    v2v_leaky_forward(unet->bottom, unet->pooled[LEVELS - 1], in_count(unet, BOTTOM),
                      V2V_LEAKY_BOTTOM);
    run(unet, BOTTOM, unet->bottom);
    for (int i = UP1; i < UP3; i++) {
        int k = i - UP1;
        join(unet, k, skip_at(unet, 3 - k), k == 0 ? unet->out[BOTTOM] : unet->out[i - 1]);
        run(unet, i, unet->joined[k]);
    }
}

const float *v2v_unet_leave(struct v2v_unet *unet, const struct v2v_unet *middle,
                            const struct v2v_slabs *slabs, int64_t local,
                            const struct v2v_scene *scene)
{
    enum { K = UP3 - UP1 };
    const float *skip = middle->pooled[0], *deeper = middle->out[UP2];
    if (!is_whole(unet)) {
        struct v2v_slabs_images images = v2v_unet_e1_images(unet);
        v2v_slabs_cut_out(slabs, unet->cut, skip, local, &images);
        skip = unet->cut;
        images.channels = channels(unet, layer_table[UP2].out);
        v2v_slabs_cut_out(slabs, unet->cut + skip_count(unet, K), deeper, local, &images);
        deeper = unet->cut + skip_count(unet, K);
    }
    join(unet, K, skip, deeper);
    run_half(unet, UP3, unet->joined[K], scene);
    join(unet, STEPS - 1, skip_at(unet, 0), unet->out[UP3]);
    if (v2v_unet_knows_scenes(unet)) {
        run_chain(unet, TAIL, NULL, scene);
    } else {
        run_tail(unet);
    }
    return unet->out[FINAL4];
}

/* ---- backward ---- */

static void swap_gradients(struct v2v_unet *unet)
{
    float *swap = unet->gradient[0];
    unet->gradient[0] = unet->gradient[1];
    unet->gradient[1] = swap;
}

/* Every pass begins with the same one: what no layer needs of the other's memory is never touched.
 */
static void begin_gradients(struct v2v_unet *unet)
{
    if (unet->gradient[0] > unet->gradient[1]) {
        swap_gradients(unet);
    }
}

/* dout: of layer i's output before its activation, gradient[0] or a part of it; gradient[0] on
 * return: of its input, before the activation that made it. */
static void run_back(struct v2v_unet *unet, int i, const struct v2v_parameters *parameters,
                     const float *in, const float *dout)
{
    int counts = unet->size.counts_middle || !is_of_middle(i);
    v2v_watchdog_beat("the gradient of a layer of the U-Net");
    v2v_layer_backward(&unet->layer[i], counts ? parameters : NULL, unet->gradient[1], in, dout);
    v2v_parameters_ready(parameters, unet->layer[i].weight, unet->layer[i].bias);
    swap_gradients(unet);
}

/* gradient[0]: of what was joined to UP1 + k's input, before the activation. The skip's is kept,
 * the deeper layer's returned. */
static const float *part_ways(struct v2v_unet *unet, int k)
{
    int64_t skipped = in_count(unet, DOWN4 - k);
    v2v_bulk_copy(unet->dskip[3 - k], unet->gradient[0], skipped);
    return unet->gradient[0] + skipped;
}

static void go_down_back(struct v2v_unet *unet, int k, const struct v2v_parameters *parameters)
{
    int i = DOWN1 + k, half = layer_table[i].half;
    v2v_maxpool2_backward(unet->gradient[1], unet->gradient[0], unet->which[k],
                          channels(unet, layer_table[i].out), rows_at(unet, i, half),
                          unet->size.width >> half);
    swap_gradients(unet);
    run_back(unet, i, parameters, unet->entered[k], unet->gradient[0]);
    int64_t count = in_count(unet, i);
    float *gradient = unet->gradient[0];
    const float *dskip = unet->dskip[k];
#pragma omp parallel for simd schedule(static)
    for (int64_t j = 0; j < count; j++) {
        gradient[j] += dskip[j];
    }
}

const float *v2v_unet_leave_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                                     const float *doutput)
{
    enum { K = UP3 - UP1 };
    begin_gradients(unet);
    v2v_leaky_backward(unet->gradient[0], doutput, unet->out[FINAL4], out_count(unet, FINAL4),
                       V2V_LEAKY);
    run_back(unet, FINAL4, parameters, unet->out[FINAL2], unet->gradient[0]);
    run_back(unet, FINAL2, parameters, unet->out[FINAL0], unet->gradient[0]);
    run_back(unet, FINAL0, parameters, unet->out[UP4], unet->gradient[0]);
    run_back(unet, UP4, parameters, unet->joined[STEPS - 1], unet->gradient[0]);
    run_back(unet, UP3, parameters, unet->joined[K], part_ways(unet, STEPS - 1));
    return unet->gradient[0];
}

float *v2v_unet_gradient(struct v2v_unet *unet)
{
    return unet->gradient[0];
}

void v2v_unet_cut_gradient(struct v2v_unet *unet, const float *de1, const struct v2v_slabs *slabs,
                           int64_t local)
{
    struct v2v_slabs_images images = v2v_unet_e1_images(unet);
    images.is_own = 1;
    v2v_slabs_cut_out(slabs, unet->gradient[1], de1, local, &images);
    swap_gradients(unet);
}

const float *v2v_unet_middle_backward(struct v2v_unet *unet,
                                      const struct v2v_parameters *parameters)
{
    for (int i = UP3; i > UP1; i--) {
        run_back(unet, i - 1, parameters, unet->joined[i - 1 - UP1], part_ways(unet, i - UP1));
    }
    run_back(unet, BOTTOM, parameters, unet->bottom, part_ways(unet, 0));
    for (int k = LEVELS - 1; k > 0; k--) {
        go_down_back(unet, k, parameters);
    }
    return unet->gradient[0];
}

void v2v_unet_enter_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                             struct v2v_padded *dfeatures, const struct v2v_padded *features)
{
    const struct v2v_fields *fields = parameters->fields;
    go_down_back(unet, 0, parameters);
    v2v_leaky_backward(unet->gradient[0], unet->gradient[0], unet->out[INIT6],
                       out_count(unet, INIT6), V2V_LEAKY);
    run_back(unet, INIT6, parameters, unet->out[INIT4], unet->gradient[0]);
    run_back(unet, INIT4, parameters, unet->out[INIT2], unet->gradient[0]);
    run_back(unet, INIT2, parameters, unet->aligned, unet->gradient[0]);
    v2v_align_conv_backward(unet->align,
                            v2v_parameter(fields, parameters->gradients, unet->first.weight),
                            v2v_parameter(fields, parameters->gradients, unet->first.bias),
                            dfeatures, features, unet->gradient[0]);
    v2v_parameters_ready(parameters, unet->first.weight, unet->first.bias);
}
