/* <A x, y> = <x, A^T y> for everything linear in the room, and the same bits on repetition. */
#include "adjoint.h"
#include "op/conv_backend.h"
#include "op/isa.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/op/resample.h"
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

/* Numbers of 7 bits, which bf16 holds. */
static float *draw(int64_t count, uint64_t stream)
{
    float *array = v2v_mem_alloc("test", count, sizeof *array);
    assert_non_null(array);
    for (int64_t i = 0; i < count; i++) {
        array[i] = (float)(v2v_random_below(7, stream, (uint64_t)i, 255) - 127) / 128.0f;
    }
    return array;
}

typedef void (*resample)(float *to, const float *from, int64_t planes, int64_t height,
                         int64_t width, int factor);

static void nearest_forward(float *to, const float *from, int64_t planes, int64_t height,
                            int64_t width, int factor)
{
    (void)factor;
    v2v_nearest2_forward(to, from, planes, height, width);
}

static void nearest_backward(float *to, const float *from, int64_t planes, int64_t height,
                             int64_t width, int factor)
{
    (void)factor;
    v2v_nearest2_backward(to, from, planes, height, width);
}

/* terms: of one result, either way, of a factor f. */
struct resampling {
    const char *name;
    resample forward, backward;
    int up, terms; /* terms * f^2 products make a result, either way */
    int64_t height, width;
    int factor;
};

static void resample_forward(void *self, float *out, const float *in)
{
    const struct resampling *r = self;
    r->forward(out, in, 3, r->height, r->width, r->factor);
}

static void resample_backward(void *self, float *in, const float *out)
{
    const struct resampling *r = self;
    r->backward(in, out, 3, r->height, r->width, r->factor);
}

/* Factors 1 (of the bilinear one alone) to 8; a weight rounds once more. */
static const struct resampling resamplings[] = {
    {"average pooling", v2v_avgpool_forward, v2v_avgpool_backward, 0, 2, 0, 0, 2},
    {"average pooling", v2v_avgpool_forward, v2v_avgpool_backward, 0, 2, 0, 0, 4},
    {"average pooling", v2v_avgpool_forward, v2v_avgpool_backward, 0, 2, 0, 0, 8},
    {"nearest upsampling", nearest_forward, nearest_backward, 1, 1, 0, 0, 2},
    {"bilinear upsampling", v2v_bilinear_forward, v2v_bilinear_backward, 1, 8, 0, 0, 1},
    {"bilinear upsampling", v2v_bilinear_forward, v2v_bilinear_backward, 1, 8, 0, 0, 2},
    {"bilinear upsampling", v2v_bilinear_forward, v2v_bilinear_backward, 1, 8, 0, 0, 4},
    {"bilinear upsampling", v2v_bilinear_forward, v2v_bilinear_backward, 1, 8, 0, 0, 8}};

static void resampling_has_its_adjoint(void **unused)
{
    static const int64_t sizes[][2] = {{8, 8}, {16, 24}, {37, 21}, {1, 9}, {9, 1}, {2, 300}};
    (void)unused;
    for (size_t i = 0; i < sizeof resamplings / sizeof *resamplings; i++) {
        for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
            struct resampling r = resamplings[i];
            r.height = sizes[k][0];
            r.width = sizes[k][1];
            int64_t f = r.factor, large = r.height * f * r.width * f;
            int64_t small = (r.height / f) * (r.width / f), same = r.height * r.width;
            if (r.up || small > 0) {
                test_adjoint(&(struct test_linear){.name = r.name,
                                                   .ins = 3 * same,
                                                   .outs = 3 * (r.up ? large : small),
                                                   .self = &r,
                                                   .forward = resample_forward,
                                                   .adjoint = resample_backward,
                                                   .rounding = test_rounding(r.terms * f * f)});
            }
        }
    }
}

static const struct v2v_conv_spec layers[] = {{13, 1, 4, 40, 48, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {3, 28, 16, 37, 21, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {2, 16, 4, 19, 70, 1, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 64, 48, 37, 21, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {2, 40, 24, 37, 21, 3, 2, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 24, 40, 36, 28, 3, 1, 1.0f, 1, 1, {0}, 0, 0},
                                              {1, 256, 128, 32, 32, 3, 2, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 96, 128, 4, 4, 3, 1, 1.0f, 1, 0, {0}, 0, 0}};

struct way {
    const struct v2v_conv_backend *backend;
    int filters; /* bool: Winograd */
    int bf16;    /* bool: images are rounded to 8 bits */
};
static const struct way ways[] = {{&v2v_conv_direct, 0, 0},   {&v2v_conv_onednn, 0, 0},
                                  {&v2v_conv_openblas, 0, 0}, {&v2v_conv_winograd, 1, 0},
                                  {&v2v_conv_bf16, 0, 1},     {&v2v_conv_amx, 0, 1}};
enum { WAYS = sizeof ways / sizeof *ways, OF_FLOATS = 4 };

static int can_run(const struct way *way, const struct v2v_conv_spec *spec)
{
    return way->backend == &v2v_conv_direct     ? spec->stride == 1
           : way->backend == &v2v_conv_winograd ? spec->kernel == 3
           : way->backend == &v2v_conv_amx      ? v2v_amx_usable()
           : way->bf16                          ? v2v_op_bf16() != V2V_BF16_NONE
                                                : 1;
}

struct layer {
    struct v2v_conv_spec spec;
    struct v2v_workspace workspace;
    struct v2v_conv *conv;
    int64_t inputs, outputs, weights;
    float *x, *y, *w, *zero, *ax, *aty, *dw, *db;
};

static void layer_init(struct layer *l, const struct v2v_conv_spec *spec, const struct way *way)
{
    *l = (struct layer){.spec = *spec};
    l->spec.method.workspace = &l->workspace;
    l->inputs =
        spec->batch * spec->in * (spec->height >> spec->upsample) * (spec->width >> spec->upsample);
    l->outputs = spec->batch * spec->out * conv_out_height(spec) * conv_out_width(spec);
    l->weights = spec->out * spec->in * spec->kernel * spec->kernel;
    l->x = draw(l->inputs, 1);
    l->y = draw(l->outputs, 2);
    l->w = draw(l->weights, 3);
    l->ax = draw(l->outputs, 4);
    l->aty = draw(l->inputs, 5);
    assert_ok(V2V_ALLOC(l->zero, "test", spec->out));
    assert_ok(V2V_ALLOC(l->dw, "test", l->weights));
    assert_ok(V2V_ALLOC(l->db, "test", spec->out));
    assert_ok(v2v_conv_create_with(&l->conv, &l->spec, way->backend));
    v2v_conv_set_weights(l->conv, l->w, l->zero);
}

static void layer_fini(struct layer *l)
{
    float *owned[] = {l->x, l->y, l->w, l->zero, l->ax, l->aty, l->dw, l->db};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
    v2v_conv_destroy(&l->conv);
    v2v_workspace_fini(&l->workspace);
}

static void run(struct layer *l)
{
    struct v2v_gradients to = {.din = l->aty, .dweight = l->dw, .dbias = l->db, .sets = 1};
    v2v_conv_forward(l->conv, l->ax, l->x);
    v2v_conv_backward(l->conv, &to, l->x, l->y);
}

/* `check` for every layer and the ways from `first` to before `last`. */
static void for_all(int first, int last, void (*check)(struct layer *, const struct way *))
{
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++) {
        for (int j = first; j < last; j++) {
            struct layer l;
            if (can_run(&ways[j], &layers[i])) {
                layer_init(&l, &layers[i], &ways[j]);
                check(&l, &ways[j]);
                layer_fini(&l);
            }
        }
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void of_data(void *self, float *out, const float *in)
{
    struct layer *l = self;
    v2v_conv_forward(l->conv, out, in);
}

static void of_data_turned(void *self, float *in, const float *out)
{
    struct layer *l = self;
    v2v_conv_backward(l->conv, &(struct v2v_gradients){.din = in}, l->x, out);
}

/* `in`: weights, then biases */
static void of_weights(void *self, float *out, const float *in)
{
    struct layer *l = self;
    v2v_conv_set_weights(l->conv, in, in + l->weights);
    v2v_conv_forward(l->conv, out, l->x);
}

static void of_weights_turned(void *self, float *in, const float *out)
{
    struct layer *l = self;
    struct v2v_gradients to = {.dweight = in, .dbias = in + l->weights, .sets = 1};
    v2v_conv_backward(l->conv, &to, l->x, out);
}

/* Sums over taps of all channels, or for weights over pixels. Winograd adds up channels,
 * or tiles of 16 pixels, between transforms that grow moduli by at most 16 along each axis. */
static double rounding_of(const struct layer *l, const struct way *way, int of_weights)
{
    const struct v2v_conv_spec *s = &l->spec;
    double channels = (double)(s->in > s->out ? s->in : s->out);
    double pixels = of_weights ? (double)(l->outputs / s->out) : 0.0;
    return way->filters ? 256.0 * test_rounding(fmax(channels, pixels / 16.0))
                        : test_rounding(fmax(s->kernel * s->kernel * channels, pixels));
}

/* The convolution is linear in its input, and in weights and bias. bf16 holds 8 bits: what is drawn
 * is not rounded, images that come out are, by 2^-8 / (1 - 2^-8) of themselves at most. */
static void check_adjoints(struct layer *l, const struct way *way)
{
    const struct v2v_conv_spec *s = &l->spec;
    char name[128];
    snprintf(name, sizeof name, "%s, %lld to %lld channels, %lld x %lld, kernel %d stride %d",
             way->backend->name, (long long)s->in, (long long)s->out, (long long)s->height,
             (long long)s->width, s->kernel, s->stride);
    struct test_linear data = {.name = name,
                               .ins = l->inputs,
                               .outs = l->outputs,
                               .self = l,
                               .forward = of_data,
                               .adjoint = of_data_turned,
                               .rounding = rounding_of(l, way, 0),
                               .image_unit = way->bf16 ? 1.0 / 255.0 : 0.0};
    test_adjoint(&data);
    data.ins = l->weights + s->out;
    data.forward = of_weights;
    data.adjoint = of_weights_turned;
    data.rounding = rounding_of(l, way, 1);
    test_adjoint(&data);
}

static void convolution_has_its_adjoints_in_data_and_weights(void **unused)
{
    (void)unused;
    for_all(0, OF_FLOATS, check_adjoints);
}

static void skip_without_bf16(void)
{
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
}

static void convolution_in_bf16_has_its_adjoints_within_rounding(void **unused)
{
    (void)unused;
    skip_without_bf16();
    for_all(OF_FLOATS, WAYS, check_adjoints);
}

static void check_repeats(struct layer *l, const struct way *way)
{
    (void)way;
    float *results[] = {l->ax, l->aty, l->dw, l->db};
    int64_t counts[] = {l->outputs, l->inputs, l->weights, l->spec.out};
    float *first[4];
    run(l);
    for (int i = 0; i < 4; i++) {
        first[i] = draw(counts[i], 1);
        memcpy(first[i], results[i], (size_t)counts[i] * sizeof(float));
    }
    run(l);
    for (int i = 0; i < 4; i++) {
        assert_memory_equal(first[i], results[i], (size_t)counts[i] * sizeof(float));
        v2v_mem_free(first[i]);
    }
}

static void the_same_thread_count_gives_the_same_bits(void **unused)
{
    (void)unused;
    int before = omp_get_max_threads();
    for (int threads = 1; threads <= 3; threads += 2) {
        v2v_op_set_threads(threads);
        for_all(0, OF_FLOATS, check_repeats);
    }
    v2v_op_set_threads(before);
}

static void the_same_thread_count_gives_the_same_bits_in_bf16(void **unused)
{
    (void)unused;
    skip_without_bf16();
    for_all(OF_FLOATS, WAYS, check_repeats);
}

/* Each output element of forward and data gradient is one thread's work: only the weight gradient
 * knows how many threads there are. */
static void forward_and_data_gradient_of_the_direct_kernel_ignore_the_thread_count(void **unused)
{
    struct layer one, three;
    (void)unused;
    int before = omp_get_max_threads();
    v2v_op_set_threads(1);
    layer_init(&one, &layers[1], &ways[0]);
    run(&one);
    v2v_op_set_threads(3);
    layer_init(&three, &layers[1], &ways[0]);
    run(&three);
    v2v_op_set_threads(before);
    assert_memory_equal(one.ax, three.ax, (size_t)one.outputs * sizeof(float));
    assert_memory_equal(one.aty, three.aty, (size_t)one.inputs * sizeof(float));
    layer_fini(&one);
    layer_fini(&three);
}

/* First of the group: the peak is this test's own. */
static void nothing_is_allocated_after_creation(void **unused)
{
    (void)unused;
    for (int j = 0; j < OF_FLOATS; j++) {
        struct layer l;
        layer_init(&l, &layers[1], &ways[j]);
        size_t held = v2v_mem_held(), peak = v2v_mem_peak();
        run(&l);
        v2v_conv_set_weights(l.conv, l.w, l.zero);
        assert_int_equal(v2v_mem_held(), held);
        assert_int_equal(v2v_mem_peak(), peak);
        layer_fini(&l);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_allocated_after_creation),
        cmocka_unit_test(resampling_has_its_adjoint),
        cmocka_unit_test(convolution_has_its_adjoints_in_data_and_weights),
        cmocka_unit_test(convolution_in_bf16_has_its_adjoints_within_rounding),
        cmocka_unit_test(the_same_thread_count_gives_the_same_bits),
        cmocka_unit_test(the_same_thread_count_gives_the_same_bits_in_bf16),
        cmocka_unit_test(forward_and_data_gradient_of_the_direct_kernel_ignore_the_thread_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
