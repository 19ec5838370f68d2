/* The gradient of the network of slices by all its parameters: as it is, when half of what its
 * layers put out is cut off at 0 and kinks are everywhere, so that slopes are found to some per
 * cent; and with weights and features above 0, when nothing is cut off and it is smooth. */
#include "gradient.h"
#include "small_depth_net.h"
#include "small_draw.h"

#include <math.h>
#include <string.h>

enum { LAYERS = 6 };

struct trial {
    struct small_depth_net net;
    int64_t voxels;
    float *features, *volume, *dvolume;
    int is_smooth;
    int spoilt; /* layer whose gradient is multiplied by .. ; -1: none */
    float factor;
};

static void lift(float *x, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = fabsf(x[i]);
    }
}

static void setup(struct trial *t, int is_smooth, int64_t slices, int64_t height, int64_t width)
{
    *t = (struct trial){
        .voxels = slices * height * width, .is_smooth = is_smooth, .spoilt = -1, .factor = -1.0f};
    t->features = small_draw(V2V_FEATURES * t->voxels, 1, 1.0);
    t->volume = small_draw(t->voxels, 2, 1.0);
    t->dvolume = small_draw(t->voxels, 3, 1.0);
    small_depth_net_init(&t->net, slices, height, width);
    const struct v2v_fields_item *last = &t->net.network.schema.fields.item[LAYERS - 1];
    for (int64_t i = 0; i < last->count; i++) { /* it counts */
        t->net.network.weights[last->offset + i] *= 10.0f;
    }
    if (is_smooth) {
        lift(t->features, V2V_FEATURES * t->voxels);
        lift(t->net.network.weights, t->net.network.schema.fields.total);
    }
}

static void teardown(struct trial *t)
{
    v2v_mem_free(t->features);
    v2v_mem_free(t->volume);
    v2v_mem_free(t->dvolume);
    small_depth_net_fini(&t->net);
    assert_int_equal(v2v_mem_held(), 0);
}

static void run(struct trial *t)
{
    struct v2v_network *network = &t->net.network;
    network->ops->weights_changed(network);
    network->ops->forward(network, &t->volume, t->features);
}

static void forward(void *self, double *out)
{
    struct trial *t = self;
    run(t);
    for (int64_t i = 0; i < t->voxels; i++) {
        out[i] = (double)t->volume[i];
    }
}

static void backward(void *self, const double *dout)
{
    struct trial *t = self;
    struct v2v_network *network = &t->net.network;
    const float *const dvolume[] = {t->dvolume};
    run(t);
    for (int64_t i = 0; i < t->voxels; i++) {
        t->dvolume[i] = (float)dout[i];
    }
    network->ops->backward(network, dvolume);
    if (t->spoilt >= 0) {
        const struct v2v_fields_item *field = &network->schema.fields.item[t->spoilt];
        for (int64_t i = 0; i < field->count; i++) {
            network->gradients[field->offset + i] *= t->factor;
        }
    }
}

static const char *fault_of(struct trial *t)
{
    const struct v2v_network *network = &t->net.network;
    struct test_argument argument[LAYERS];
    double terms = 0.0;
    for (int i = 0; i < LAYERS; i++) {
        const struct v2v_fields_item *field = &network->schema.fields.item[i];
        argument[i] = (struct test_argument){.name = field->name,
                                             .x = network->weights + field->offset,
                                             .gradient = network->gradients + field->offset,
                                             .count = field->count};
        terms += (double)field->count / (double)field->shape[0];
    }
    return test_gradient_fault(
        &(struct test_function){.name = "depth_net",
                                .argument = argument,
                                .arguments = LAYERS,
                                .outs = t->voxels,
                                .self = t,
                                .forward = forward,
                                .backward = backward,
                                .step = 0x1p-6,
                                .rounding = test_rounding(terms),
                                .backward_rounding = test_rounding(terms + (double)t->voxels),
                                .elements = 1,
                                .sees = 0.4,
                                .kinks = TEST_KINKS});
}

static void the_network_has_its_gradient(void **state)
{
    (void)state;
    static const int64_t sizes[][3] = {{5, 8, 12}, {1, 16, 16}, {3, 48, 48}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        for (int is_smooth = 0; is_smooth < 2; is_smooth++) {
            struct trial t;
            setup(&t, is_smooth, sizes[i][0], sizes[i][1], sizes[i][2]);
            const char *wrong = fault_of(&t);
            if (wrong != NULL) {
                fail_msg("%d slices: %s", (int)sizes[i][0], wrong);
            }
            teardown(&t);
        }
    }
}

static void a_wrong_gradient_fails(void **state)
{
    (void)state;
    for (int is_smooth = 0; is_smooth < 2; is_smooth++) {
        struct trial t;
        setup(&t, is_smooth, 5, 8, 12);
        t.factor = is_smooth ? 1.03f : -1.0f;
        for (t.spoilt = 0; t.spoilt < LAYERS; t.spoilt++) {
            if (fault_of(&t) == NULL) {
                fail_msg("layer %d times %g: passes", t.spoilt, (double)t.factor);
            }
        }
        teardown(&t);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_network_has_its_gradient),
        cmocka_unit_test(a_wrong_gradient_fails),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
