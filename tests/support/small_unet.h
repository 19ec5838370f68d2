/** A U-Net of a few channels with its parameters, planned, and what goes in and out. */
#ifndef TEST_SMALL_UNET_H
#define TEST_SMALL_UNET_H

#include "small_draw.h"

#include "v2v3d/nn/rule.h"
#include "v2v3d/nn/unet.h"

struct small_unet_size {
    struct v2v_plain_unet_spec spec;
    int64_t depth, height, width;
    int backend, winograd; /* of struct v2v_conv_method */
};

struct small_unet {
    const struct small_unet_size *size;
    int64_t ins, outs;
    struct v2v_fields fields; /* one of another layer first */
    struct v2v_parameters parameters;
    struct v2v_conv_method method;
    struct v2v_workspace workspace;
    struct v2v_plain_unet *unet;
    float *in, *out, *dout;
};

/** The last layer is as large as the others; biases vary by 0.1 about 0. */
static inline void small_unet_set_weights(struct small_unet *u)
{
    assert_ok(v2v_rule_weights(&u->fields, u->parameters.weights, V2V_RULE_HE, 7));
    for (int64_t i = 0; i < u->fields.count; i++) {
        const struct v2v_fields_item *field = &u->fields.item[i];
        for (int64_t k = 0; k < field->count; k++) {
            float *x = &u->parameters.weights[field->offset + k];
            if (field->rank == 1) {
                *x = (float)(0.1 * v2v_random_normal(4, (uint64_t)i, (uint64_t)k));
            } else if (field->starts_small) {
                *x *= 10.0f;
            }
        }
    }
    v2v_plain_unet_weights_changed(u->unet, &u->parameters);
}

/** training: enum v2v_training. */
static inline void small_unet_make(struct small_unet *u, const struct small_unet_size *size,
                                   int training)
{
    static const int64_t others[4] = {5, 1, 1, 1};
    const int64_t pixels = size->depth * size->height * size->width;
    *u = (struct small_unet){
        .size = size, .ins = size->spec.in * pixels, .outs = size->spec.out * pixels};
    u->method = (struct v2v_conv_method){
        .backend = size->backend, .winograd = size->winograd, .workspace = &u->workspace};
    assert_ok(v2v_fields_add(&u->fields, NULL, "other.weight", 4, others));
    assert_ok(v2v_plain_unet_declare(&u->fields, &size->spec, "net"));
    u->parameters.fields = &u->fields;
    u->parameters.weights = small_draw(u->fields.total, 1, 0.0);
    u->parameters.gradients = small_draw(u->fields.total, 1, 0.0);
    u->in = small_draw(u->ins, 2, 1.0);
    u->out = small_draw(u->outs, 3, 1.0);
    u->dout = small_draw(u->outs, 4, 1.0);
    assert_ok(v2v_plain_unet_create(&u->unet, &size->spec, 1));
    assert_ok(
        v2v_plain_unet_plan(u->unet, size->depth, size->height, size->width, &u->method, training));
    small_unet_set_weights(u);
}

static inline void small_unet_drop(struct small_unet *u)
{
    float *const memory[] = {u->parameters.weights, u->parameters.gradients, u->in, u->out,
                             u->dout};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_plain_unet_destroy(&u->unet);
    v2v_workspace_fini(&u->workspace);
    v2v_fields_fini(&u->fields);
    assert_int_equal(v2v_mem_held(), 0);
}

#endif
