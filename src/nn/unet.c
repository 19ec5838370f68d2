#include "nn/unet_state.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/tensor/slots.h"

static const float default_slope = 0.01f;

int64_t v2v_plain_unet_unit(const struct v2v_plain_unet_spec *spec)
{
    return (int64_t)1 << (spec->levels - 1);
}

static int64_t level_channels(const struct v2v_plain_unet_spec *spec, int level)
{
    return spec->width << level;
}

/* ---- layers ---- */

/* Where the layers of a level begin, in the order of the computation. */
static int first_down(int level)
{
    return 2 * level;
}

static int first_up(int levels, int level)
{
    return 2 * levels + 2 * (levels - 2 - level);
}

/* Two convolutions, from `kind` on, of a level. */
static void add_pair(struct v2v_plain_unet *unet, int level, int kind, int64_t in)
{
    const struct v2v_plain_unet_spec *spec = &unet->spec;
    const int is_bottom = level == spec->levels - 1;
    const int64_t out = level_channels(spec, level);
    const int stacks[3] = {kind, kind + 1, is_bottom ? LEAVES : kind + 2};
    for (int k = 0; k < 2; k++) {
        const int i = unet->layers++;
        unet->wire[i] = (struct v2v_wire){.from = v2v_unet_stack(level, stacks[k]),
                                          .to = v2v_unet_stack(level, stacks[k + 1])};
        unet->layer[i] = (struct v2v_layer){.in = (spec->is_deep ? 3 : 1) * (k == 0 ? in : out),
                                            .out = out,
                                            .kernel = 3,
                                            .stride = 1,
                                            .in_slope = i > 0 ? spec->slope : 0.0f,
                                            .slope = spec->slope};
    }
}

static void list_layers(struct v2v_plain_unet *unet, const struct v2v_plain_unet_spec *spec)
{
    V2V_ASSERT(spec->levels >= 1 && spec->levels <= MOST_LEVELS && spec->slope >= 0.0f);
    *unet = (struct v2v_plain_unet){.spec = *spec};
    unet->spec.slope = spec->slope > 0.0f ? spec->slope : default_slope;
    for (int l = 0; l < spec->levels; l++) {
        add_pair(unet, l, ENTERS, l == 0 ? spec->in : level_channels(spec, l - 1));
    }
    for (int l = spec->levels - 2; l >= 0; l--) {
        add_pair(unet, l, JOINED, level_channels(spec, l) + level_channels(spec, l + 1));
    }
    unet->wire[unet->layers] = (struct v2v_wire){.from = v2v_unet_stack(0, LEAVES), .to = -1};
    unet->layer[unet->layers++] = (struct v2v_layer){.in = spec->width,
                                                     .out = spec->out,
                                                     .kernel = 1,
                                                     .stride = 1,
                                                     .in_slope = unet->spec.slope,
                                                     .slope = 1.0f,
                                                     .is_last = 1};
}

enum v2v_status v2v_plain_unet_declare(struct v2v_fields *fields,
                                       const struct v2v_plain_unet_spec *spec, const char *prefix)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_plain_unet unet;
    char name[16];
    list_layers(&unet, spec);
    for (int i = 0; i < unet.layers; i++) {
        const int level = unet.wire[i].from / KINDS, kind = unet.wire[i].from % KINDS;
        if (unet.layer[i].is_last) {
            rc = v2v_text_format(name, sizeof name, "last");
        } else {
            rc = v2v_text_format(name, sizeof name, "%s%d.%d", kind < JOINED ? "down" : "up", level,
                                 kind == BETWEEN || kind == ABOVE);
        }
        V2V_TRY(rc);
        V2V_TRY(v2v_layer_declare(&unet.layer[i], fields, prefix, name));
    }
done:
    return rc;
}

enum v2v_status v2v_plain_unet_create(struct v2v_plain_unet **unet,
                                      const struct v2v_plain_unet_spec *spec, int64_t first_field)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_plain_unet *self = NULL;
    V2V_TRY(V2V_ALLOC(self, "unet", 1));
    list_layers(self, spec);
    for (int i = 0; i < self->layers; i++) {
        self->layer[i].weight = first_field + 2 * i; /* as v2v_layer_declare adds them */
        self->layer[i].bias = first_field + 2 * i + 1;
    }
done:
    *unet = self;
    return rc;
}

static void free_plan(struct v2v_plain_unet *unet)
{
    v2v_mem_free(unet->memory);
    unet->memory = NULL;
    for (int l = 0; l < MOST_LEVELS; l++) {
        v2v_mem_free(unet->which[l]);
        unet->which[l] = NULL;
    }
}

void v2v_plain_unet_destroy(struct v2v_plain_unet **unet)
{
    if (*unet != NULL) {
        free_plan(*unet);
        for (int i = 0; i < (*unet)->layers; i++) {
            v2v_layer_fini(&(*unet)->layer[i]);
        }
        v2v_mem_free(*unet);
        *unet = NULL;
    }
}

/* ---- memory ---- */

/* Steps of the computation: the layers, and the same again backwards. */
static int backward_step(const struct v2v_plain_unet *unet, int layer)
{
    return 2 * unet->layers - 1 - layer;
}

static void size_stacks(struct v2v_plain_unet *unet, int64_t depth, int64_t height, int64_t width)
{
    const struct v2v_plain_unet_spec *spec = &unet->spec;
    for (int l = 0; l < spec->levels; l++) {
        const int64_t channels = level_channels(spec, l);
        const int64_t held[KINDS] = {[ENTERS] = l == 0 ? spec->in : channels / 2,
                                     [BETWEEN] = channels,
                                     [JOINED] = channels + 2 * channels,
                                     [ABOVE] = channels,
                                     [LEAVES] = channels};
        for (int kind = 0; kind < KINDS; kind++) {
            struct v2v_stack *stack = &unet->stack[v2v_unet_stack(l, kind)];
            *stack = (struct v2v_stack){.channels = held[kind],
                                        .depth = spec->is_deep ? depth >> l : depth,
                                        .height = height >> l,
                                        .width = width >> l,
                                        .ends = spec->is_deep && kind != LEAVES};
            unet->gradient[v2v_unet_stack(l, kind)] = *stack;
            unet->gradient[v2v_unet_stack(l, kind)].ends = 0;
        }
    }
}

static int64_t floats_of(const struct v2v_stack *stack)
{
    const int64_t images = v2v_mem_product(stack->depth + 2 * stack->ends, stack->channels, 1);
    return images < 0 ? -1 : v2v_mem_product(images, stack->height, stack->width);
}

/* The layer that makes a stack, its own or the first channels of what is joined; what enters is
 * made with the skip of the level above. */
static int maker_of(const struct v2v_plain_unet *unet, int level, int kind)
{
    const int is_bottom = level == unet->spec.levels - 1;
    switch (kind) {
    case ENTERS:
        return level == 0 ? 0 : first_down(level) - 1;
    case BETWEEN:
        return first_down(level);
    case JOINED:
        return first_down(level) + 1;
    case ABOVE:
        return first_up(unet->spec.levels, level);
    default:
        return is_bottom ? first_down(level) + 1 : first_up(unet->spec.levels, level) + 1;
    }
}

/* The layer that convolves it; what leaves a level below is repeated as soon as it is made, and its
 * gradient with that of what it was joined to. */
static int reader_of(const struct v2v_plain_unet *unet, int level, int kind)
{
    switch (kind) {
    case ENTERS:
        return first_down(level);
    case BETWEEN:
        return first_down(level) + 1;
    case JOINED:
        return first_up(unet->spec.levels, level);
    case ABOVE:
        return first_up(unet->spec.levels, level) + 1;
    default:
        return level == 0 ? unet->layers - 1 : first_up(unet->spec.levels, level - 1);
    }
}

enum { MOST_SLOTS = 2 * MOST_STACKS + 1 };

/* Stacks are kept from where they are made to where their layer's gradient is computed; gradients
 * from there to where that of their maker is. */
static int64_t list_slots(struct v2v_slot *slot, struct v2v_plain_unet *unet, int training)
{
    int64_t n = 0, scratch = 0;
    for (int l = 0; l < unet->spec.levels; l++) {
        for (int kind = 0; kind < KINDS; kind++) {
            struct v2v_stack *stack = &unet->stack[v2v_unet_stack(l, kind)];
            struct v2v_stack *gradient = &unet->gradient[v2v_unet_stack(l, kind)];
            const int made = maker_of(unet, l, kind), read = reader_of(unet, l, kind);
            const int is_passed_on = kind == LEAVES && l > 0; /* no layer convolves it */
            const int64_t three = 3 * stack->channels * v2v_stack_pixels(stack);
            if (l == unet->spec.levels - 1 && (kind == JOINED || kind == ABOVE)) {
                continue;
            }
            slot[n++] = (struct v2v_slot){.memory = &stack->data,
                                          .floats = floats_of(stack),
                                          .first = made,
                                          .last = is_passed_on ? made
                                                  : training   ? backward_step(unet, read)
                                                               : read};
            if (training && (kind != ENTERS || l > 0)) {
                const int last = kind == ENTERS ? read : made;
                slot[n++] = (struct v2v_slot){.memory = &gradient->data,
                                              .floats = floats_of(gradient),
                                              .first = backward_step(unet, read),
                                              .last = backward_step(unet, last)};
                scratch = unet->spec.is_deep && three > scratch ? three : scratch;
            }
        }
    }
    slot[n++] = (struct v2v_slot){.memory = &unet->scratch,
                                  .floats = scratch,
                                  .first = unet->layers,
                                  .last = 2 * unet->layers};
    return n;
}

/* Bytes of `which` of a level; 0: there is none. */
static int64_t which_bytes(const struct v2v_plain_unet *unet, int level, int training)
{
    return training && level < unet->spec.levels - 1
               ? floats_of(&unet->gradient[v2v_unet_stack(level + 1, ENTERS)])
               : 0;
}

int64_t v2v_plain_unet_bytes(const struct v2v_plain_unet_spec *spec, int64_t depth, int64_t height,
                             int64_t width, int training)
{
    struct v2v_plain_unet unet;
    struct v2v_slot slot[MOST_SLOTS];
    int64_t bytes = 0;
    /* the largest stack, of 3 times the channels of the first level or of the views, and all of
     * them, twenty such at most */
    const int64_t channels = 3 * spec->width > spec->in ? 3 * spec->width : spec->in;
    const int64_t largest = v2v_mem_product(channels, depth + 2, v2v_mem_product(height, width, 1));
    if (largest < 0 || v2v_mem_product(largest, 20, 3) < 0) {
        return INT64_MAX;
    }
    list_layers(&unet, spec);
    size_stacks(&unet, depth, height, width);
    for (int l = 0; l < spec->levels; l++) {
        bytes += which_bytes(&unet, l, training);
    }
    return v2v_mem_bytes(v2v_slots_pack(slot, list_slots(slot, &unet, training)), bytes);
}

enum v2v_status v2v_plain_unet_plan(struct v2v_plain_unet *unet, int64_t depth, int64_t height,
                                    int64_t width, const struct v2v_conv_method *method,
                                    int training)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_slot slot[MOST_SLOTS];
    const int64_t unit = v2v_plain_unet_unit(&unet->spec);
    /* A layer computes images one after the other: there is no "the pass before". */
    const int kept = training == V2V_TRAINING_KEEPS && depth > 1 ? V2V_TRAINING_LEAN : training;
    V2V_ASSERT(height % unit == 0 && width % unit == 0);
    V2V_ASSERT(!unet->spec.is_deep || depth % unit == 0);
    free_plan(unet);
    unet->training = training != V2V_TRAINING_OFF;
    size_stacks(unet, depth, height, width);
    const int64_t count = list_slots(slot, unet, unet->training);
    V2V_TRY(V2V_ALLOC(unet->memory, "unet.images", v2v_slots_pack(slot, count)));
    v2v_slots_place(slot, count, unet->memory);
    for (int l = 0; l < unet->spec.levels - 1 && unet->training; l++) {
        V2V_TRY(V2V_ALLOC(unet->which[l], "unet.images", which_bytes(unet, l, unet->training)));
    }
    for (int i = 0; i < unet->layers; i++) {
        const struct v2v_stack *from = &unet->stack[unet->wire[i].from];
        V2V_TRY(v2v_layer_plan(&unet->layer[i], 1, from->height, from->width, method, kept));
    }
done:
    return rc;
}

void v2v_plain_unet_weights_changed(struct v2v_plain_unet *unet,
                                    const struct v2v_parameters *parameters)
{
    for (int i = 0; i < unet->layers; i++) {
        v2v_layer_weights_changed(&unet->layer[i], parameters);
    }
}
