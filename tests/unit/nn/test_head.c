/* The first three layers in strips of rows against the same layers one by one. */
#include "nn/head.h"
#include "small_shifts.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>

enum { VIEWS = 2, SLICES = 4, FEATURES = 3, WIDE = 12, NARROW = 10, OUT = 9 };
enum { HEIGHT = 96, WIDTH = 64, PIXELS = HEIGHT * WIDTH };

static const int32_t listed[VIEWS] = {0, 1};
static const int64_t channels[3] = {WIDE, NARROW, OUT};

struct chain {
    struct v2v_shifts shifts;
    struct v2v_workspace workspace;
    struct v2v_conv_method method;
    struct v2v_fields fields;
    struct v2v_parameters parameters;
    struct v2v_layer first, layer[2];
    struct v2v_align_conv *align;
    struct v2v_padded features;
    float *whole[3]; /* outputs, layer by layer */
};

static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(0.3 * v2v_random_normal(5, stream, (uint64_t)i));
    }
    return x;
}

static void declare(struct chain *c)
{
    c->first = (struct v2v_layer){.in = VIEWS * FEATURES * SLICES, .out = WIDE, .kernel = 3};
    assert_ok(v2v_layer_declare(&c->first, &c->fields, "x", "0"));
    for (int i = 0; i < 2; i++) {
        c->layer[i] = (struct v2v_layer){
            .in = channels[i], .out = channels[i + 1], .kernel = 3, .stride = 1, .slope = 0.01f};
        assert_ok(v2v_layer_declare(&c->layer[i], &c->fields, "x", i == 0 ? "1" : "2"));
    }
    c->parameters = (struct v2v_parameters){&c->fields, draw(c->fields.total, 1), NULL};
}

static void fill_features(struct chain *c)
{
    int64_t ring = v2v_shifts_reach(&c->shifts) + 1;
    assert_ok(v2v_padded_init(&c->features, VIEWS, FEATURES, HEIGHT, WIDTH, ring));
    for (int v = 0; v < VIEWS; v++) {
        float *planes = draw(FEATURES * PIXELS, 2 + (uint64_t)v);
        v2v_padded_put(&c->features, v, planes);
        v2v_mem_free(planes);
    }
}

static void set_align_weights(struct chain *c)
{
    float *weights = c->parameters.weights;
    v2v_align_conv_set_weights(c->align, v2v_parameter(&c->fields, weights, c->first.weight),
                               v2v_parameter(&c->fields, weights, c->first.bias));
}

static void setup(struct chain *c)
{
    *c = (struct chain){.shifts = small_shifts(VIEWS, SLICES)};
    c->method = (struct v2v_conv_method){.winograd = 1, .workspace = &c->workspace};
    struct v2v_align_conv_spec spec = {.views = listed,
                                       .view_count = VIEWS,
                                       .features = FEATURES,
                                       .out = WIDE,
                                       .slope = 0.01f,
                                       .method = c->method};
    declare(c);
    fill_features(c);
    assert_ok(v2v_align_conv_create(&c->align, &c->shifts, &spec));
    assert_ok(v2v_align_conv_plan(c->align, &c->features, HEIGHT, 0));
    set_align_weights(c);
    for (int i = 0; i < 3; i++) {
        c->whole[i] = draw(channels[i] * PIXELS, 9);
    }
    v2v_align_conv_forward(c->align, c->whole[0], &c->features, 0, HEIGHT);
    for (int i = 0; i < 2; i++) {
        assert_ok(v2v_layer_plan(&c->layer[i], 1, HEIGHT, WIDTH, &c->method, 0));
        v2v_layer_weights_changed(&c->layer[i], &c->parameters);
        v2v_conv_forward(c->layer[i].conv, c->whole[i + 1], c->whole[i]);
    }
}

static void teardown(struct chain *c)
{
    for (int i = 0; i < 3; i++) {
        v2v_mem_free(c->whole[i]);
    }
    v2v_layer_fini(&c->layer[0]);
    v2v_layer_fini(&c->layer[1]);
    v2v_align_conv_destroy(&c->align);
    v2v_padded_fini(&c->features);
    v2v_mem_free(c->parameters.weights);
    v2v_fields_fini(&c->fields);
    v2v_workspace_fini(&c->workspace);
    v2v_shifts_fini(&c->shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Minimal filtering gives the same bits in any strip; the border ring's matrix products have other
 * shapes there, so that their sums of 216 terms of size 0.1 may round otherwise. */
static void check_strips(int64_t most_floats)
{
    struct chain c;
    struct v2v_head *head = NULL;
    double worst = 0.0;
    setup(&c);
    struct v2v_head_spec spec = {&c.layer[0], &c.layer[1], HEIGHT, WIDTH, most_floats};
    float *strips = draw(v2v_head_floats(&spec), 7), *out = draw(OUT * PIXELS, 8);
    assert_ok(v2v_head_create(&head, &spec, c.align, &c.features, &c.workspace));
    set_align_weights(&c);
    v2v_head_weights_changed(head, &c.parameters);
    v2v_head_forward(head, out, strips, &c.features);
    for (int64_t i = 0; i < OUT * PIXELS; i++) {
        worst = fmax(worst, fabs((double)out[i] - (double)c.whole[2][i]));
    }
    print_message("%.2f MB of strips: largest difference %.1e\n",
                  4e-6 * (double)v2v_head_floats(&spec), worst);
    assert_true(worst <= 216.0 * 0x1p-24 * 10.0);
    v2v_head_destroy(&head);
    v2v_mem_free(strips);
    v2v_mem_free(out);
    teardown(&c);
}

static void strips_give_what_whole_layers_give(void **state)
{
    (void)state;
    check_strips(1);                                     /* the least rows */
    check_strips((int64_t)(WIDE + NARROW) * WIDTH * 60); /* rows that do not divide the frame */
    check_strips(V2V_HEAD_FLOATS);                       /* one strip */
}

static void strips_take_little_more_than_they_may(void **state)
{
    (void)state;
    struct v2v_layer first = {.in = 1024, .out = 512}, second = {.in = 512, .out = 256};
    for (int64_t side = 256; side <= 4096; side *= 2) {
        struct v2v_head_spec spec = {&first, &second, side, side, V2V_HEAD_FLOATS};
        /* rows are rounded up to a tile's, and 16 are the least */
        int64_t least = (32 * 1024 + 24 * 512) * side, rounded = 1536 * 4 * side;
        int64_t most = V2V_HEAD_FLOATS + rounded > least ? V2V_HEAD_FLOATS + rounded : least;
        assert_true(v2v_head_floats(&spec) <= most);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strips_give_what_whole_layers_give),
        cmocka_unit_test(strips_take_little_more_than_they_may),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
