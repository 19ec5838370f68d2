/* Multiply-adds and bytes of the network against the figures of REFERENCE.md 4. */
#include "support.h"

#include "network/work.h"
#include "v2v3d/base/memory.h"

enum { VIEWS = 13, SLICES = 39, BRANCH1 = 7, BRANCH2 = 6, SIDE = 64 };

static struct v2v_model_spec full_network(void)
{
    return (struct v2v_model_spec){
        .views = VIEWS, .slices = SLICES, .width = 128, .features = 4, .every_slice = 1};
}

/* Without shifts all slices of a view read the same nine pixels. */
static void take_zero_shifts(struct v2v_shifts *shifts)
{
    *shifts = (struct v2v_shifts){.views = VIEWS, .slices = SLICES};
    assert_ok(V2V_ALLOC(shifts->dy, "test", VIEWS * SLICES));
    assert_ok(V2V_ALLOC(shifts->dx, "test", VIEWS * SLICES));
}

static double macs_of(const struct v2v_model_spec *spec)
{
    struct v2v_shifts shifts;
    struct v2v_work work;
    take_zero_shifts(&shifts);
    assert_ok(v2v_work_of(&work, spec, &shifts, SIDE, SIDE));
    v2v_shifts_fini(&shifts);
    assert_int_equal(v2v_mem_held(), 0);
    return work.macs / (SIDE * SIDE);
}

/* Of both U-Nets, a frame pixel. */
static double layer_macs(const char *name)
{
    struct v2v_model_spec spec = full_network();
    const struct v2v_net_layer *layer = v2v_net_find(v2v_net_unet, name);
    return v2v_work_layer(layer, &spec, BRANCH1) + v2v_work_layer(layer, &spec, BRANCH2);
}

/* The published figures have two digits: half a unit of the last one is the tolerance. */
static void reference_takes_33_million_multiply_adds_a_pixel(void **state)
{
    struct v2v_model_spec spec = full_network();
    double macs = macs_of(&spec);
    (void)state;
    print_message("%.4g multiply-adds a pixel\n", macs);
    assert_true(macs > 32.5e6 && macs < 33.5e6);
    double first = layer_macs("init_conv.0") / macs, second = layer_macs("init_conv.2") / macs;
    assert_true(first > 0.555 && first < 0.565);
    assert_true(second > 0.275 && second < 0.285);
}

static void layers_count_what_their_definition_says(void **state)
{
    struct v2v_model_spec spec = full_network();
    (void)state;
    /* 3 x 3, 2n -> n at half the sides in y and x */
    assert_true(v2v_work_layer(v2v_net_find(v2v_net_unet, "init_conv.6"), &spec, BRANCH1) ==
                9.0 * 256 * 128 / 4);
    /* 3 x 3, 7n -> 3n on the upsampled 1/8 of the sides */
    assert_true(v2v_work_layer(v2v_net_find(v2v_net_unet, "decoder_1.decoder.1.upscale.1"), &spec,
                               BRANCH2) == 9.0 * 896 * 384 / 64);
    /* 1 x 1, 16 -> 4 at a quarter of the sides */
    assert_true(v2v_work_layer(v2v_net_find(v2v_net_encoder, "branch2.1.conv"), &spec, 0) ==
                16.0 * 4 / 16);
}

static void merging_leaves_one_product_a_tap(void **state)
{
    struct v2v_model_spec spec = full_network();
    double reference = macs_of(&spec);
    (void)state;
    spec.every_slice = 0;
    assert_true(reference - macs_of(&spec) == 9.0 * VIEWS * (SLICES - 1) * 4 * 1024);
}

static void minimal_filtering_leaves_a_quarter_of_kernels_3_of_stride_1(void **state)
{
    struct v2v_model_spec spec = full_network();
    double reference = macs_of(&spec);
    (void)state;
    spec.winograd = 1;
    /* Left as they are: init_conv.6, and a view's 1 x 1 layers: two skips, three levels, the last.
     */
    double rest = layer_macs("init_conv.6") +
                  VIEWS * (4.0 * 8 + 8 * 16 + 64.0 / 4 + 64.0 / 16 + 64.0 / 64 + 16 * 4);
    double expected = (reference - rest) / 4 + rest;
    /* Sums of some 80 terms in double precision. */
    assert_true(macs_of(&spec) / expected > 1 - 1e-12 && macs_of(&spec) / expected < 1 + 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reference_takes_33_million_multiply_adds_a_pixel),
        cmocka_unit_test(layers_count_what_their_definition_says),
        cmocka_unit_test(merging_leaves_one_product_a_tap),
        cmocka_unit_test(minimal_filtering_leaves_a_quarter_of_kernels_3_of_stride_1),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
