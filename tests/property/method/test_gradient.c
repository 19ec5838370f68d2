/* The gradient of every network of the registry by all its parameters, whatever way its layers are
 * computed. Networks are full of kinks: several in a hundred of their activations change sign
 * within a step that float32 resolves. What that leaves, the tester reads off the bend: slopes are
 * found to some per cent, of every array of parameters and the element of each that matters most.
 */
#include "gradient.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/optics/psf.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, KERNEL = 9, WIDTH = 32, HEIGHT = 64 };
enum { OUTPUTS = V2V_NETWORK_MOST_OUTPUTS, MOST_FIELDS = 128 };

/* How a network is made. The first is tried array by array, the others group by group. */
struct way {
    const char *name, *settings[2];
    unsigned outputs;
    int64_t height, slabs;
    int threads;
};
static const struct way ways[] = {
    {"as chosen", {NULL}, V2V_NETWORK_ALL, 32, 0, 1},
    {"every slice", {"model.merge=false"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"no Winograd", {"model.winograd=false"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"OpenBLAS", {"model.backend=openblas", "model.winograd=false"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"the first output", {NULL}, 1, 32, 0, 1},
    {"the last output", {NULL}, 2, 32, 0, 2},
    {"random halves", {"model.view_split=random"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"all views", {"model.view_split=all"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"unaligned", {"model.align=false"}, V2V_NETWORK_ALL, 32, 0, 1},
    {"two slabs", {NULL}, V2V_NETWORK_ALL, 64, 2, 1}};

/* What kinks a network is tried with. Biases lifted by 4, several deviations of the sums that they
 * are added to, make every activation positive: but for maximum pools the network then is smooth,
 * its Taylor remainder of second order, and slopes are seen to two per cent. */
struct smoothness {
    double lift, sees;
    int64_t elements;
    int kinks;
};
static const struct smoothness as_it_is = {0.0, 0.4, 1, TEST_KINKS};
static const struct smoothness lifted = {4.0, 0.02, 0, TEST_SMOOTH};

struct trial {
    const struct smoothness *smoothness;
    struct v2v_config config;
    struct v2v_psf_file psf;
    struct v2v_network *network;
    struct v2v_projector *projector;
    int64_t voxels; /* of an output */
    float *images, *volume[OUTPUTS], *dvolume[OUTPUTS];
    int64_t first, count; /* gradients that backward multiplies by .. */
    float factor;
};

static float *draw(int64_t count, uint64_t stream, double mean, double deviation)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(mean + deviation * v2v_random_normal(3, stream, (uint64_t)i));
    }
    return x;
}

/* Weights by He's rule, biases as large as what they are added to varies. */
static void set_weights(struct v2v_network *network, double lift)
{
    const struct v2v_fields *fields = &network->schema.fields;
    assert_ok(v2v_rule_weights(fields, network->weights, V2V_RULE_HE, 7));
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        for (int64_t k = 0; k < field->count && field->rank == 1; k++) {
            network->weights[field->offset + k] =
                (float)(lift + 0.1 * v2v_random_normal(4, (uint64_t)i, (uint64_t)k));
        }
    }
}

/* 0 when the network does not offer that; what has no biases to lift is tried by itself
 * (test_depth_net_gradient). */
static int setup(struct trial *t, const struct v2v_network_ops *ops, const struct way *way,
                 const struct smoothness *smoothness)
{
    *t = (struct trial){
        .smoothness = smoothness,
        .psf = {.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL}};
    const unsigned all = (1u << ops->outputs) - 1;
    if ((way->slabs > 1 && (ops->traits & V2V_TRAIT_SLABS) == 0) || (way->outputs & all) == 0 ||
        (ops->traits & V2V_TRAIT_CORRECTS) != 0) {
        return 0;
    }
    v2v_config_defaults(&t->config);
    t->config.model.width = 4;
    t->config.backconv.width = 8;
    t->config.vcdnet.width = t->config.deepcad.width = 4;
    t->config.vcdnet.levels = t->config.deepcad.levels = 2;
    t->config.deepcad.frames = 4;
    t->config.synthesis.width = 4;
    t->config.synthesis.levels = 2;
    t->config.synthesis.planes = 3;
    for (int i = 0; i < 2 && way->settings[i] != NULL; i++) {
        assert_ok(v2v_config_set(&t->config, way->settings[i]));
    }
    t->psf.data = draw(VIEWS * SLICES * KERNEL * KERNEL, 1, 1.0, 0.3);
    v2v_psf_normalize_views(&t->psf);
    const struct v2v_network_spec spec = {.config = &t->config,
                                          .psf = &t->psf,
                                          .views = VIEWS,
                                          .slices = SLICES,
                                          .outputs = way->outputs,
                                          .slabs = way->slabs};
    assert_ok(v2v_network_create(&t->network, ops->name, &spec));
    set_weights(t->network, smoothness->lift);
    t->voxels = t->network->slices * way->height * WIDTH;
    t->images = draw(t->network->inputs * way->height * WIDTH, 2, 1.0, 0.3);
    if (ops->traits & V2V_TRAIT_PROJECTS) {
        assert_ok(v2v_projector_create(&t->projector, &t->psf, way->height, WIDTH, V2V_SPLIT_SLICES,
                                       NULL));
    }
    assert_ok(ops->plan(t->network, &(struct v2v_network_plan){.height = way->height,
                                                               .width = WIDTH,
                                                               .training = 1,
                                                               .projector = t->projector}));
    for (int o = 0; o < OUTPUTS; o++) {
        t->volume[o] = draw(t->voxels, 3, 0.0, 1.0);
        t->dvolume[o] = draw(t->voxels, 3, 0.0, 1.0);
    }
    return 1;
}

static void teardown(struct trial *t)
{
    v2v_network_destroy(&t->network);
    v2v_projector_destroy(&t->projector);
    v2v_psf_file_fini(&t->psf);
    v2v_mem_free(t->images);
    for (int o = 0; o < OUTPUTS; o++) {
        v2v_mem_free(t->volume[o]);
        v2v_mem_free(t->dvolume[o]);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void run(struct trial *t)
{
    t->network->ops->weights_changed(t->network);
    t->network->ops->forward(t->network, t->volume, t->images);
}

static void forward(void *self, double *out)
{
    struct trial *t = self;
    run(t);
    for (int o = 0; o < OUTPUTS; o++) {
        for (int64_t i = 0; i < t->voxels && v2v_network_holds(t->network, o); i++) {
            *out++ = (double)t->volume[o][i];
        }
    }
}

static void backward(void *self, const double *dout)
{
    struct trial *t = self;
    const float *const dvolume[OUTPUTS] = {t->dvolume[0], t->dvolume[1]};
    run(t);
    for (int o = 0; o < OUTPUTS; o++) {
        for (int64_t i = 0; i < t->voxels && v2v_network_holds(t->network, o); i++) {
            t->dvolume[o][i] = (float)*dout++;
        }
    }
    t->network->ops->backward(t->network, dvolume);
    for (int64_t i = t->first; i < t->first + t->count; i++) {
        t->network->gradients[i] *= t->factor;
    }
}

static struct test_argument argument_of(const struct trial *t, const char *name, int64_t first,
                                        int64_t count)
{
    return (struct test_argument){.name = name,
                                  .x = t->network->weights + first,
                                  .gradient = t->network->gradients + first,
                                  .count = count};
}

/* Every array of parameters, or the groups of them. Returns their number. */
static int64_t list(struct test_argument *argument, const struct trial *t, int by_groups)
{
    const struct v2v_schema *schema = &t->network->schema;
    int64_t count = 0;
    assert_true(schema->fields.count <= MOST_FIELDS);
    for (int64_t i = 0; i < schema->fields.count && !by_groups; i++) {
        const struct v2v_fields_item *field = &schema->fields.item[i];
        argument[count++] = argument_of(t, field->name, field->offset, field->count);
    }
    for (int64_t g = 0; g < schema->groups && by_groups; g++) {
        const struct v2v_group *group = &schema->group[g];
        if (group->count > 0) {
            argument[count++] = argument_of(t, group->name, group->first, group->count);
        }
    }
    return count;
}

/* Rounding errors of layers add up in squares: as many terms as the sums of all layers have, and
 * as pixels for the gradients of the weights. */
static const char *fault_of(struct trial *t, const struct test_argument *argument,
                            int64_t arguments)
{
    const struct v2v_fields *fields = &t->network->schema.fields;
    double terms = 0.0;
    int outputs = v2v_network_holds(t->network, 0) + v2v_network_holds(t->network, 1);
    for (int64_t i = 0; i < fields->count; i++) {
        terms += (double)fields->item[i].count / (double)fields->item[i].shape[0];
    }
    return test_gradient_fault(&(struct test_function){
        .name = t->network->ops->name,
        .argument = argument,
        .arguments = arguments,
        .outs = outputs * t->voxels,
        .self = t,
        .forward = forward,
        .backward = backward,
        .step = 0x1p-6,
        .rounding = test_rounding(terms),
        .backward_rounding = test_rounding(terms + (double)(t->voxels / t->network->slices)),
        .elements = t->smoothness->elements,
        .sees = t->smoothness->sees,
        .kinks = t->smoothness->kinks});
}

static void every_network_has_its_gradient(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
            struct trial t;
            v2v_op_set_threads(ways[w].threads);
            if (setup(&t, v2v_network_at(i), &ways[w], &as_it_is)) {
                struct test_argument argument[MOST_FIELDS];
                const char *wrong = fault_of(&t, argument, list(argument, &t, w > 0));
                if (wrong != NULL) {
                    fail_msg("%s: %s", ways[w].name, wrong);
                }
                teardown(&t);
            }
        }
    }
    v2v_op_set_threads(1);
}

static void check_mutants(struct trial *t, int by_groups, float factor)
{
    struct test_argument argument[MOST_FIELDS];
    int64_t count = list(argument, t, by_groups);
    for (int64_t i = 0; i < count; i++) {
        t->first = argument[i].x - t->network->weights;
        t->count = argument[i].count;
        t->factor = i % 3 == 1 ? 2.0f : factor;
        if (fault_of(t, &argument[i], 1) == NULL) {
            fail_msg("%s, %s times %g: passes", t->network->ops->name, argument[i].name,
                     (double)t->factor);
        }
    }
}

/* Groups left out, arrays turned about, every third of either twice as large. */
static void a_wrong_gradient_of_any_network_fails(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct trial t;
        if (setup(&t, v2v_network_at(i), &ways[0], &as_it_is)) {
            check_mutants(&t, 1, 0.0f);
            check_mutants(&t, 0, -1.0f);
            teardown(&t);
        }
    }
}

/* The paper's network has maximum pools. */
static void the_remainder_of_a_smooth_network_is_of_second_order(void **state)
{
    (void)state;
    struct trial t;
    struct test_argument argument[MOST_FIELDS];
    const struct v2v_network_ops *ops = NULL;
    assert_ok(v2v_network_find(&ops, "backconv"));
    assert_true(setup(&t, ops, &ways[0], &lifted));
    int64_t count = list(argument, &t, 0);
    const char *wrong = fault_of(&t, argument, count);
    if (wrong != NULL) {
        fail_msg("%s", wrong);
    }
    for (int64_t i = 0; i < count; i++) {
        t.first = argument[i].x - t.network->weights;
        t.count = argument[i].count;
        t.factor = 1.05f;
        if (fault_of(&t, &argument[i], 1) == NULL) {
            fail_msg("%s times 1.05: passes", argument[i].name);
        }
    }
    teardown(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_network_has_its_gradient),
        cmocka_unit_test(a_wrong_gradient_of_any_network_fails),
        cmocka_unit_test(the_remainder_of_a_smooth_network_is_of_second_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
