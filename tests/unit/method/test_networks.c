/* What every network of the registry keeps to. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/optics/psf.h"

#include <stdio.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, KERNEL = 9, SIDE = 64, PIXELS = SIDE * SIDE };
enum { OUTPUTS = V2V_NETWORK_MOST_OUTPUTS, MOST_IMAGES = 16 };
enum { FRAMES = 8, MOST_VOXELS = FRAMES * PIXELS };

static struct v2v_psf_file psf = {
    .views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
static struct v2v_config config;
static float images[MOST_IMAGES * PIXELS], volume[OUTPUTS][MOST_VOXELS],
    other[OUTPUTS][MOST_VOXELS];

static int make_optics(void **state)
{
    (void)state;
    v2v_config_defaults(&config);
    config.model.width = 4;
    config.backconv.width = 8;
    config.vcdnet.width = config.deepcad.width = 4;
    config.deepcad.frames = FRAMES;
    config.synthesis.width = 4;
    config.synthesis.planes = 3;
    int64_t count = VIEWS * SLICES * KERNEL * KERNEL;
    assert_ok(V2V_ALLOC(psf.data, "test", count));
    for (int64_t i = 0; i < count; i++) {
        psf.data[i] = (float)v2v_random_uniform(3, 1, (uint64_t)i);
    }
    v2v_psf_normalize_views(&psf);
    for (int64_t i = 0; i < MOST_IMAGES * PIXELS; i++) {
        images[i] = (float)(0.2 + 0.1 * v2v_random_normal(5, 1, (uint64_t)i));
    }
    return 0;
}

static int drop_optics(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

/* A network planned for inference, and the projector that it may borrow. */
struct planned {
    struct v2v_network *network;
    struct v2v_projector *projector;
};

static struct planned make(const char *name, unsigned outputs)
{
    struct planned made = {NULL, NULL};
    const struct v2v_network_spec spec = {
        .config = &config, .psf = &psf, .views = VIEWS, .slices = SLICES, .outputs = outputs};
    assert_ok(v2v_network_create(&made.network, name, &spec));
    struct v2v_network *network = made.network;
    assert_true(network->inputs <= MOST_IMAGES && network->slices * PIXELS <= MOST_VOXELS);
    assert_ok(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HE, 7));
    if (network->ops->traits & V2V_TRAIT_PROJECTS) {
        assert_ok(v2v_projector_create(&made.projector, &psf, SIDE, SIDE, V2V_SPLIT_SLICES, NULL));
    }
    assert_ok(network->ops->plan(
        network,
        &(struct v2v_network_plan){.height = SIDE, .width = SIDE, .projector = made.projector}));
    return made;
}

static void drop(struct planned *made)
{
    v2v_network_destroy(&made->network);
    v2v_projector_destroy(&made->projector);
}

static void run(const struct planned *made, float (*out)[MOST_VOXELS])
{
    float *volumes[OUTPUTS] = {out[0], out[1]};
    made->network->ops->forward(made->network, volumes, images);
}

static size_t bytes_of(const struct planned *made)
{
    return (size_t)made->network->slices * PIXELS * sizeof(float);
}

static void no_volume_sees_the_views_that_judge_it(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct planned made = make(v2v_network_at(i)->name, V2V_NETWORK_ALL);
        const int by_views = made.network->ops->examples == NULL;
        run(&made, volume);
        for (int o = 0; o < made.network->ops->outputs && by_views; o++) {
            const struct v2v_output *output = &made.network->output[o];
            assert_true(output->count > 0 && output->count < VIEWS);
            for (int64_t k = 0; k < output->count; k++) {
                images[output->held_out[k] * PIXELS + 7 * SIDE + 9] += 1.0f;
            }
            run(&made, other);
            assert_memory_equal(volume[o], other[o], bytes_of(&made));
            if (made.network->ops->outputs > 1) { /* .. but another volume does */
                assert_memory_not_equal(volume[1 - o], other[1 - o], bytes_of(&made));
            }
            for (int64_t k = 0; k < output->count; k++) {
                images[output->held_out[k] * PIXELS + 7 * SIDE + 9] -= 1.0f;
            }
            run(&made, volume);
        }
        drop(&made);
    }
}

static void groups_share_out_the_arena(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct planned made = make(v2v_network_at(i)->name, V2V_NETWORK_ALL);
        const struct v2v_schema *schema = &made.network->schema;
        int64_t floats = 0;
        for (int64_t g = 0; g < schema->groups; g++) {
            const struct v2v_group *group = &schema->group[g];
            floats += group->count;
            for (int64_t k = 0; k < g; k++) {
                const struct v2v_group *earlier = &schema->group[k];
                assert_true(group->first + group->count <= earlier->first ||
                            earlier->first + earlier->count <= group->first);
            }
        }
        assert_int_equal(floats, schema->fields.total);
        drop(&made);
    }
}

static void an_output_alone_has_the_bits_of_all_together(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct planned both = make(v2v_network_at(i)->name, V2V_NETWORK_ALL);
        run(&both, volume);
        for (int o = 0; o < both.network->ops->outputs; o++) {
            struct planned one = make(v2v_network_at(i)->name, 1u << o);
            assert_int_equal(one.network->schema.groups, both.network->schema.groups);
            run(&one, other);
            assert_memory_equal(volume[o], other[o], bytes_of(&one));
            drop(&one);
        }
        drop(&both);
    }
}

static void a_weight_file_says_what_its_network_is(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        struct v2v_weights_info info, again;
        struct v2v_config own = config, taken;
        v2v_config_defaults(&taken);
        snprintf(own.model.method, sizeof own.model.method, "%s", v2v_network_at(i)->name);
        own.model.volume_scale = 0.1;
        assert_ok(v2v_network_describe(&info, &own, VIEWS, SLICES, 12));
        assert_ok(v2v_network_adopt(&taken, &info, "w.h5"));
        assert_ok(v2v_network_describe(&again, &taken, VIEWS, SLICES, 12));
        assert_string_equal(info.method, again.method);
        assert_string_equal(info.settings, again.settings);
        snprintf(info.method, sizeof info.method, "v3w");
        assert_int_equal(v2v_network_adopt(&taken, &info, "w.h5"), V2V_E_INPUT);
        assert_non_null(strstr(v2v_status_message(), "w.h5: its network 'v3w'"));
    }
}

static void what_a_file_does_not_name_is_as_it_was_before_there_was_the_setting(void **state)
{
    (void)state;
    struct v2v_weights_info info = {.method = "v2v", .settings = "model.width=8\n"};
    struct v2v_config taken;
    v2v_config_defaults(&taken);
    taken.model.homogeneous = 1;
    taken.model.features = 5;
    assert_ok(v2v_network_adopt(&taken, &info, "w.h5"));
    assert_int_equal(taken.model.width, 8);
    assert_int_equal(taken.model.features, 4);
    assert_int_equal(taken.model.homogeneous, 0);
    snprintf(info.settings, sizeof info.settings, "model.homogeneous=true\n");
    assert_ok(v2v_network_adopt(&taken, &info, "w.h5"));
    assert_int_equal(taken.model.homogeneous, 1);
    info = (struct v2v_weights_info){.method = "unrolled", .settings = "deconv.lambda=0.048\n"};
    assert_ok(v2v_network_adopt(&taken, &info, "w.h5"));
    assert_true(taken.deconv.lambda.value == 0.048 && taken.deconv.curvature == 0.0);
    snprintf(info.settings, sizeof info.settings, "deconv.curvature=0.5\n");
    assert_ok(v2v_network_adopt(&taken, &info, "w.h5"));
    assert_true(taken.deconv.curvature == 0.5);
}

static void what_a_network_does_not_offer_is_refused(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        const struct v2v_network_ops *ops = v2v_network_at(i);
        struct v2v_network *network = NULL;
        struct v2v_network_spec spec = {.config = &config,
                                        .psf = &psf,
                                        .views = VIEWS,
                                        .slices = SLICES,
                                        .outputs = V2V_NETWORK_ALL,
                                        .skip = 0.1};
        if (!(ops->traits & V2V_TRAIT_SKIPS)) {
            assert_int_equal(v2v_network_create(&network, ops->name, &spec), V2V_E_CONFIG);
            assert_null(network);
        }
        spec.skip = 0.0;
        spec.views = ops->outputs - 1;
        assert_int_equal(v2v_network_create(&network, ops->name, &spec), V2V_E_INPUT);
        assert_null(network);
    }
}

/* As those are that are asked for: any network's sides are multiples of what divides 32. */
static void every_network_has_a_crop_of_its_own(void **state)
{
    (void)state;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        const int64_t crop = v2v_network_at(i)->crop;
        assert_true(crop > 0 && crop % 32 == 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_volume_sees_the_views_that_judge_it),
        cmocka_unit_test(groups_share_out_the_arena),
        cmocka_unit_test(an_output_alone_has_the_bits_of_all_together),
        cmocka_unit_test(a_weight_file_says_what_its_network_is),
        cmocka_unit_test(what_a_file_does_not_name_is_as_it_was_before_there_was_the_setting),
        cmocka_unit_test(every_network_has_a_crop_of_its_own),
        cmocka_unit_test(what_a_network_does_not_offer_is_refused),
    };
    return cmocka_run_group_tests(tests, make_optics, drop_optics);
}
