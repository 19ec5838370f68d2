/* What is not linear in the room, in all its arguments, with its kinks outside every step. */
#include "gradient.h"
#include "op/conv_backend.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/resample.h"
#include <math.h>

#define SLOPE 0.25f

static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(2.0 * v2v_random_uniform(9, stream, (uint64_t)i) - 1.0);
    }
    return x;
}

/* Away from zero by 1/4, up to 5/4. */
static void part(float *x, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] += copysignf(0.25f, x[i]);
    }
}

/* x -> leaky -> convolution -> leaky: a layer between two others, its activations fused. */
struct layer {
    struct v2v_conv_spec spec;
    struct v2v_workspace workspace;
    struct v2v_conv *conv;
    int64_t inputs, outputs, weights;
    float *x, *w, *b, *dx, *dw, *db, *in, *out, *dout;
};

static void layer_run(struct layer *l)
{
    v2v_conv_set_weights(l->conv, l->w, l->b);
    v2v_leaky_forward(l->in, l->x, l->inputs, SLOPE);
    v2v_conv_forward(l->conv, l->out, l->in);
}

static void layer_forward(void *self, double *out)
{
    struct layer *l = self;
    layer_run(l);
    for (int64_t i = 0; i < l->outputs; i++) {
        out[i] = (double)l->out[i];
    }
}

static void layer_backward(void *self, const double *dout)
{
    struct layer *l = self;
    struct v2v_gradients to = {
        .din = l->dx, .dweight = l->dw, .dbias = l->db, .sets = 1, .in_slope = SLOPE};
    layer_run(l);
    for (int64_t i = 0; i < l->outputs; i++) {
        l->dout[i] = (float)dout[i];
    }
    v2v_leaky_backward(l->dout, l->dout, l->out, l->outputs, SLOPE);
    v2v_conv_backward(l->conv, &to, l->in, l->dout);
}

/* A bias twice as large as all that the taps can add up to: the sums stay on its side. */
static void part_sums(struct layer *l)
{
    const int64_t taps = l->weights / l->spec.out;
    for (int64_t o = 0; o < l->spec.out; o++) {
        float moduli = 0.0f;
        for (int64_t i = 0; i < taps; i++) {
            moduli += fabsf(l->w[o * taps + i]);
        }
        l->b[o] = copysignf(2.0f * 1.25f * moduli, l->b[o]);
    }
}

static void check_layer(const struct v2v_conv_spec *spec, const struct v2v_conv_backend *backend)
{
    struct layer l = {.spec = *spec};
    l.spec.method.workspace = &l.workspace;
    l.inputs =
        spec->batch * spec->in * (spec->height >> spec->upsample) * (spec->width >> spec->upsample);
    l.outputs = spec->batch * spec->out * conv_out_height(spec) * conv_out_width(spec);
    l.weights = spec->out * spec->in * spec->kernel * spec->kernel;
    float **memory[] = {&l.x, &l.dx, &l.in, &l.w, &l.dw, &l.b, &l.db, &l.out, &l.dout};
    const int64_t counts[] = {l.inputs,  l.inputs,  l.inputs,  l.weights, l.weights,
                              spec->out, spec->out, l.outputs, l.outputs};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        *memory[i] = draw(counts[i], i);
    }
    part(l.x, l.inputs);
    part_sums(&l);
    assert_ok(v2v_conv_create_with(&l.conv, &l.spec, backend));
    const struct test_argument arguments[] = {{"x", l.x, l.dx, l.inputs},
                                              {"weight", l.w, l.dw, l.weights},
                                              {"bias", l.b, l.db, spec->out}};
    /* as tests/property/op/test_adjoint.c has them */
    const double pixels = (double)(l.outputs / spec->out), taps = (double)(l.weights / spec->out);
    const int filters = backend == &v2v_conv_winograd;
    test_gradient(&(struct test_function){.name = backend->name,
                                          .argument = arguments,
                                          .arguments = 3,
                                          .outs = l.outputs,
                                          .self = &l,
                                          .forward = layer_forward,
                                          .backward = layer_backward,
                                          .step = 0x1p-8,
                                          .rounding = test_rounding(taps + 1),
                                          .backward_rounding = (filters ? 256.0 : 1.0) *
                                                               test_rounding(fmax(taps, pixels)),
                                          .elements = 3,
                                          .sees = 0.01});
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(*memory[i]);
    }
    v2v_conv_destroy(&l.conv);
    v2v_workspace_fini(&l.workspace);
    assert_int_equal(v2v_mem_held(), 0);
}

static void layers_between_activations_have_their_gradients(void **state)
{
    static const struct v2v_conv_spec specs[] = {{2, 3, 5, 9, 14, 3, 1, SLOPE, 1, 0, {0}, 0, 0},
                                                 {1, 12, 8, 10, 8, 1, 1, SLOPE, 1, 0, {0}, 0, 0},
                                                 {1, 5, 6, 11, 9, 3, 2, SLOPE, 1, 0, {0}, 0, 0},
                                                 {1, 6, 4, 12, 8, 3, 1, SLOPE, 1, 1, {0}, 0, 0}};
    static const struct v2v_conv_backend *const backends[] = {
        &v2v_conv_direct, &v2v_conv_onednn, &v2v_conv_openblas, &v2v_conv_winograd};
    (void)state;
    for (size_t i = 0; i < sizeof specs / sizeof *specs; i++) {
        for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
            if ((backends[j] != &v2v_conv_direct || specs[i].stride == 1) &&
                (backends[j] != &v2v_conv_winograd || specs[i].kernel == 3)) {
                check_layer(&specs[i], backends[j]);
            }
        }
    }
}

enum { PLANES = 2, HEIGHT = 13, WIDTH = 10, PIXELS = PLANES * HEIGHT * WIDTH };
enum { WINDOWS = PLANES * (HEIGHT / 2) * (WIDTH / 2) };

/* Maxima of 2 x 2 pixels. */
struct pooling {
    float x[PIXELS], dx[PIXELS];
    uint8_t which[WINDOWS];
};

static void pool_forward(void *self, double *out)
{
    float pooled[WINDOWS];
    struct pooling *p = self;
    v2v_maxpool2_forward(pooled, p->which, p->x, PLANES, HEIGHT, WIDTH);
    for (int i = 0; i < WINDOWS; i++) {
        out[i] = (double)pooled[i];
    }
}

static void pool_backward(void *self, const double *dout)
{
    float pooled[WINDOWS];
    struct pooling *p = self;
    v2v_maxpool2_forward(pooled, p->which, p->x, PLANES, HEIGHT, WIDTH);
    for (int i = 0; i < WINDOWS; i++) {
        pooled[i] = (float)dout[i];
    }
    v2v_maxpool2_backward(p->dx, pooled, p->which, PLANES, HEIGHT, WIDTH);
}

/* The four of a window differ by 1/4 at least, each of them is the largest of some. */
static void max_pooling_has_its_gradient(void **state)
{
    struct pooling p = {.which = {0}};
    const struct test_argument x = {"x", p.x, p.dx, PIXELS};
    (void)state;
    for (int64_t i = 0; i < PIXELS; i++) {
        int64_t y = i / WIDTH % HEIGHT, column = i % WIDTH;
        int64_t turn = v2v_random_below(9, (uint64_t)(y / 2), (uint64_t)(column / 2), 4);
        p.x[i] = 0.25f * (float)((y % 2 * 2 + column % 2 + turn) % 4) - 0.4f;
    }
    test_gradient(&(struct test_function){.name = "maximum",
                                          .argument = &x,
                                          .arguments = 1,
                                          .outs = WINDOWS,
                                          .self = &p,
                                          .forward = pool_forward,
                                          .backward = pool_backward,
                                          .step = 0x1p-6,
                                          .backward_rounding = 0x1p-24,
                                          .elements = 20,
                                          .sees = 0.01});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(layers_between_activations_have_their_gradients),
        cmocka_unit_test(max_pooling_has_its_gradient),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
