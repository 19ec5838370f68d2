/* The two-branch network: its parameters, and what must not change its volumes. */
#include "small_model.h"

#include "v2v3d/conf/config.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/v2v/schema.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Volumes of a network by the hash rule. */
static void run(float *volume1, float *volume2, const struct v2v_model_spec *spec, int training)
{
    struct v2v_model *model = create(spec);
    fill(views, VIEWS * PIXELS, 0);
    assert_ok(v2v_model_plan(model, SIDE, SIDE, training));
    v2v_model_forward(model, volume1, volume2, views);
    v2v_model_destroy(&model);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Round-off of two ways through the layers: 18 in a chain, sums of up to 9 * 8 * width products
 * (9 * 140 in the first one), 6e-8 each. */
static double round_off(int64_t width)
{
    return 18 * 6e-8 * sqrt(9.0 * 8.0 * (double)width + 9.0 * 140.0);
}

/* ---- parameters ---- */

struct layer {
    const char *name;
    int64_t out, in, kernel;
};

static const struct layer encoder_layers[] = {
    {"conv1.0", 4, 1, 3},
    {"layer1.0.conv.0", 4, 4, 3},
    {"layer1.0.conv.2", 4, 4, 3},
    {"layer1.1.conv.0", 4, 4, 3},
    {"layer1.1.conv.2", 4, 4, 3},
    {"layer2.0.conv.0", 8, 4, 3},
    {"layer2.0.conv.2", 8, 8, 3},
    {"layer2.0.downsample.conv", 8, 4, 1},
    {"layer2.1.conv.0", 8, 8, 3},
    {"layer2.1.conv.2", 8, 8, 3},
    {"layer3.0.conv.0", 16, 8, 3},
    {"layer3.0.conv.2", 16, 16, 3},
    {"layer3.0.downsample.conv", 16, 8, 1},
    {"layer3.1.conv.0", 16, 16, 3},
    {"layer3.1.conv.2", 16, 16, 3},
    {"branch1.1.conv", 4, 16, 1},
    {"branch2.1.conv", 4, 16, 1},
    {"branch3.1.conv", 4, 16, 1},
    {"lastconv.0.conv", 16, 28, 3},
    {"lastconv.2", 4, 16, 1},
};
enum { ENCODER_LAYERS = sizeof encoder_layers / sizeof *encoder_layers };

/* At width 128 for 39 slices; the first layer's input is the branch's. */
static const struct layer unet_layers[] = {
    {"init_conv.0", 1024, 0, 3},
    {"init_conv.2", 512, 1024, 3},
    {"init_conv.4", 256, 512, 3},
    {"init_conv.6", 128, 256, 3},
    {"encoder_1.conv.1", 128, 128, 3},
    {"encoder_2.conv.1", 256, 128, 3},
    {"encoder_3.conv.1", 384, 256, 3},
    {"encoder_4.conv.1", 512, 384, 3},
    {"upscale_2.upscale.1", 512, 512, 3},
    {"decoder_1.decoder.1.upscale.1", 384, 896, 3},
    {"decoder_2.decoder.1.upscale.1", 256, 640, 3},
    {"decoder_3.decoder.1.upscale.1", 128, 384, 3},
    {"decoder_4.decoder.1.upscale.1", 128, 256, 3},
    {"conv_final.0", 256, 128, 3},
    {"conv_final.2", 128, 256, 3},
    {"conv_final.4", 39, 128, 3},
};
enum { UNET_LAYERS = sizeof unet_layers / sizeof *unet_layers };

/* Weights and biases of these layers are in the table; their number. */
static int64_t check_layers(const struct v2v_fields *fields, const char *prefix,
                            const struct layer *layers, int count, int64_t first_in)
{
    char name[V2V_FIELDS_NAME_BYTES];
    int64_t parameters = 0;
    for (int i = 0; i < count; i++) {
        const struct layer *layer = &layers[i];
        const int64_t in = layer->in > 0 ? layer->in : first_in;
        const int64_t shape[4] = {layer->out, in, layer->kernel, layer->kernel};
        snprintf(name, sizeof name, "%s.%s.weight", prefix, layer->name);
        const struct v2v_fields_item *weight = v2v_fields_find(fields, name);
        assert_non_null(weight);
        assert_int_equal(weight->rank, 4);
        assert_memory_equal(weight->shape, shape, sizeof shape);
        snprintf(name, sizeof name, "%s.%s.bias", prefix, layer->name);
        const struct v2v_fields_item *bias = v2v_fields_find(fields, name);
        assert_non_null(bias);
        assert_int_equal(bias->rank, 1);
        assert_int_equal(bias->shape[0], layer->out);
        parameters += weight->count + bias->count;
    }
    return parameters;
}

static void the_paper_network_has_the_published_parameters(void **state)
{
    (void)state;
    struct v2v_fields fields = {0};
    struct v2v_model_spec spec = {.views = 13,
                                  .slices = 39,
                                  .width = 128,
                                  .features = 4,
                                  .branches = V2V_BRANCH_BOTH,
                                  .volume_scale = 1.0};
    assert_ok(v2v_model_schema(&fields, &spec));
    assert_int_equal(fields.count, 2 * (ENCODER_LAYERS + 2 * UNET_LAYERS));
    assert_int_equal(check_layers(&fields, "feat_extract", encoder_layers, ENCODER_LAYERS, 0),
                     15312);
    /* 27.7 M and 26.2 M: 9 in out + out, summed by hand over REFERENCE.md 4 */
    assert_int_equal(check_layers(&fields, "unet1", unet_layers, UNET_LAYERS, 7 * 4 * 39),
                     27661095);
    assert_int_equal(check_layers(&fields, "unet2", unet_layers, UNET_LAYERS, 6 * 4 * 39),
                     26223399);
    v2v_fields_fini(&fields);
    spec.branches = V2V_BRANCH_2;
    assert_ok(v2v_model_schema(&fields, &spec));
    assert_int_equal(fields.count, 2 * (ENCODER_LAYERS + UNET_LAYERS));
    assert_null(v2v_fields_find(&fields, "unet1.init_conv.0.weight"));
    v2v_fields_fini(&fields);
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_network_for_another_microscope_is_refused(void **state)
{
    (void)state;
    struct v2v_model *model = NULL;
    struct v2v_model_spec spec = small;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    spec.slices++;
    assert_int_equal(v2v_model_create(&model, &spec, &shifts), V2V_E_INPUT);
    spec = small;
    shifts.views = spec.views = 1;
    assert_int_equal(v2v_model_create(&model, &spec, &shifts), V2V_E_INPUT);
    assert_null(model);
    v2v_shifts_fini(&shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

/* ---- volumes ---- */

static void one_branch_alone_gives_the_bits_of_both(void **state)
{
    (void)state;
    static float both[BRANCHES][VOXELS], alone[BRANCHES][VOXELS];
    for (int training = 0; training < 2; training++) {
        struct v2v_model_spec spec = small;
        run(both[0], both[1], &spec, training);
        spec.branches = V2V_BRANCH_1;
        run(alone[0], NULL, &spec, training);
        spec.branches = V2V_BRANCH_2;
        run(NULL, alone[1], &spec, training);
        assert_memory_equal(both, alone, sizeof both);
    }
}

static void training_and_inference_plans_agree(void **state)
{
    (void)state;
    static float trained[BRANCHES][VOXELS], inferred[BRANCHES][VOXELS];
    run(trained[0], trained[1], &small, 1);
    run(inferred[0], inferred[1], &small, 0);
    for (int b = 0; b < BRANCHES; b++) {
        assert_true(test_relative_l2(trained[b], inferred[b], VOXELS) <= round_off(WIDTH));
    }
}

/* In bf16 full-size layers hand each other blocked images in inference alone. What one of them
 * rounds as it writes, the next rounds as it reads a plain image: the same numbers are multiplied,
 * and their sums have one order. With 32 slices the last layer, too, is large enough for bf16. */
static void training_and_inference_plans_give_the_same_bits_in_bf16(void **state)
{
    (void)state;
    enum { MOST = 32 };
    static float trained[BRANCHES][MOST * PIXELS], inferred[BRANCHES][MOST * PIXELS];
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
    for (int64_t slices = SLICES; slices <= MOST; slices += MOST - SLICES) {
        for (int every_slice = 0; every_slice < 2; every_slice++) {
            struct v2v_model_spec spec = small;
            spec.slices = slices;
            spec.every_slice = every_slice;
            spec.precision = V2V_PRECISION_BF16;
            run(trained[0], trained[1], &spec, 1);
            run(inferred[0], inferred[1], &spec, 0);
            assert_true(trained[0][0] != trained[0][slices * PIXELS - 1]);
            assert_memory_equal(trained, inferred, sizeof trained);
        }
    }
}

static void widths_features_and_libraries_agree(void **state)
{
    (void)state;
    static float one[BRANCHES][VOXELS], other[BRANCHES][VOXELS];
    for (int64_t width = 16; width <= 32; width += 16) {
        for (int64_t features = 2; features <= 4; features += 2) {
            struct v2v_model_spec spec = small;
            spec.width = width;
            spec.features = features;
            run(one[0], one[1], &spec, 0);
            spec.backend = V2V_BACKEND_OPENBLAS;
            run(other[0], other[1], &spec, 0);
            for (int b = 0; b < BRANCHES; b++) {
                double error = test_relative_l2(one[b], other[b], VOXELS);
                print_message("width %lld, %lld features: %.2e\n", (long long)width,
                              (long long)features, error);
                assert_true(error <= round_off(width));
                assert_true(one[b][0] != one[b][VOXELS - 1]);
            }
        }
    }
}

static void the_scale_multiplies_the_volume(void **state)
{
    (void)state;
    static float one[BRANCHES][VOXELS], four[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    run(one[0], one[1], &spec, 0);
    spec.volume_scale = 4.0; /* exact in float32 */
    run(four[0], four[1], &spec, 0);
    for (int64_t i = 0; i < VOXELS; i++) {
        assert_true(four[0][i] == 4.0f * one[0][i] && four[1][i] == 4.0f * one[1][i]);
    }
}

/* Stripes of light over all of the frame: nothing can be left out, and nothing changes. */
static void a_frame_without_background_has_the_bits_of_no_skipping(void **state)
{
    (void)state;
    static float plain[BRANCHES][VOXELS], skipping[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    spec.winograd = 1;
    for (int tolerance = 0; tolerance < 2; tolerance++) {
        spec.skip = 0.05 * tolerance;
        struct v2v_model *model = create(&spec);
        fill(views, VIEWS * PIXELS, 0);
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            views[i] += (float)(i % SIDE / 8 % 2);
        }
        float(*volume)[VOXELS] = tolerance ? skipping : plain;
        assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
        v2v_model_forward(model, volume[0], volume[1], views);
        assert_true(v2v_model_computed_part(model) == 1.0);
        v2v_model_destroy(&model);
    }
    assert_memory_equal(plain, skipping, sizeof plain);
}

/* A square of light: most is left out, to the same volume outside for both branches alone or
 * together, and the square itself hardly changes. */
static void skipping_keeps_what_holds_light(void **state)
{
    (void)state;
    static float plain[BRANCHES][VOXELS], skipping[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    spec.winograd = 1;
    double part = 1.0, error = 0.0, size = 0.0;
    for (int tolerance = 0; tolerance < 2; tolerance++) {
        spec.skip = 0.05 * tolerance;
        struct v2v_model *model = create(&spec);
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            int64_t y = i / SIDE % SIDE, x = i % SIDE;
            views[i] = (float)(y >= 4 && y < 16 && x >= 4 && x < 16);
            views[i] += (float)(0.01 * v2v_random_normal(31, 9, (uint64_t)i));
        }
        float(*volume)[VOXELS] = tolerance ? skipping : plain;
        assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
        v2v_model_forward(model, volume[0], volume[1], views);
        part = v2v_model_computed_part(model);
        v2v_model_destroy(&model);
    }
    for (int64_t i = 0; i < VOXELS; i++) {
        int64_t y = i / SIDE % SIDE, x = i % SIDE;
        if (y >= 4 && y < 16 && x >= 4 && x < 16) {
            double d = (double)skipping[0][i] - (double)plain[0][i];
            error += d * d;
            size += (double)plain[0][i] * (double)plain[0][i];
        }
    }
    print_message("%.1f %% computed, %.1e relative difference in the light\n", 100.0 * part,
                  sqrt(error / size));
    assert_true(part >= 9.0 / 256.0 && part <= 0.5);
    /* what noise of 1 % adds to untrained deep layers that see all of the frame */
    assert_true(sqrt(error / size) <= 0.1);
}

static void replanning_for_another_size_and_back_gives_the_same_bits(void **state)
{
    (void)state;
    static float before[BRANCHES][VOXELS], after[BRANCHES][VOXELS];
    struct v2v_model *model = create(&small);
    fill(views, VIEWS * PIXELS, 0);
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, before[0], before[1], views);
    assert_ok(v2v_model_plan(model, SIDE / 2, SIDE, 1));
    v2v_model_forward(model, after[0], after[1], views);
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, after[0], after[1], views);
    assert_memory_equal(before, after, sizeof before);
    v2v_model_destroy(&model);
    assert_int_equal(v2v_mem_held(), 0);
}

/* First one branch's weights at a time, to the same bits; then smaller strips. */
static void a_memory_limit_shares_weights_then_makes_strips_smaller(void **state)
{
    (void)state;
    enum { TALL = 192, COUNT = SLICES * TALL * SIDE, LIMITS = 3 };
    static float seen[VIEWS * TALL * SIDE], volume[LIMITS][BRANCHES][COUNT];
    size_t held[LIMITS];
    struct v2v_model_spec spec = small;
    spec.winograd = 1;
    fill(seen, VIEWS * TALL * SIDE, 4);
    for (int i = 0; i < LIMITS; i++) {
        v2v_mem_set_limit(i > 0 ? held[i - 1] - 1 : 0);
        struct v2v_model *model = create(&spec);
        assert_ok(v2v_model_plan(model, TALL, SIDE, 0));
        held[i] = v2v_mem_held();
        v2v_model_forward(model, volume[i][0], volume[i][1], seen);
        v2v_model_forward(model, volume[i][0], volume[i][1], seen); /* the next frame too */
        v2v_model_destroy(&model);
    }
    assert_true(held[1] < held[0] && held[2] < held[1]);
    for (int b = 0; b < BRANCHES; b++) {
        assert_memory_equal(volume[0][b], volume[1][b], sizeof volume[0][b]);
        assert_true(test_relative_l2(volume[0][b], volume[2][b], COUNT) <= round_off(WIDTH));
    }
    struct v2v_model *model = create(&spec);
    v2v_mem_set_limit(v2v_mem_held() + 100000);
    assert_int_equal(v2v_model_plan(model, TALL, SIDE, 0), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    v2v_model_destroy(&model);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Whatever the limit, a plan that fits leaves what was asked for; and no limit above one that is
 * enough is too little. */
static void a_plan_leaves_room_for_others(void **state)
{
    (void)state;
    enum { TALL = 192, ROOM = 100000, ROOM_A_ROW = 1000, STEPS = 12 };
    const size_t room = (ROOM + TALL * ROOM_A_ROW) * sizeof(float);
    struct v2v_model_spec spec = small;
    size_t most = 0;
    int planned = 0;
    spec.winograd = 1;
    for (int i = 0; i <= STEPS; i++) {
        struct v2v_model *model = create(&spec);
        float *others = NULL;
        size_t least = v2v_mem_held() + room;
        v2v_model_leave_room(model, ROOM, ROOM_A_ROW);
        v2v_mem_set_limit(i > 0 ? most - (most - least) * (size_t)(i - 1) / STEPS : 0);
        enum v2v_status rc = v2v_model_plan(model, TALL, SIDE, 0);
        assert_true(rc == V2V_OK || rc == V2V_E_MEMORY);
        assert_true(planned == i || rc == V2V_E_MEMORY);
        if (rc == V2V_OK) {
            assert_ok(V2V_ALLOC(others, "test", ROOM + TALL * ROOM_A_ROW));
            most = i == 0 ? v2v_mem_held() : most;
            planned++;
        }
        v2v_mem_free(others);
        v2v_mem_set_limit(0);
        v2v_model_destroy(&model);
    }
    print_message("%d of %d limits are enough\n", planned, STEPS + 1);
    assert_true(planned > 3 && planned <= STEPS);
    assert_int_equal(v2v_mem_held(), 0);
}

/* The choice of a grid rests on the estimate: it has to tell a frame from half of one, and from 3/4
 * to 3/2 of the plan it is a factor of two. */
static void described_work_is_what_a_plan_takes(void **state)
{
    (void)state;
    struct v2v_model_spec spec = small;
    struct v2v_grid_work work;
    spec.width = 128;
    spec.winograd = 1;
    struct v2v_model *model = create(&spec);
    size_t before = v2v_mem_held();
    assert_ok(v2v_model_plan(model, 256, 256, 0));
    double planned = (double)(v2v_mem_held() - before);
    v2v_model_describe_work(&work, &spec, 256, 250);
    print_message("%.3g GB planned, %.3g GB described\n", 1e-9 * planned,
                  1e-9 * (double)work.bytes);
    assert_int_equal(work.height, 256);
    assert_true((double)work.bytes >= 0.75 * planned && (double)work.bytes <= 1.5 * planned);
    v2v_model_destroy(&model);
}

/* ---- weights ---- */

static void changed_weights_count(const struct v2v_model_spec *spec)
{
    static float fresh[BRANCHES][VOXELS], changed[BRANCHES][VOXELS];
    run(fresh[0], fresh[1], spec, 0);
    struct v2v_model *model = create(spec);
    int64_t floats = v2v_model_fields(model)->total;
    float *weights = v2v_model_weights(model);
    v2v_model_weights_changed(model); /* nothing is planned yet */
    for (int64_t i = 0; i < floats; i++) {
        weights[i] *= 0.5f;
    }
    assert_ok(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, changed[0], changed[1], views);
    assert_true(changed[0][0] != fresh[0][0] && changed[1][0] != fresh[1][0]);
    for (int64_t i = 0; i < floats; i++) {
        weights[i] *= 2.0f;
    }
    v2v_model_weights_changed(model);
    v2v_model_forward(model, changed[0], changed[1], views);
    assert_memory_equal(changed, fresh, sizeof fresh);
    v2v_model_destroy(&model);
}

static void changed_weights_count_once_they_are_announced(void **state)
{
    (void)state;
    struct v2v_model_spec spec = small;
    changed_weights_count(&spec);
    spec.winograd = 1;
    changed_weights_count(&spec);
}

/* The encoder's gradient of both branches is the sum of the branches' own; a U-Net's is its own. */
static void gradients_of_the_branches_add_up(void **state)
{
    (void)state;
    static float volume[BRANCHES][VOXELS], dvolume[BRANCHES][VOXELS];
    struct v2v_model_spec spec = small;
    struct v2v_model *both = create(&spec), *one[BRANCHES];
    const struct v2v_fields *fields = v2v_model_fields(both);
    fill(views, VIEWS * PIXELS, 0);
    fill(dvolume[0], VOXELS, 1);
    fill(dvolume[1], VOXELS, 2);
    assert_ok(v2v_model_plan(both, SIDE, SIDE, 1));
    v2v_model_forward(both, volume[0], volume[1], views);
    v2v_model_backward(both, dvolume[0], dvolume[1]);
    for (int b = 0; b < BRANCHES; b++) {
        spec.branches = 1u << b;
        one[b] = create(&spec);
        assert_ok(v2v_model_plan(one[b], SIDE, SIDE, 1));
        v2v_model_forward(one[b], volume[0], volume[1], views);
        v2v_model_backward(one[b], dvolume[0], dvolume[1]);
    }
    int64_t shared = v2v_fields_find(fields, "unet1.init_conv.0.weight")->offset;
    float *sum = v2v_model_gradients(one[0]);
    const float *second = v2v_model_gradients(one[1]);
    const float *gradients = v2v_model_gradients(both);
    int64_t first_unet = v2v_model_fields(one[0])->total - shared;
    assert_memory_equal(gradients + shared, sum + shared, (size_t)first_unet * sizeof *sum);
    assert_memory_equal(gradients + shared + first_unet, second + shared,
                        (size_t)(fields->total - shared - first_unet) * sizeof *sum);
    for (int64_t i = 0; i < shared; i++) {
        sum[i] += second[i];
    }
    /* sums over the 5 * 64 * 64 pixels of all views in another order, through up to 18 layers */
    assert_true(test_relative_l2(gradients, sum, shared) <= 18 * 6e-8 * sqrt(5.0 * PIXELS));
    v2v_model_destroy(&both);
    v2v_model_destroy(&one[0]);
    v2v_model_destroy(&one[1]);
    assert_int_equal(v2v_mem_held(), 0);
}

/* The example of model.h at a smaller size. */
static enum v2v_status header_example(float *volume1, float *volume2, const float *seen)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    struct v2v_model_spec spec = {.views = VIEWS,
                                  .slices = SLICES,
                                  .width = 8,
                                  .features = 4,
                                  .branches = V2V_BRANCH_BOTH,
                                  .volume_scale = 1.0};
    V2V_TRY(v2v_model_create(&model, &spec, &shifts));
    V2V_TRY(v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    V2V_TRY(v2v_model_plan(model, SIDE, SIDE, 0));
    v2v_model_forward(model, volume1, volume2, seen);
done:
    v2v_model_destroy(&model);
    v2v_shifts_fini(&shifts);
    return rc;
}

static void header_example_gives_two_volumes(void **state)
{
    (void)state;
    static float volume[BRANCHES][VOXELS];
    fill(views, VIEWS * PIXELS, 0);
    assert_ok(header_example(volume[0], volume[1], views));
    assert_true(volume[0][VOXELS / 2] != 0.0f && volume[1][VOXELS / 2] != 0.0f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_paper_network_has_the_published_parameters),
        cmocka_unit_test(a_network_for_another_microscope_is_refused),
        cmocka_unit_test(one_branch_alone_gives_the_bits_of_both),
        cmocka_unit_test(training_and_inference_plans_agree),
        cmocka_unit_test(training_and_inference_plans_give_the_same_bits_in_bf16),
        cmocka_unit_test(widths_features_and_libraries_agree),
        cmocka_unit_test(the_scale_multiplies_the_volume),
        cmocka_unit_test(a_frame_without_background_has_the_bits_of_no_skipping),
        cmocka_unit_test(skipping_keeps_what_holds_light),
        cmocka_unit_test(a_memory_limit_shares_weights_then_makes_strips_smaller),
        cmocka_unit_test(a_plan_leaves_room_for_others),
        cmocka_unit_test(described_work_is_what_a_plan_takes),
        cmocka_unit_test(replanning_for_another_size_and_back_gives_the_same_bits),
        cmocka_unit_test(changed_weights_count_once_they_are_announced),
        cmocka_unit_test(gradients_of_the_branches_add_up),
        cmocka_unit_test(header_example_gives_two_volumes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
