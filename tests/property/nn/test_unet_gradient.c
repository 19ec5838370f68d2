/* The gradient of U-Nets by all their parameters: as they are, full of kinks; and, of those without
 * pools, with weights, biases and images above 0, when nothing is near its kink and the network is
 * smooth. */
#include "gradient.h"
#include "small_unet.h"

#include <math.h>

enum { MOST_FIELDS = 64 };

struct trial {
    const struct small_unet_size *size;
    struct small_unet net;
    double sees;
    int64_t elements;
    int kinks, is_lifted; /* bool: above 0 */
    int spoilt;           /* the field whose gradient is multiplied by .. ; 0: none */
    float factor;
};

static void forward(void *self, double *out)
{
    struct trial *t = self;
    v2v_plain_unet_weights_changed(t->net.unet, &t->net.parameters);
    v2v_plain_unet_forward(t->net.unet, t->net.out, t->net.in);
    for (int64_t i = 0; i < t->net.outs; i++) {
        out[i] = (double)t->net.out[i];
    }
}

static void backward(void *self, const double *dout)
{
    struct trial *t = self;
    v2v_plain_unet_weights_changed(t->net.unet, &t->net.parameters);
    v2v_plain_unet_forward(t->net.unet, t->net.out, t->net.in);
    for (int64_t i = 0; i < t->net.outs; i++) {
        t->net.dout[i] = (float)dout[i];
    }
    v2v_plain_unet_backward(t->net.unet, &t->net.parameters, t->net.dout);
    if (t->spoilt > 0) {
        const struct v2v_fields_item *field = &t->net.fields.item[t->spoilt];
        for (int64_t k = 0; k < field->count; k++) {
            t->net.parameters.gradients[field->offset + k] *= t->factor;
        }
    }
}

/* Rounding errors of layers add up in squares: as many terms as the sums of all layers have, and
 * as pixels for the gradients of the weights. */
static const char *fault_of(struct trial *t)
{
    struct test_argument argument[MOST_FIELDS];
    const struct v2v_fields *fields = &t->net.fields;
    int64_t arguments = 0;
    double terms = 0.0;
    assert_true(fields->count <= MOST_FIELDS);
    for (int64_t i = 1; i < fields->count; i++) { /* the first is not the network's */
        const struct v2v_fields_item *field = &fields->item[i];
        terms += (double)field->count / (double)field->shape[0];
        if (t->spoilt == 0 || t->spoilt == i) {
            argument[arguments++] =
                (struct test_argument){.name = field->name,
                                       .x = t->net.parameters.weights + field->offset,
                                       .gradient = t->net.parameters.gradients + field->offset,
                                       .count = field->count};
        }
    }
    return test_gradient_fault(&(struct test_function){
        .name = t->size->spec.is_deep ? "deep" : "flat",
        .argument = argument,
        .arguments = arguments,
        .outs = t->net.outs,
        .self = t,
        .forward = forward,
        .backward = backward,
        .step = t->is_lifted ? 0x1p-4 : 0x1p-6,
        .rounding = test_rounding(terms),
        .backward_rounding =
            test_rounding(terms + (double)(t->size->depth * t->size->height * t->size->width)),
        .elements = t->elements,
        .sees = t->sees,
        .kinks = t->kinks});
}

static void lift(float *x, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = fabsf(x[i]);
    }
}

/* Every array of weights and biases, right and wrong. */
static void check(struct trial *t, float factor)
{
    small_unet_make(&t->net, t->size, V2V_TRAINING_LEAN);
    if (t->is_lifted) {
        lift(t->net.in, t->net.ins);
        lift(t->net.parameters.weights, t->net.fields.total);
    }
    const char *wrong = fault_of(t);
    if (wrong != NULL) {
        fail_msg("%d levels: %s", t->size->spec.levels, wrong);
    }
    t->factor = factor;
    for (t->spoilt = 1; t->spoilt < t->net.fields.count; t->spoilt++) {
        if (fault_of(t) == NULL) {
            fail_msg("%d levels, %s times %g: passes", t->size->spec.levels,
                     t->net.fields.item[t->spoilt].name, (double)factor);
        }
    }
    small_unet_drop(&t->net);
}

static const struct small_unet_size sizes[] = {
    {{3, 2, 4, 1, 0, 0.0f}, 2, 9, 11, 0, 1},  {{3, 2, 4, 1, 1, 0.0f}, 3, 9, 11, 0, 1},
    {{2, 3, 4, 2, 0, 0.2f}, 3, 10, 14, 0, 1}, {{2, 3, 4, 2, 1, 0.2f}, 2, 10, 14, 0, 1},
    {{5, 4, 4, 3, 0, 0.0f}, 1, 20, 12, 0, 1}, {{1, 1, 4, 3, 1, 0.0f}, 8, 12, 8, 0, 1},
    {{1, 1, 4, 3, 1, 0.0f}, 4, 12, 8, 1, 0},  {{2, 1, 16, 2, 1, 0.0f}, 2, 16, 16, 0, 1},
};
enum { SIZES = sizeof sizes / sizeof *sizes };

static void u_nets_have_their_gradients(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct trial t = {.size = &sizes[i], .sees = 0.4, .elements = 1, .kinks = TEST_KINKS};
        check(&t, -1.0f);
    }
}

static void u_nets_without_kinks_have_them_to_two_per_cent(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        struct trial t = {.size = &sizes[i], .is_lifted = 1, .sees = 0.02, .kinks = TEST_SMOOTH};
        if (sizes[i].spec.levels == 1) {
            check(&t, 1.05f);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(u_nets_have_their_gradients),
        cmocka_unit_test(u_nets_without_kinks_have_them_to_two_per_cent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
