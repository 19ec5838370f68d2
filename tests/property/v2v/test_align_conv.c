/* The merged first convolution against shifting, padding and convolving in plain double loops. */
#include "adjoint.h"
#include "support.h"

#include "v2v/align_conv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/op/bf16.h"

#include <math.h>
#include <string.h>

enum {
    VIEWS = 4,
    LISTED = 2,
    FEATURES = 3,
    SLICES = 5,
    OUT = 40, /* enough for bf16 to be taken; a block and a part of one */
    HEIGHT = 37,
    WIDTH = 41,
    REACH = 4
};
enum { IN = LISTED * FEATURES * SLICES, PIXELS = HEIGHT * WIDTH };

static const int32_t listed[LISTED] = {1, 3};

/* The ways to compute the layer. */
struct way {
    const char *name;
    int backend, winograd, every_slice;
    /* of the worst element's error against one rounding of each product: Winograd's
     * transforms grow moduli by at most 16 along each axis */
    double growth;
    int precision;
};
static const struct way ways[] = {
    {"oneDNN, merged taps", V2V_BACKEND_ONEDNN, 0, 0, 1.0, V2V_PRECISION_F32},
    {"OpenBLAS, merged taps", V2V_BACKEND_OPENBLAS, 0, 0, 1.0, V2V_PRECISION_F32},
    {"merged blocks", V2V_BACKEND_ONEDNN, 1, 0, 256.0, V2V_PRECISION_F32},
    {"every slice", V2V_BACKEND_ONEDNN, 1, 1, 256.0, V2V_PRECISION_F32},
    {"bf16, merged blocks", V2V_BACKEND_ONEDNN, 0, 0, 1.0, V2V_PRECISION_BF16},
    {"bf16, every slice", V2V_BACKEND_ONEDNN, 0, 1, 1.0, V2V_PRECISION_BF16}};
enum { WAYS = sizeof ways / sizeof *ways };

/* Rounding of an image that comes out. */
static double unit_of(const struct way *way)
{
    return way->precision == V2V_PRECISION_F32 ? 0.0 : 1.0 / 256.0;
}

static int can_run(const struct way *way)
{
    int can = way->precision == V2V_PRECISION_F32 || v2v_op_bf16() != V2V_BF16_NONE;
    if (!can) {
        print_message("%s: not on this processor\n", way->name);
    }
    return can;
}

struct layer_case {
    int32_t dy[VIEWS * SLICES], dx[VIEWS * SLICES];
    struct v2v_shifts shifts;
    struct v2v_align_conv *conv;
    struct v2v_padded features, dfeatures;
    struct v2v_workspace workspace;
    float *f, *w, *b, *out, *dout, *dw, *db, *df;
};

/* Multiples of 1/8 below 6: bf16 holds them, and sums of as many of them as there are slices. */
static void random_fill(float *x, int64_t count, uint64_t stream)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = roundf(8.0f * (float)v2v_random_normal(11, stream, (uint64_t)i)) / 8.0f;
        assert_true(fabsf(x[i]) < 6.0f);
    }
}

static void setup(struct layer_case *c, const struct way *how, float slope)
{
    struct v2v_align_conv_spec spec = {.views = listed,
                                       .view_count = LISTED,
                                       .features = FEATURES,
                                       .out = OUT,
                                       .slope = slope,
                                       .every_slice = how->every_slice,
                                       .method = {.backend = how->backend,
                                                  .winograd = how->winograd,
                                                  .workspace = &c->workspace,
                                                  .precision = how->precision}};
    *c = (struct layer_case){0};
    for (int i = 0; i < VIEWS * SLICES; i++) {
        c->dy[i] = (int32_t)v2v_random_below(5, 0, (uint64_t)i, 2 * REACH + 1) - REACH;
        c->dx[i] = (int32_t)v2v_random_below(5, 1, (uint64_t)i, 2 * REACH + 1) - REACH;
    }
    c->shifts = (struct v2v_shifts){VIEWS, SLICES, c->dy, c->dx};
    assert_ok(V2V_ALLOC(c->f, "test", VIEWS * FEATURES * PIXELS));
    assert_ok(V2V_ALLOC(c->df, "test", VIEWS * FEATURES * PIXELS));
    assert_ok(V2V_ALLOC(c->w, "test", OUT * IN * 9));
    assert_ok(V2V_ALLOC(c->dw, "test", OUT * IN * 9));
    assert_ok(V2V_ALLOC(c->b, "test", OUT));
    assert_ok(V2V_ALLOC(c->db, "test", OUT));
    assert_ok(V2V_ALLOC(c->out, "test", OUT * PIXELS));
    assert_ok(V2V_ALLOC(c->dout, "test", OUT * PIXELS));
    random_fill(c->f, VIEWS * FEATURES * PIXELS, 2);
    random_fill(c->w, OUT * IN * 9, 3);
    random_fill(c->b, OUT, 4);
    random_fill(c->dout, OUT * PIXELS, 5);
    assert_ok(v2v_padded_init(&c->features, VIEWS, FEATURES, HEIGHT, WIDTH, REACH + 1));
    assert_ok(v2v_padded_init(&c->dfeatures, VIEWS, FEATURES, HEIGHT, WIDTH, REACH + 1));
    for (int v = 0; v < VIEWS; v++) {
        v2v_padded_put_rows(&c->features, v, c->f + v * FEATURES * PIXELS, HEIGHT, 0, HEIGHT);
    }
    assert_ok(v2v_align_conv_create(&c->conv, &c->shifts, &spec));
    struct v2v_align_conv_plan plan = {.like = &c->features, .out_rows = HEIGHT, .training = 1};
    assert_ok(v2v_align_conv_plan(c->conv, &plan));
    v2v_align_conv_set_weights(c->conv, c->w, c->b);
    v2v_align_conv_forward(c->conv, c->out, &c->features, NULL);
}

static void teardown(struct layer_case *c)
{
    float *memory[] = {c->f, c->w, c->b, c->out, c->dout, c->dw, c->db, c->df};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_padded_fini(&c->features);
    v2v_padded_fini(&c->dfeatures);
    v2v_align_conv_destroy(&c->conv);
    v2v_workspace_fini(&c->workspace);
    assert_int_equal(v2v_mem_held(), 0);
}

static int inside(int y, int x)
{
    return y >= 0 && y < HEIGHT && x >= 0 && x < WIDTH;
}

/* aligned[(i,c,z), y, x] of REFERENCE.md 3; 0 where the shift leaves the frame. */
static double aligned(const struct layer_case *c, int in, int y, int x)
{
    int i = in / (FEATURES * SLICES), feature = in / SLICES % FEATURES, z = in % SLICES;
    int v = listed[i];
    int sy = y + c->dy[v * SLICES + z], sx = x + c->dx[v * SLICES + z];
    return inside(sy, sx) ? c->f[(v * FEATURES + feature) * PIXELS + sy * WIDTH + sx] : 0.0;
}

static double convolved(const struct layer_case *c, int o, int y, int x)
{
    double sum = c->b[o];
    for (int in = 0; in < IN; in++) {
        for (int k = 0; k < 9; k++) {
            int py = y + k / 3 - 1, px = x + k % 3 - 1;
            if (inside(py, px)) {
                sum += c->w[(o * IN + in) * 9 + k] * aligned(c, in, py, px);
            }
        }
    }
    return sum;
}

/* IN*9 = 270 products of size about 1: round-off sqrt(270)*6e-8*|sum| ~ 1e-6 of a typical sum; the
 * worst element is small beside its terms, so errors are taken against their magnitude. What an
 * image is rounded by at the end comes off before. */
static void every_way_equals_shift_pad_convolve_everywhere(void **state)
{
    (void)state;
    for (int way = 0; way < WAYS; way++) {
        struct layer_case c;
        double worst = 0.0;
        if (!can_run(&ways[way])) {
            continue;
        }
        setup(&c, &ways[way], 1.0f);
        for (int at = 0; at < OUT * PIXELS; at++) {
            int y = at % PIXELS / WIDTH, x = at % PIXELS % WIDTH;
            double value = convolved(&c, at / PIXELS, y, x);
            worst = fmax(worst, fabs(c.out[at] - value) - unit_of(&ways[way]) * fabs(value));
        }
        print_message("%s: largest error %.1e\n", ways[way].name, worst);
        assert_true(worst <= ways[way].growth * 270 * 6e-8 * sqrt(270.0));
        teardown(&c);
    }
}

static void of_features(void *self, float *out, const float *in)
{
    struct layer_case *c = self;
    for (int v = 0; v < VIEWS; v++) {
        v2v_padded_put_rows(&c->features, v, in + v * FEATURES * PIXELS, HEIGHT, 0, HEIGHT);
    }
    v2v_align_conv_set_weights(c->conv, c->w, c->b);
    v2v_align_conv_forward(c->conv, out, &c->features, NULL);
}

static void turn_back(struct layer_case *c, const float *dout)
{
    memcpy(c->dout, dout, (size_t)(OUT * PIXELS) * sizeof *dout);
    v2v_padded_clear(&c->dfeatures);
    v2v_align_conv_backward(c->conv, c->dw, c->db, &c->dfeatures, &c->features, c->dout);
}

static void of_features_turned(void *self, float *in, const float *out)
{
    struct layer_case *c = self;
    turn_back(c, out);
    for (int v = 0; v < VIEWS; v++) {
        v2v_padded_get_rows(&c->dfeatures, v, in + v * FEATURES * PIXELS, 0, HEIGHT);
    }
}

/* `in`: weights, then biases */
static void of_weights(void *self, float *out, const float *in)
{
    struct layer_case *c = self;
    v2v_align_conv_set_weights(c->conv, in, in + OUT * IN * 9);
    v2v_align_conv_forward(c->conv, out, &c->features, NULL);
}

static void of_weights_turned(void *self, float *in, const float *out)
{
    struct layer_case *c = self;
    turn_back(c, out);
    memcpy(in, c->dw, OUT * IN * 9 * sizeof *in);
    memcpy(in + OUT * IN * 9, c->db, OUT * sizeof *in);
}

/* Sums over the taps of all inputs or outputs, for weights over pixels; by Winograd over
 * channels, or tiles of 16 pixels, between its transforms. Merged weights are rounded to 8 bits
 * once more: 2^-10 in the mean square. */
static double rounding_of(const struct way *way, double channels, double pixels)
{
    double merged = way->precision == V2V_PRECISION_BF16 && !way->every_slice ? 0x1p-10 : 0.0;
    return merged + (way->growth > 1.0 ? way->growth * test_rounding(fmax(channels, pixels / 16.0))
                                       : test_rounding(fmax(9.0 * channels, pixels)));
}

/* Linear in the features, and in weights and bias. */
static void check_adjoints(const struct way *way)
{
    struct layer_case c;
    setup(&c, way, 1.0f);
    memset(c.b, 0, OUT * sizeof *c.b);
    struct test_linear linear = {.name = way->name,
                                 .ins = VIEWS * FEATURES * PIXELS,
                                 .outs = OUT * PIXELS,
                                 .self = &c,
                                 .forward = of_features,
                                 .adjoint = of_features_turned,
                                 .rounding = rounding_of(way, OUT, 0.0),
                                 .image_unit = unit_of(way)};
    test_adjoint(&linear);
    linear.ins = OUT * IN * 9 + OUT;
    linear.forward = of_weights;
    linear.adjoint = of_weights_turned;
    linear.rounding = rounding_of(way, IN, PIXELS);
    test_adjoint(&linear);
    teardown(&c);
}

static void every_way_has_its_adjoints_in_features_and_weights(void **state)
{
    (void)state;
    for (int way = 0; way < WAYS; way++) {
        if (can_run(&ways[way])) {
            check_adjoints(&ways[way]);
        }
    }
}

/* To the nearest of 8 significant bits, ties to even, as its upper half. */
static unsigned rounded(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits + 0x7fff + (bits >> 16 & 1)) >> 16;
}

static float *output(struct layer_case *c, int form, int64_t floats)
{
    struct v2v_align_conv_plan plan = {.like = &c->features, .out_rows = HEIGHT, .out_form = form};
    float *out = v2v_mem_alloc("test", floats, sizeof *out);
    assert_non_null(out);
    memset(out, 0xff, (size_t)floats * sizeof *out); /* all of it is to be written */
    assert_ok(v2v_align_conv_plan(c->conv, &plan));
    v2v_align_conv_set_weights(c->conv, c->w, c->b);
    v2v_align_conv_forward(c->conv, out, &c->features, NULL);
    return out;
}

/* Number i of lane after lane, pixel after pixel, block after block. */
static unsigned expected(const float *plain, int64_t i)
{
    enum { LANES = V2V_BLOCKED_CHANNELS };
    int64_t o = i / LANES / PIXELS * LANES + i % LANES;
    return o < OUT ? rounded(plain[o * PIXELS + i / LANES % PIXELS]) : 0;
}

static void check_blocked(const struct way *way)
{
    struct layer_case c;
    setup(&c, way, 0.01f);
    if (v2v_align_conv_takes_blocked(c.conv)) {
        int64_t floats = v2v_blocked_floats(OUT, HEIGHT, WIDTH);
        float *plain = output(&c, V2V_FORM_PLAIN, OUT * PIXELS);
        float *blocked = output(&c, V2V_FORM_BLOCKED, floats);
        for (int64_t i = 0; i < 2 * floats; i++) {
            uint16_t value;
            memcpy(&value, (const char *)blocked + i * 2, sizeof value);
            assert_int_equal(value, expected(plain, i));
        }
        v2v_mem_free(plain);
        v2v_mem_free(blocked);
    } else {
        print_message("%s: no blocked images on this processor\n", way->name);
    }
    teardown(&c);
}

/* Inside, where blocks are convolved, in the ring of the taps, and with zeros in the lanes behind
 * the last channel. */
static void a_blocked_output_is_the_plain_one_rounded(void **state)
{
    (void)state;
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
    for (int way = 0; way < WAYS; way++) {
        if (ways[way].precision == V2V_PRECISION_BF16) {
            check_blocked(&ways[way]);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_way_equals_shift_pad_convolve_everywhere),
        cmocka_unit_test(every_way_has_its_adjoints_in_features_and_weights),
        cmocka_unit_test(a_blocked_output_is_the_plain_one_rounded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
