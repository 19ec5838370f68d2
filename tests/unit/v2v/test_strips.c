/* Chains of layers in strips of rows, and of a scene's tiles alone, against the same layers one by
 * one. */
#include "small_draw.h"
#include "small_shifts.h"
#include "support.h"
#include "v2v/strips.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/tile_conv.h"

#include <math.h>

enum { VIEWS = 2, SLICES = 4, FEATURES = 3, WIDE = 12, NARROW = 10, HALVED = 9, OUT = 7 };
enum { HEIGHT = 96, WIDTH = 64, PIXELS = HEIGHT * WIDTH };

static const int32_t listed[VIEWS] = {0, 1};
/* The alignment's output, a layer, one of stride 2; then one that upsamples, and a last one. */
enum { LAYERS = 4, DEPTH = LAYERS + 1, MIDDLE = 2 };

static const struct {
    int64_t channels, pixels;
    int stride, upsample;
} table[DEPTH] = {
    {WIDE, PIXELS, 1, 0},   {NARROW, PIXELS, 1, 0}, {HALVED, PIXELS / 4, 2, 0},
    {NARROW, PIXELS, 1, 1}, {OUT, PIXELS, 1, 0},
};

struct chain {
    struct v2v_shifts shifts;
    struct v2v_workspace workspace;
    struct v2v_conv_method method;
    struct v2v_fields fields;
    struct v2v_parameters parameters;
    struct v2v_layer first, layer[LAYERS];
    struct v2v_align_conv *align;
    struct v2v_padded features;
    float *whole[DEPTH]; /* outputs, layer by layer */
};

static void declare(struct chain *c)
{
    c->first = (struct v2v_layer){.in = VIEWS * FEATURES * SLICES, .out = WIDE, .kernel = 3};
    assert_ok(v2v_layer_declare(&c->first, &c->fields, "x", "0"));
    for (int i = 0; i < LAYERS; i++) {
        char name[2] = {(char)('1' + i), 0};
        c->layer[i] = (struct v2v_layer){.in = table[i].channels,
                                         .out = table[i + 1].channels,
                                         .kernel = 3,
                                         .stride = table[i + 1].stride,
                                         .upsample = table[i + 1].upsample,
                                         .slope = 0.01f};
        assert_ok(v2v_layer_declare(&c->layer[i], &c->fields, "x", name));
    }
    c->parameters = (struct v2v_parameters){.fields = &c->fields,
                                            .weights = small_draw(c->fields.total, 1, 0.3)};
}

static void fill_features(struct chain *c)
{
    int64_t ring = v2v_shifts_reach(&c->shifts) + 1;
    assert_ok(v2v_padded_init(&c->features, VIEWS, FEATURES, HEIGHT, WIDTH, ring));
    for (int v = 0; v < VIEWS; v++) {
        float *planes = small_draw(FEATURES * PIXELS, 2 + (uint64_t)v, 0.3);
        v2v_padded_put_rows(&c->features, v, planes, HEIGHT, 0, HEIGHT);
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
    struct v2v_align_conv_plan plan = {.like = &c->features, .out_rows = HEIGHT};
    assert_ok(v2v_align_conv_plan(c->align, &plan));
    set_align_weights(c);
    for (int i = 0; i < DEPTH; i++) {
        c->whole[i] = small_draw(table[i].channels * table[i].pixels, 9, 0.3);
    }
    v2v_align_conv_forward(c->align, c->whole[0], &c->features, NULL);
    for (int i = 0; i < LAYERS; i++) {
        assert_ok(v2v_layer_plan(&c->layer[i], 1, HEIGHT, WIDTH, &c->method, 0));
        v2v_layer_weights_changed(&c->layer[i], &c->parameters);
        v2v_conv_forward(c->layer[i].conv, c->whole[i + 1], c->whole[i]);
    }
}

static void teardown(struct chain *c)
{
    for (int i = 0; i < DEPTH; i++) {
        v2v_mem_free(c->whole[i]);
    }
    for (int i = 0; i < LAYERS; i++) {
        v2v_layer_fini(&c->layer[i]);
    }
    v2v_align_conv_destroy(&c->align);
    v2v_padded_fini(&c->features);
    v2v_mem_free(c->parameters.weights);
    v2v_fields_fini(&c->fields);
    v2v_workspace_fini(&c->workspace);
    v2v_shifts_fini(&c->shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

/* The alignment and the two layers after it, or the other two. */
enum part { HEAD, TAIL };

static int in_bf16; /* are strips? The layers one by one are not. */

static struct v2v_strips_spec spec_of(struct chain *c, enum part part, int64_t most_floats)
{
    int first = part == HEAD ? 0 : MIDDLE;
    return (struct v2v_strips_spec){.align = part == HEAD ? c->align : NULL,
                                    .layer = {&c->layer[first], &c->layer[first + 1]},
                                    .layers = 2,
                                    .height = HEIGHT,
                                    .width = WIDTH,
                                    .most_floats = most_floats,
                                    .in_bf16 = in_bf16,
                                    .workspace = &c->workspace};
}

static void run(struct chain *c, enum part part, int64_t most_floats, float *out,
                const struct v2v_scene *scene)
{
    struct v2v_strips *strips = NULL;
    struct v2v_strips_spec spec = spec_of(c, part, most_floats);
    float *scratch = small_draw(v2v_strips_floats(&spec), 7, 0.3);
    struct v2v_strips_data data = {
        .features = &c->features, .images = c->whole[MIDDLE], .strips = scratch, .out = out};
    assert_ok(v2v_strips_create(&strips, &spec, &c->features));
    set_align_weights(c);
    v2v_strips_weights_changed(strips, &c->parameters);
    v2v_strips_forward(strips, &data, scene);
    v2v_strips_destroy(&strips);
    v2v_mem_free(scratch);
}

/* Winograd gives the same bits in any strip; the border ring's matrix products have other
 * shapes there, and layers by themselves are computed directly: two or three layers whose
 * transforms round about ten times and grow roundings fourfold along each axis, the largest of
 * 60,000 differences being five standard deviations. In parts of the images' root mean square. */
static const double round_off = 3.0 * 5.0 * 16.0 * 3.2 * 0x1p-24;

/* Both factors of a layer's products are rounded, by 2^-8 of themselves at most and 0.58 of that in
 * the root mean square; errors add up in squares, as do those of three layers; activations halve
 * the mean square of the sums that have them. Five standard deviations. */
static const double bf16_round_off = 5.0 * 0.58 * 1.42 * 1.74 * 1.42 * 0x1p-8;

static double bound_of_strips(void)
{
    return in_bf16 ? bf16_round_off : round_off;
}

static double root_mean_square(const float *x, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += (double)x[i] * (double)x[i];
    }
    return sqrt(sum / (double)count);
}

static void check_strips(enum part part, int64_t most_floats)
{
    struct chain c;
    double worst = 0.0;
    int last = part == HEAD ? MIDDLE : LAYERS;
    int64_t count = table[last].channels * table[last].pixels;
    setup(&c);
    float *out = small_draw(count, 8, 0.3);
    run(&c, part, most_floats, out, NULL);
    for (int64_t i = 0; i < count; i++) {
        worst = fmax(worst, fabs((double)out[i] - (double)c.whole[last][i]));
    }
    worst /= root_mean_square(c.whole[last], count);
    print_message("%lld floats of strips: largest difference %.1e\n", (long long)most_floats,
                  worst);
    assert_true(worst <= bound_of_strips());
    v2v_mem_free(out);
    teardown(&c);
}

static void strips_give_what_whole_layers_give(void **state)
{
    (void)state;
    for (int part = HEAD; part <= TAIL; part++) {
        check_strips(part, 1); /* the least rows */
        check_strips(part,
                     (int64_t)(WIDE + NARROW) * WIDTH * 60); /* that do not divide the frame */
        check_strips(part, V2V_STRIPS_FLOATS);               /* one strip */
    }
}

static int begin_bf16(void **state)
{
    (void)state;
    in_bf16 = v2v_tile_conv_usable();
    return 0;
}

static int end_bf16(void **state)
{
    (void)state;
    in_bf16 = 0;
    return 0;
}

static void skip_without_bf16(void)
{
    if (!in_bf16) {
        print_message(
            "this processor has no instructions for bf16, or DNNL_MAX_CPU_ISA hides them\n");
        skip();
    }
}

/* The alignment's border ring is float32's, by matrix products of other shapes. */
static void strips_in_bf16_have_the_same_bits_whatever_their_rows(void **state)
{
    (void)state;
    skip_without_bf16();
    strips_give_what_whole_layers_give(NULL);
    struct chain c;
    const int64_t count = table[LAYERS].channels * table[LAYERS].pixels;
    setup(&c);
    float *out = small_draw(count, 8, 0.3), *again = small_draw(count, 18, 0.3);
    run(&c, TAIL, 1, out, NULL);
    run(&c, TAIL, V2V_STRIPS_FLOATS, again, NULL);
    assert_memory_equal(out, again, (size_t)count * sizeof *out);
    v2v_mem_free(out);
    v2v_mem_free(again);
    teardown(&c);
}

static void strips_take_no_more_than_they_may(void **state)
{
    (void)state;
    struct v2v_layer first = {.in = 1024, .out = 512}, second = {.in = 512, .out = 256};
    struct v2v_align_conv *some = (struct v2v_align_conv *)(void *)&first; /* not looked at */
    for (int64_t side = 256; side <= 4096; side *= 2) {
        struct v2v_strips_spec spec = {.align = some,
                                       .layer = {&first, &second},
                                       .layers = 2,
                                       .height = side,
                                       .width = side,
                                       .most_floats = V2V_STRIPS_FLOATS};
        /* 32 rows are the least */
        int64_t least = (48 * 1024 + 40 * 512) * side;
        int64_t most = V2V_STRIPS_FLOATS > least ? V2V_STRIPS_FLOATS : least;
        assert_true(v2v_strips_floats(&spec) <= most);
    }
}

/* ---- scenes ---- */

static struct v2v_scene scene_of_views(const struct chain *c)
{
    struct v2v_scene scene;
    static float views[VIEWS * PIXELS];
    for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
        int64_t y = i / WIDTH % HEIGHT, x = i % WIDTH;
        int light = y >= 8 && y < 60 && x >= 6 && x < 34;
        views[i] = (float)light + (float)(0.02 * v2v_random_normal(6, 0, (uint64_t)i));
    }
    assert_ok(
        v2v_scene_init(&scene, &c->shifts, HEIGHT, WIDTH, &(struct v2v_slab){.rows = HEIGHT}));
    assert_true(v2v_scene_look(&scene, views, 0.1));
    assert_true(scene.computed.count > 160); /* than the shortest strips hold: there are three */
    assert_true(scene.computed.count + scene.dark.count == PIXELS / 16 + 64);
    return scene;
}

static int lists(const struct v2v_tiles *tiles, int64_t row, int64_t column)
{
    for (int64_t i = 0; row >= 0 && row < tiles->rows && i < tiles->first[tiles->rows]; i++) {
        const struct v2v_tile_run *run = &tiles->run[i];
        if (run->row == row && column >= run->first && column < run->first + run->count) {
            return 1;
        }
    }
    return 0;
}

/* Lit tiles so far inside the scene's that they do not see what lies outside: three layers deep. */
static int is_inside(const struct v2v_scene *scene, int64_t row, int64_t column)
{
    for (int64_t i = 0; i < 9; i++) {
        if (!lists(&scene->computed, row + i / 3 - 1, column + i % 3 - 1)) {
            return 0;
        }
    }
    return !lists(&scene->dark, row, column);
}

static void check_scene(enum part part)
{
    struct chain c;
    int last = part == HEAD ? MIDDLE : LAYERS, half = part == HEAD;
    int64_t pixels = table[last].pixels, width = WIDTH >> half, size = 4 >> half, seen = 0;
    setup(&c);
    struct v2v_scene scene = scene_of_views(&c);
    float *out = small_draw(table[last].channels * pixels, 8, 0.3);
    float *again = small_draw(table[last].channels * pixels, 18, 0.3);
    run(&c, part, 1, out, &scene);
    run(&c, part, V2V_STRIPS_FLOATS, again, &scene);
    double bound =
        bound_of_strips() * root_mean_square(c.whole[last], table[last].channels * pixels);
    for (int64_t i = 0; i < table[last].channels * pixels; i++) {
        int64_t row = i % pixels / width / size, column = i % width / size;
        if (is_inside(&scene, row, column)) {
            assert_true(fabs((double)out[i] - (double)c.whole[last][i]) <= bound);
            seen++;
        }
        assert_true(fabs((double)out[i] - (double)again[i]) <= bound);
    }
    assert_true(seen > 0);
    for (int64_t channel = 0; channel < table[last].channels; channel++) {
        const struct v2v_tile_run *run = scene.dark.run;
        const float *image = out + channel * pixels;
        float level = image[run->row * size * width + run->first * size];
        double sum = 0.0;
        for (int64_t i = 0; i < scene.dark.first[scene.dark.rows]; i++) {
            run = &scene.dark.run[i];
            assert_true(image[(run->row * size + 1) * width + run->first * size + 1] == level);
        }
        for (int64_t i = 0; i < 36 * size * size; i++) { /* inside the sample: 6 x 6 tiles */
            int64_t y = (scene.sample_row + 1) * size + i / (6 * size);
            int64_t x = (scene.sample_column + 1) * size + i % (6 * size);
            sum += (double)c.whole[last][channel * pixels + y * width + x];
        }
        assert_true(fabs(sum / (double)(36 * size * size) - (double)level) <= bound);
    }
    v2v_mem_free(out);
    v2v_mem_free(again);
    v2v_scene_fini(&scene);
    teardown(&c);
}

/* In whatever strips: the inside of the listed tiles to round-off, all others the background's mean
 * of each channel. */
static void a_scene_is_computed_where_it_is_and_level_elsewhere(void **state)
{
    (void)state;
    check_scene(HEAD);
    check_scene(TAIL);
}

static void a_scene_in_bf16_is_as_well(void **state)
{
    (void)state;
    skip_without_bf16();
    a_scene_is_computed_where_it_is_and_level_elsewhere(NULL);
}

static void noise_alone_is_background_and_a_full_frame_is_not_worth_a_scene(void **state)
{
    (void)state;
    enum { SIDE = 128 };
    static float views[4 * SIDE * SIDE];
    struct v2v_scene scene;
    struct v2v_shifts shifts = small_shifts(4, SLICES);
    for (int64_t i = 0; i < 4 * SIDE * SIDE; i++) {
        views[i] = (float)(0.2 + 0.1 * v2v_random_normal(6, 1, (uint64_t)i));
    }
    assert_ok(v2v_scene_init(&scene, &shifts, SIDE, SIDE, &(struct v2v_slab){.rows = SIDE}));
    assert_true(v2v_scene_look(&scene, views, 0.05));
    assert_true(scene.computed.count <= SIDE * SIDE / 16 / 100 + 64); /* and the sample */
    for (int64_t i = 0; i < 4 * SIDE * SIDE; i++) { /* half dark, half bright: stripes */
        views[i] += (float)(i % SIDE / 8 % 2);
    }
    assert_false(v2v_scene_look(&scene, views, 0.05));
    v2v_scene_fini(&scene);
    v2v_shifts_fini(&shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strips_give_what_whole_layers_give),
        cmocka_unit_test(strips_take_no_more_than_they_may),
        cmocka_unit_test(a_scene_is_computed_where_it_is_and_level_elsewhere),
        cmocka_unit_test_setup_teardown(strips_in_bf16_have_the_same_bits_whatever_their_rows,
                                        begin_bf16, end_bf16),
        cmocka_unit_test_setup_teardown(a_scene_in_bf16_is_as_well, begin_bf16, end_bf16),
        cmocka_unit_test(noise_alone_is_background_and_a_full_frame_is_not_worth_a_scene),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
