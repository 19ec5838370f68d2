#include "v2v/unet_state.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/slots.h"

#include <string.h>

static enum v2v_status create_align(struct v2v_unet *unet, const struct v2v_shifts *shifts)
{
    const struct v2v_unet_spec *spec = &unet->spec;
    struct v2v_align_conv_spec align = {.views = spec->views,
                                        .view_count = spec->view_count,
                                        .features = spec->features,
                                        .out = 8 * spec->width,
                                        .slope = V2V_LEAKY,
                                        .every_slice = spec->every_slice,
                                        .method = spec->method};
    return v2v_align_conv_create(&unet->align, shifts, &align);
}

enum v2v_status v2v_unet_create(struct v2v_unet **unet, struct v2v_fields *fields,
                                const struct v2v_unet_spec *spec, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_unet *self = NULL;
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
                                            .is_last = i == FINAL4,
                                            .kernel = 3,
                                            .stride = layer_table[i].stride,
                                            .in_slope = layer_table[i].in_slope,
                                            .slope = layer_table[i].slope,
                                            .upsample = layer_table[i].up};
        V2V_TRY(v2v_layer_declare(&self->layer[i], fields, spec->prefix, layer_table[i].name));
    }
    if (shifts != NULL) {
        V2V_TRY(create_align(self, shifts));
    }
done:
    if (rc != V2V_OK) {
        v2v_unet_destroy(&self);
    }
    *unet = self;
    return rc;
}

/* Only where the parameters lie and the table of layers are taken over: nothing is planned yet. */
enum v2v_status v2v_unet_twin(struct v2v_unet **twin, const struct v2v_unet *unet,
                              const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(unet->size.height == 0);
    V2V_TRY(V2V_ALLOC(*twin, "unet", 1));
    **twin = *unet;
    (*twin)->align = NULL;
    V2V_TRY(create_align(*twin, shifts));
done:
    if (rc != V2V_OK) {
        v2v_unet_destroy(twin);
    }
    return rc;
}

/* ---- forms ---- */

/* The full-size layers whose output the next layer alone reads. */
static const int handing_on[] = {INIT2, INIT4, UP4, FINAL0, FINAL2};

/* These hand on blocked images where they can: in bf16, where there are no strips. */
static void choose_forms(struct v2v_unet *unet)
{
    const struct v2v_conv_method *method = &unet->spec.method;
    int training = unet->size.training;
    for (int i = 0; i < LAYERS; i++) {
        unet->layer[i].in_form = unet->layer[i].out_form = V2V_FORM_PLAIN;
    }
    if (v2v_unet_knows_scenes(unet)) {
        return; /* strips have forms of their own */
    }
    for (size_t i = 0; i < sizeof handing_on / sizeof *handing_on; i++) {
        struct v2v_layer *from = &unet->layer[handing_on[i]], *to = from + 1;
        if (v2v_layer_takes_blocked(from, method, training) &&
            v2v_layer_takes_blocked(to, method, training)) {
            from->out_form = to->in_form = V2V_FORM_BLOCKED;
        }
    }
    if (!training && v2v_align_conv_takes_blocked(unet->align) &&
        v2v_layer_takes_blocked(&unet->layer[INIT2], method, training)) {
        unet->layer[INIT2].in_form = V2V_FORM_BLOCKED;
    }
}

static int64_t image_floats(int form, int64_t channels, int64_t pixels)
{
    return form == V2V_FORM_BLOCKED ? v2v_blocked_floats(channels, pixels, 1) : channels * pixels;
}

/* ---- workspace ---- */

static int64_t largest(const struct v2v_unet *unet)
{
    int64_t most = channels(unet, 8) * pixels_at(unet, INIT2, 0);
    for (int i = 0; i < LAYERS; i++) {
        most = most > in_count(unet, i) ? most : in_count(unet, i);
        most = most > out_count(unet, i) ? most : out_count(unet, i);
    }
    int64_t whole = in_count(unet, DOWN2) + out_count(unet, UP2);
    return most > whole ? most : whole;
}

enum { MAX_SLOTS = 1 + LAYERS + 4 * LEVELS + 2 * STEPS + 6 };

/* Steps of the computation are the layers; the first convolution comes before them. Training keeps
 * everything. */
enum { ALIGN = -1, END = LAYERS };

static struct v2v_slot needed(const struct v2v_unet *unet, float **memory, int64_t floats,
                              int first, int last)
{
    return (struct v2v_slot){.memory = memory,
                             .floats = floats,
                             .first = unet->size.training ? ALIGN : first,
                             .last = unet->size.training ? END : last};
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
    return (unet->spec.method.winograd || unet->size.is_listed) && !unet->size.training;
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
                                   .height = v2v_slab_computed(&unet->size.slab),
                                   .width = unet->size.width,
                                   .most_floats = unet->size.strip_floats,
                                   .in_bf16 = unet->size.is_listed,
                                   .workspace = unet->spec.method.workspace,
                                   .pool = unet->spec.method.pool};
    for (int i = chain_table[chain].first; i <= chain_table[chain].last; i++) {
        spec.layer[spec.layers++] = &unet->layer[i];
    }
    return spec;
}

/* Does layer i compute here? */
static int is_planned(const struct v2v_unet *unet, int i)
{
    return unet->size.has_middle || !is_of_middle(i);
}

/* Is the output of layer i kept, not only in strips? */
static int is_kept(const struct v2v_unet *unet, int i)
{
    int chain = chain_of(unet, i);
    return is_planned(unet, i) && (chain == CHAINS || i == chain_table[chain].last);
}

/* The full-size layers. */
static int64_t list_outer_slots(struct v2v_slot *slot, struct v2v_unet *unet)
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
        int64_t aligned =
            image_floats(unet->layer[INIT2].in_form, channels(unet, 8), pixels_at(unet, INIT2, 0));
        slot[n++] = needed(unet, &unet->aligned, aligned, ALIGN, INIT2);
    }
    if (!is_whole(unet)) {
        slot[n++] = needed(unet, &unet->part, out_count(unet, DOWN1) / 4, DOWN1, DOWN1);
        slot[n++] = needed(unet, &unet->cut, in_count(unet, UP3), UP3, UP3);
    }
    return n;
}

static int64_t list_slots(struct v2v_slot *slot, struct v2v_unet *unet)
{
    int64_t n = list_outer_slots(slot, unet);
    for (int i = 0; i < LAYERS; i++) {
        int chain = chain_of(unet, i), first = chain == CHAINS ? i : chain_table[chain].first;
        if (is_kept(unet, i)) {
            int64_t floats = image_floats(unet->layer[i].out_form,
                                          channels(unet, layer_table[i].out), out_pixels(unet, i));
            slot[n++] = needed(unet, &unet->out[i], floats, first, last_reader(i));
        }
    }
    for (int k = 0; k < LEVELS; k++) {
        int down = DOWN1 + k, reader = k < LEVELS - 1 ? UP3 - k : BOTTOM;
        if (is_planned(unet, down)) {
            slot[n++] = needed(unet, &unet->entered[k], in_count(unet, down), down, down);
        }
        if (unet->size.has_middle) {
            int64_t floats = in_count(unet, k < LEVELS - 1 ? down + 1 : BOTTOM);
            slot[n++] = needed(unet, &unet->pooled[k], floats, down, reader);
        }
    }
    if (unet->size.has_middle) {
        slot[n++] = needed(unet, &unet->bottom, in_count(unet, BOTTOM), BOTTOM, BOTTOM);
    }
    for (int k = 0; k < STEPS; k++) {
        int chain = chain_of(unet, UP1 + k), last = chain == CHAINS ? UP1 + k : FINAL4;
        if (is_planned(unet, UP1 + k)) {
            slot[n++] = needed(unet, &unet->joined[k], in_count(unet, UP1 + k), UP1 + k, last);
        }
    }
    for (int k = 0; k < LEVELS && unet->size.training; k++) {
        slot[n++] = needed(unet, &unet->dskip[k], in_count(unet, DOWN1 + k), 0, 0);
    }
    for (int k = 0; k < 2 && unet->size.training; k++) {
        slot[n++] = needed(unet, &unet->gradient[k], largest(unet), 0, 0);
    }
    return n;
}

int64_t v2v_unet_workspace(struct v2v_unet *unet, const struct v2v_unet_size *size)
{
    struct v2v_slot slot[MAX_SLOTS];
    unet->size = *size;
    choose_forms(unet);
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
                              const struct v2v_padded *like)
{
    enum v2v_status rc = V2V_OK;
    int training = unet->size.training;
    struct v2v_slot slot[MAX_SLOTS];
    int64_t count = list_slots(slot, unet);
    (void)v2v_slots_pack(slot, count);
    v2v_slots_place(slot, count, workspace);
    free_which(unet);
    for (int k = 0; k < LEVELS && training; k++) {
        if (is_planned(unet, DOWN1 + k)) {
            V2V_TRY(V2V_ALLOC(unet->which[k], "unet.workspace", out_count(unet, DOWN1 + k) / 4));
        }
    }
    free_chains(unet);
    for (int chain = 0; chain < CHAINS && v2v_unet_knows_scenes(unet); chain++) {
        struct v2v_strips_spec spec = chain_spec(unet, chain);
        V2V_TRY(v2v_strips_create(&unet->chain[chain], &spec, like));
    }
    if (!v2v_unet_knows_scenes(unet)) {
        struct v2v_align_conv_plan plan = {.like = like,
                                           .out_rows = like->height,
                                           .training = training,
                                           .out_form = unet->layer[INIT2].in_form};
        V2V_TRY(v2v_align_conv_plan(unet->align, &plan));
    }
    for (int i = 0; i < LAYERS; i++) {
        int half = layer_table[i].half;
        if (is_planned(unet, i) && chain_of(unet, i) == CHAINS) {
            V2V_TRY(v2v_layer_plan(&unet->layer[i], 1, rows_at(unet, i, half),
                                   unet->size.width >> half, &unet->spec.method, training));
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
