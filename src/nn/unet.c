#include "nn/unet.h"

#include "nn/strips.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include "v2v3d/tensor/slots.h"

#include <string.h>

#define LEAKY 0.01f
#define LEAKY_BOTTOM 0.05f

enum { STEPS = 4, LEVELS = 4 };

/* The layers after the first, in the order of the computation; channels in units of the width n.
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
    float slope;
} layer_table[LAYERS] = {
    [INIT2] = {"init_conv.2", 8, 4, 1, 0, 0, LEAKY},
    [INIT4] = {"init_conv.4", 4, 2, 1, 0, 0, LEAKY},
    [INIT6] = {"init_conv.6", 2, 1, 2, 0, 0, LEAKY},
    [DOWN1] = {"encoder_1.conv.1", 1, 1, 1, 1, 0, 1.0f},
    [DOWN2] = {"encoder_2.conv.1", 1, 2, 1, 2, 0, 1.0f},
    [DOWN3] = {"encoder_3.conv.1", 2, 3, 1, 3, 0, 1.0f},
    [DOWN4] = {"encoder_4.conv.1", 3, 4, 1, 4, 0, 1.0f},
    [BOTTOM] = {"upscale_2.upscale.1", 4, 4, 1, 4, 1, 1.0f},
    [UP1] = {"decoder_1.decoder.1.upscale.1", 7, 3, 1, 3, 1, 1.0f},
    [UP2] = {"decoder_2.decoder.1.upscale.1", 5, 2, 1, 2, 1, 1.0f},
    [UP3] = {"decoder_3.decoder.1.upscale.1", 3, 1, 1, 1, 1, 1.0f},
    [UP4] = {"decoder_4.decoder.1.upscale.1", 2, 1, 1, 0, 1, 1.0f},
    [FINAL0] = {"conv_final.0", 1, 2, 1, 0, 0, LEAKY},
    [FINAL2] = {"conv_final.2", 2, 1, 1, 0, 0, LEAKY},
    [FINAL4] = {"conv_final.4", 1, -1, 1, 0, 0, LEAKY},
};

/* The computation, E0..E4 being the skips: aligned -> INIT2 -> INIT4 -> INIT6 = E0; then per level
 * entered = leaky(E), DOWN, pooled = E of the next level; bottom = leaky(E4), upsampled, BOTTOM;
 * then per step joined = leaky([E, f]), upsampled, UP = f of the next step; FINAL0 -> FINAL2 ->
 * FINAL4. */
struct v2v_unet {
    struct v2v_unet_spec spec;
    int64_t height, width;
    int training;
    int64_t strip_floats;
    struct v2v_layer first; /* sizes and parameters only: align computes it */
    struct v2v_align_conv *align;
    struct v2v_layer layer[LAYERS];
    /* Inference by minimal filtering: the full-size layers in strips, before and after the rest;
     * NULL: one by one. */
    struct v2v_strips *chain[CHAINS];
    float *strips[CHAINS];
    float *aligned;         /* [8n,y,x] */
    float *out[LAYERS];     /* of every layer */
    float *entered[LEVELS]; /* input of DOWN */
    float *pooled[LEVELS];  /* E1..E4 */
    uint8_t *which[LEVELS]; /* place of the maximum, training only */
    float *bottom;          /* [4n], 1/32 of the sides: input of BOTTOM */
    float *joined[STEPS];   /* input of UP */
    float *gradient[2];     /* of the layer at hand, training only */
    float *dskip[STEPS];    /* of E0..E3 through the skips, training only */
};

static int64_t channels(const struct v2v_unet *unet, int in_units_of_n)
{
    return in_units_of_n < 0 ? unet->spec.slices : in_units_of_n * unet->spec.width;
}

static int64_t pixels_at(const struct v2v_unet *unet, int half)
{
    return (unet->height >> half) * (unet->width >> half);
}

/* Output of layer i: channels * pixels. */
static int64_t out_count(const struct v2v_unet *unet, int i)
{
    int half = layer_table[i].half + (layer_table[i].stride == 2);
    return channels(unet, layer_table[i].out) * pixels_at(unet, half);
}

static int64_t in_count(const struct v2v_unet *unet, int i)
{
    int half = layer_table[i].half + layer_table[i].up;
    return channels(unet, layer_table[i].in) * pixels_at(unet, half);
}

enum v2v_status v2v_unet_create(struct v2v_unet **unet, struct v2v_fields *fields,
                                const struct v2v_unet_spec *spec, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_unet *self = NULL;
    struct v2v_align_conv_spec align = {.views = spec->views,
                                        .view_count = spec->view_count,
                                        .features = spec->features,
                                        .out = 8 * spec->width,
                                        .slope = LEAKY,
                                        .every_slice = spec->every_slice,
                                        .method = spec->method};
    V2V_TRY(V2V_ALLOC(self, "unet", 1));
    self->spec = *spec;
    self->first = (struct v2v_layer){.in = spec->view_count * spec->features * spec->slices,
                                     .out = 8 * spec->width,
                                     .kernel = 3,
                                     .stride = 1};
    V2V_TRY(v2v_layer_declare(&self->first, fields, spec->prefix, "init_conv.0"));
    for (int i = 0; i < LAYERS; i++) {
        self->layer[i] = (struct v2v_layer){.in = channels(self, layer_table[i].in),
                                            .out = channels(self, layer_table[i].out),
                                            .kernel = 3,
                                            .stride = layer_table[i].stride,
                                            .slope = layer_table[i].slope,
                                            .upsample = layer_table[i].up};
        V2V_TRY(v2v_layer_declare(&self->layer[i], fields, spec->prefix, layer_table[i].name));
    }
    if (shifts != NULL) {
        V2V_TRY(v2v_align_conv_create(&self->align, shifts, &align));
    }
done:
    if (rc != V2V_OK) {
        v2v_unet_destroy(&self);
    }
    *unet = self;
    return rc;
}

/* ---- workspace ---- */

static int64_t largest(const struct v2v_unet *unet)
{
    int64_t most = channels(unet, 8) * pixels_at(unet, 0);
    for (int i = 0; i < LAYERS; i++) {
        most = most > in_count(unet, i) ? most : in_count(unet, i);
        most = most > out_count(unet, i) ? most : out_count(unet, i);
    }
    return most;
}

enum { MAX_SLOTS = 1 + LAYERS + 4 * LEVELS + 2 * STEPS + 4 };

/* Steps of the computation are the layers; the first convolution comes before them. Training keeps
 * everything. */
enum { ALIGN = -1, END = LAYERS };

static struct v2v_slot needed(const struct v2v_unet *unet, float **memory, int64_t floats,
                              int first, int last)
{
    return (struct v2v_slot){.memory = memory,
                             .floats = floats,
                             .first = unet->training ? ALIGN : first,
                             .last = unet->training ? END : last};
}

/* The last layer that reads the output of layer i. */
static int last_reader(int i)
{
    if (i == INIT6) {
        return UP4;
    }
    return i >= DOWN1 && i <= DOWN4 ? i : i + 1;
}

int v2v_unet_knows_scenes(const struct v2v_unet *unet)
{
    return unet->spec.method.winograd && !unet->training;
}

/* The chain that layer i is in; CHAINS: none. */
static int chain_of(const struct v2v_unet *unet, int i)
{
    int chain = 0;
    while (chain < CHAINS && (i < chain_table[chain].first || i > chain_table[chain].last)) {
        chain++;
    }
    return v2v_unet_knows_scenes(unet) ? chain : CHAINS;
}

static struct v2v_strips_spec chain_spec(struct v2v_unet *unet, int chain)
{
    struct v2v_strips_spec spec = {.align = chain == HEAD ? unet->align : NULL,
                                   .height = unet->height,
                                   .width = unet->width,
                                   .most_floats = unet->strip_floats,
                                   .workspace = unet->spec.method.workspace};
    for (int i = chain_table[chain].first; i <= chain_table[chain].last; i++) {
        spec.layer[spec.layers++] = &unet->layer[i];
    }
    return spec;
}

/* Is the output of layer i kept as a whole? */
static int is_kept(const struct v2v_unet *unet, int i)
{
    int chain = chain_of(unet, i);
    return chain == CHAINS || i == chain_table[chain].last;
}

static int64_t list_slots(struct v2v_slot *slot, struct v2v_unet *unet)
{
    int64_t n = 0;
    if (v2v_unet_knows_scenes(unet)) {
        for (int chain = 0; chain < CHAINS; chain++) {
            struct v2v_strips_spec spec = chain_spec(unet, chain);
            slot[n++] =
                needed(unet, &unet->strips[chain], v2v_strips_floats(&spec),
                       chain == HEAD ? ALIGN : chain_table[chain].first, chain_table[chain].last);
        }
    } else {
        int64_t aligned = channels(unet, 8) * pixels_at(unet, 0);
        slot[n++] = needed(unet, &unet->aligned, aligned, ALIGN, INIT2);
    }
    for (int i = 0; i < LAYERS; i++) {
        int chain = chain_of(unet, i), first = chain == CHAINS ? i : chain_table[chain].first;
        if (is_kept(unet, i)) {
            slot[n++] = needed(unet, &unet->out[i], out_count(unet, i), first, last_reader(i));
        }
    }
    for (int k = 0; k < LEVELS; k++) {
        int down = DOWN1 + k, reader = k < LEVELS - 1 ? UP3 - k : BOTTOM;
        slot[n++] = needed(unet, &unet->entered[k], in_count(unet, down), down, down);
        slot[n++] = needed(unet, &unet->pooled[k], out_count(unet, down) / 4, down, reader);
    }
    slot[n++] = needed(unet, &unet->bottom, in_count(unet, BOTTOM), BOTTOM, BOTTOM);
    for (int k = 0; k < STEPS; k++) {
        int chain = chain_of(unet, UP1 + k), last = chain == CHAINS ? UP1 + k : FINAL4;
        slot[n++] = needed(unet, &unet->joined[k], in_count(unet, UP1 + k), UP1 + k, last);
    }
    for (int k = 0; k < LEVELS && unet->training; k++) {
        slot[n++] = needed(unet, &unet->dskip[k], in_count(unet, DOWN1 + k), 0, 0);
    }
    for (int k = 0; k < 2 && unet->training; k++) {
        slot[n++] = needed(unet, &unet->gradient[k], largest(unet), 0, 0);
    }
    return n;
}

int64_t v2v_unet_workspace(struct v2v_unet *unet, int64_t height, int64_t width,
                           int64_t strip_floats, int training)
{
    struct v2v_slot slot[MAX_SLOTS];
    unet->height = height;
    unet->width = width;
    unet->training = training;
    unet->strip_floats = strip_floats;
    return v2v_slots_pack(slot, list_slots(slot, unet));
}

static void free_which(struct v2v_unet *unet)
{
    for (int k = 0; k < LEVELS; k++) {
        v2v_mem_free(unet->which[k]);
        unet->which[k] = NULL;
    }
}

static void free_chains(struct v2v_unet *unet)
{
    for (int chain = 0; chain < CHAINS; chain++) {
        v2v_strips_destroy(&unet->chain[chain]);
    }
}

enum v2v_status v2v_unet_plan(struct v2v_unet *unet, float *workspace,
                              const struct v2v_padded *like, int training)
{
    enum v2v_status rc = V2V_OK;
    int64_t height = like->height, width = like->width;
    struct v2v_slot slot[MAX_SLOTS];
    unet->height = height;
    unet->width = width;
    unet->training = training;
    int64_t count = list_slots(slot, unet);
    (void)v2v_slots_pack(slot, count);
    v2v_slots_place(slot, count, workspace);
    free_which(unet);
    for (int k = 0; k < LEVELS && training; k++) {
        V2V_TRY(V2V_ALLOC(unet->which[k], "unet.workspace", out_count(unet, DOWN1 + k) / 4));
    }
    free_chains(unet);
    for (int chain = 0; chain < CHAINS && v2v_unet_knows_scenes(unet); chain++) {
        struct v2v_strips_spec spec = chain_spec(unet, chain);
        V2V_TRY(v2v_strips_create(&unet->chain[chain], &spec, like));
    }
    if (!v2v_unet_knows_scenes(unet)) {
        V2V_TRY(v2v_align_conv_plan(unet->align, like, height, training));
    }
    for (int i = 0; i < LAYERS; i++) {
        int half = layer_table[i].half;
        if (chain_of(unet, i) == CHAINS) {
            V2V_TRY(v2v_layer_plan(&unet->layer[i], 1, height >> half, width >> half,
                                   &unet->spec.method, training));
        }
    }
done:
    return rc;
}

void v2v_unet_destroy(struct v2v_unet **unet)
{
    if (*unet == NULL) {
        return;
    }
    for (int i = 0; i < LAYERS; i++) {
        v2v_layer_fini(&(*unet)->layer[i]);
    }
    free_chains(*unet);
    v2v_align_conv_destroy(&(*unet)->align);
    free_which(*unet);
    v2v_mem_free(*unet);
    *unet = NULL;
}

void v2v_unet_weights_changed(struct v2v_unet *unet, const struct v2v_parameters *parameters)
{
    const struct v2v_fields *fields = parameters->fields;
    v2v_align_conv_set_weights(unet->align,
                               v2v_parameter(fields, parameters->weights, unet->first.weight),
                               v2v_parameter(fields, parameters->weights, unet->first.bias));
    for (int chain = 0; chain < CHAINS; chain++) {
        if (unet->chain[chain] != NULL) {
            v2v_strips_weights_changed(unet->chain[chain], parameters);
        }
    }
    for (int i = 0; i < LAYERS; i++) {
        v2v_layer_weights_changed(&unet->layer[i], parameters);
    }
}

/* ---- forward ---- */

static void run(struct v2v_unet *unet, int i, const float *in)
{
    v2v_conv_forward(unet->layer[i].conv, unet->out[i], in);
}

/* E0 .. E4 */
static const float *skip_at(const struct v2v_unet *unet, int level)
{
    return level == 0 ? unet->out[INIT6] : unet->pooled[level - 1];
}

static void go_down(struct v2v_unet *unet, int k)
{
    int i = DOWN1 + k, half = layer_table[i].half;
    v2v_leaky_forward(unet->entered[k], skip_at(unet, k), in_count(unet, i), LEAKY);
    run(unet, i, unet->entered[k]);
    v2v_maxpool2_forward(unet->pooled[k], unet->which[k], unet->out[i],
                         channels(unet, layer_table[i].out), unet->height >> half,
                         unet->width >> half);
}

static void join(struct v2v_unet *unet, int k)
{
    int i = UP1 + k;
    const float *deeper = k == 0 ? unet->out[BOTTOM] : unet->out[i - 1];
    int64_t skip_count = in_count(unet, DOWN4 - k), count = in_count(unet, i);
    v2v_leaky_forward(unet->joined[k], skip_at(unet, 3 - k), skip_count, LEAKY);
    v2v_leaky_forward(unet->joined[k] + skip_count, deeper, count - skip_count, LEAKY);
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

const float *v2v_unet_forward(struct v2v_unet *unet, const struct v2v_padded *features,
                              const struct v2v_scene *scene)
{
    int chained = v2v_unet_knows_scenes(unet);
    if (chained) {
        run_chain(unet, HEAD, features, scene);
    } else {
        run_head(unet, features);
    }
    for (int k = 0; k < LEVELS; k++) {
        go_down(unet, k);
    }
    v2v_leaky_forward(unet->bottom, unet->pooled[LEVELS - 1], in_count(unet, BOTTOM), LEAKY_BOTTOM);
    run(unet, BOTTOM, unet->bottom);
    for (int k = 0; k < STEPS; k++) {
        join(unet, k);
        if (k < STEPS - 1) {
            run(unet, UP1 + k, unet->joined[k]);
        }
    }
    if (chained) {
        run_chain(unet, TAIL, features, scene);
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

/* gradient[0]: of layer i's output before its activation on entry, of its input on return. */
static void run_back(struct v2v_unet *unet, int i, const struct v2v_parameters *parameters,
                     const float *in)
{
    v2v_layer_backward(&unet->layer[i], parameters, unet->gradient[1], in, unet->gradient[0]);
    swap_gradients(unet);
}

/* The same for a layer whose input is another layer's activated output. */
static void run_back_through(struct v2v_unet *unet, int i, const struct v2v_parameters *parameters,
                             const float *in)
{
    run_back(unet, i, parameters, in);
    v2v_leaky_backward(unet->gradient[0], unet->gradient[0], in, in_count(unet, i), LEAKY);
}

static void go_up_back(struct v2v_unet *unet, int k, const struct v2v_parameters *parameters)
{
    int i = UP1 + k;
    int64_t skip_count = in_count(unet, DOWN4 - k), count = in_count(unet, i);
    run_back(unet, i, parameters, unet->joined[k]);
    const float *djoined = unet->gradient[0];
    v2v_leaky_backward(unet->dskip[3 - k], djoined, unet->joined[k], skip_count, LEAKY);
    v2v_leaky_backward(unet->gradient[1], djoined + skip_count, unet->joined[k] + skip_count,
                       count - skip_count, LEAKY);
    swap_gradients(unet);
}

static void go_down_back(struct v2v_unet *unet, int k, const struct v2v_parameters *parameters)
{
    int i = DOWN1 + k, half = layer_table[i].half;
    v2v_maxpool2_backward(unet->gradient[1], unet->gradient[0], unet->which[k],
                          channels(unet, layer_table[i].out), unet->height >> half,
                          unet->width >> half);
    swap_gradients(unet);
    run_back_through(unet, i, parameters, unet->entered[k]);
    int64_t count = in_count(unet, i);
    float *gradient = unet->gradient[0];
    const float *dskip = unet->dskip[k];
#pragma omp parallel for simd schedule(static)
    for (int64_t j = 0; j < count; j++) {
        gradient[j] += dskip[j];
    }
}

void v2v_unet_backward(struct v2v_unet *unet, const struct v2v_parameters *parameters,
                       struct v2v_padded *dfeatures, const struct v2v_padded *features,
                       const float *doutput)
{
    const struct v2v_fields *fields = parameters->fields;
    v2v_leaky_backward(unet->gradient[0], doutput, unet->out[FINAL4], out_count(unet, FINAL4),
                       LEAKY);
    run_back_through(unet, FINAL4, parameters, unet->out[FINAL2]);
    run_back_through(unet, FINAL2, parameters, unet->out[FINAL0]);
    run_back(unet, FINAL0, parameters, unet->out[UP4]);
    for (int k = STEPS - 1; k >= 0; k--) {
        go_up_back(unet, k, parameters);
    }
    run_back(unet, BOTTOM, parameters, unet->bottom);
    v2v_leaky_backward(unet->gradient[0], unet->gradient[0], unet->bottom, in_count(unet, BOTTOM),
                       LEAKY_BOTTOM);
    for (int k = LEVELS - 1; k >= 0; k--) {
        go_down_back(unet, k, parameters);
    }
    v2v_leaky_backward(unet->gradient[0], unet->gradient[0], unet->out[INIT6],
                       out_count(unet, INIT6), LEAKY);
    run_back_through(unet, INIT6, parameters, unet->out[INIT4]);
    run_back_through(unet, INIT4, parameters, unet->out[INIT2]);
    run_back_through(unet, INIT2, parameters, unet->aligned);
    v2v_align_conv_backward(unet->align,
                            v2v_parameter(fields, parameters->gradients, unet->first.weight),
                            v2v_parameter(fields, parameters->gradients, unet->first.bias),
                            dfeatures, features, unet->gradient[0]);
}
