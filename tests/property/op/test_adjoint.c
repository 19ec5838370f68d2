/* <A x, y> = <x, A^T y> for everything linear in the room, and the same bits on repetition. */
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
#include <string.h>

static float *draw(int64_t count, uint64_t stream)
{
    float *array = v2v_mem_alloc("test", count, sizeof *array);
    assert_non_null(array);
    for (int64_t i = 0; i < count; i++) {
        array[i] = (float)(2.0 * v2v_random_uniform(7, stream, (uint64_t)i) - 1.0);
    }
    return array;
}

static double inner(const float *a, const float *b, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += (double)a[i] * (double)b[i];
    }
    return sum;
}

/** Both sides are the same sum of products; each float32 result errs by (terms + 2) * 2^-24 of the
 *  moduli of its terms at most, and all moduli together are at most `moduli`. */
static void assert_same(double left, double right, int64_t terms, double moduli)
{
    double bound = 2.0 * (double)(terms + 2) * ldexp(1.0, -24) * moduli;
    if (!(fabs(left - right) <= bound)) {
        fail_msg("%.12g and %.12g differ by more than %g", left, right, bound);
    }
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

/** All weights are positive and those of an output add up to 1 (of an input, for the average, to
 *  1/factor^2 or less): the moduli are at most the number of outputs, with data of modulus 1. */
static void check_resample(resample forward, resample backward, int64_t height, int64_t width,
                           int factor, int up)
{
    int64_t in = 3 * height * width;
    int64_t out = up ? in * factor * factor : 3 * (height / factor) * (width / factor);
    int64_t terms = up ? 4 * factor * factor : factor * factor;
    float *x = draw(in, 1), *y = draw(out, 2), *ax = draw(out, 3), *aty = draw(in, 4);
    forward(ax, x, 3, height, width, factor);
    backward(aty, y, 3, height, width, factor);
    assert_same(inner(ax, y, out), inner(x, aty, in), terms, (double)out);
    float *owned[] = {x, y, ax, aty};
    for (size_t i = 0; i < 4; i++) {
        v2v_mem_free(owned[i]);
    }
}

static const int64_t sizes[][2] = {{8, 8}, {16, 24}, {37, 21}, {1, 9}, {9, 1}, {2, 300}};

static void average_pooling_has_its_adjoint(void **unused)
{
    (void)unused;
    for (size_t i = 0; i < 3; i++) {
        for (int factor = 2; factor <= 8; factor *= 2) {
            check_resample(v2v_avgpool_forward, v2v_avgpool_backward, sizes[i][0], sizes[i][1],
                           factor, 0);
        }
    }
}

static void nearest_upsampling_has_its_adjoint(void **unused)
{
    (void)unused;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        check_resample(nearest_forward, nearest_backward, sizes[i][0], sizes[i][1], 2, 1);
    }
}

static void bilinear_upsampling_has_its_adjoint(void **unused)
{
    (void)unused;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        for (int factor = 1; factor <= 8; factor *= 2) {
            check_resample(v2v_bilinear_forward, v2v_bilinear_backward, sizes[i][0], sizes[i][1],
                           factor, 1);
        }
    }
}

/** Max-pooling is linear once the places are chosen; no rounding at all. */
static void max_pooling_has_its_adjoint(void **unused)
{
    (void)unused;
    enum { HEIGHT = 37, WIDTH = 22, IN = HEIGHT * WIDTH, OUT = (HEIGHT / 2) * (WIDTH / 2) };
    float *x = draw(IN, 1), *y = draw(OUT, 2), *ax = draw(OUT, 3), *aty = draw(IN, 4);
    uint8_t which[OUT];
    v2v_maxpool2_forward(ax, which, x, 1, HEIGHT, WIDTH);
    v2v_maxpool2_backward(aty, y, which, 1, HEIGHT, WIDTH);
    /* Double sums of OUT products of modulus 1, in two orders. */
    assert_true(fabs(inner(ax, y, OUT) - inner(x, aty, IN)) <= 2.0 * OUT * OUT * ldexp(1.0, -53));
    float *owned[] = {x, y, ax, aty};
    for (size_t i = 0; i < 4; i++) {
        v2v_mem_free(owned[i]);
    }
}

static const struct v2v_conv_spec layers[] = {{13, 1, 4, 40, 48, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {3, 28, 16, 37, 21, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {2, 16, 4, 19, 70, 1, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 64, 48, 37, 21, 3, 1, 1.0f, 1, 0, {0}, 0, 0},
                                              {2, 40, 24, 37, 21, 3, 2, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 256, 128, 32, 32, 3, 2, 1.0f, 1, 0, {0}, 0, 0},
                                              {1, 96, 128, 4, 4, 3, 1, 1.0f, 1, 0, {0}, 0, 0}};
static const struct v2v_conv_backend *const backends[] = {&v2v_conv_direct, &v2v_conv_onednn,
                                                          &v2v_conv_openblas};

struct layer {
    struct v2v_conv_spec spec;
    struct v2v_conv *conv;
    int64_t inputs, outputs, weights, pixels;
    float *x, *y, *w, *zero, *ax, *aty, *dw, *db;
};

static struct layer layer_init(const struct v2v_conv_spec *spec,
                               const struct v2v_conv_backend *backend)
{
    struct layer l = {.spec = *spec, .pixels = conv_out_height(spec) * conv_out_width(spec)};
    l.inputs = spec->batch * spec->in * spec->height * spec->width;
    l.outputs = spec->batch * spec->out * l.pixels;
    l.weights = spec->out * spec->in * spec->kernel * spec->kernel;
    l.x = draw(l.inputs, 1);
    l.y = draw(l.outputs, 2);
    l.w = draw(l.weights, 3);
    l.zero = v2v_mem_alloc("test", spec->out, sizeof(float));
    l.ax = draw(l.outputs, 4);
    l.aty = draw(l.inputs, 5);
    l.dw = v2v_mem_alloc("test", l.weights, sizeof(float));
    l.db = v2v_mem_alloc("test", spec->out, sizeof(float));
    assert_true(l.zero != NULL && l.dw != NULL && l.db != NULL);
    assert_ok(v2v_conv_create_with(&l.conv, spec, backend));
    v2v_conv_set_weights(l.conv, l.w, l.zero);
    return l;
}

static void layer_fini(struct layer *l)
{
    float *owned[] = {l->x, l->y, l->w, l->zero, l->ax, l->aty, l->dw, l->db};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
    v2v_conv_destroy(&l->conv);
}

static void run(struct layer *l)
{
    memset(l->dw, 0, (size_t)l->weights * sizeof(float));
    memset(l->db, 0, (size_t)l->spec.out * sizeof(float));
    v2v_conv_forward(l->conv, l->ax, l->x);
    v2v_conv_backward_data(l->conv, l->aty, l->y);
    v2v_conv_backward_weights(l->conv, l->dw, l->db, l->x, l->y);
}

static void for_all(void (*check)(struct layer *))
{
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++) {
        for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
            if (backends[j] == &v2v_conv_direct && layers[i].stride != 1) {
                continue;
            }
            struct layer l = layer_init(&layers[i], backends[j]);
            check(&l);
            layer_fini(&l);
        }
    }
}

/** <conv x, y> = <x, conv^T y> = <w, dw(x, y)>: trilinear in x, w, y. All moduli are 1 at most: as
 *  many products as output pixels times taps. */
static void check_products(struct layer *l)
{
    int64_t taps = l->spec.in * l->spec.kernel * l->spec.kernel;
    double moduli = (double)l->outputs * (double)taps;
    run(l);
    double forward = inner(l->ax, l->y, l->outputs);
    assert_same(forward, inner(l->x, l->aty, l->inputs), taps + l->spec.out * taps / l->spec.in,
                moduli);
    assert_same(forward, inner(l->w, l->dw, l->weights), taps + l->spec.batch * l->pixels, moduli);
}

static void convolution_has_its_adjoints_in_data_and_weights(void **unused)
{
    (void)unused;
    for_all(check_products);
}

/** Factors of 8 bits, which bf16 holds: what errs then are the images that come out, by 2^-8 of
 *  their elements each, and the sums in float32. */
static void check_products_in_bf16(struct layer *l)
{
    float *arrays[] = {l->x, l->y, l->w};
    const int64_t counts[] = {l->inputs, l->outputs, l->weights};
    double rounded[2] = {0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        for (int64_t j = 0; j < counts[i]; j++) {
            arrays[i][j] = roundf(arrays[i][j] * 128.0f) / 128.0f;
        }
    }
    v2v_conv_set_weights(l->conv, l->w, l->zero);
    run(l);
    for (int64_t j = 0; j < l->outputs; j++) {
        rounded[0] += fabs((double)l->ax[j] * (double)l->y[j]);
    }
    for (int64_t j = 0; j < l->inputs; j++) {
        rounded[1] += fabs((double)l->aty[j] * (double)l->x[j]);
    }
    /* |x - round(x)| <= 2^-8 |x|, so 2^-8 / (1 - 2^-8) |round(x)| at most */
    double unit = 1.0 / 255.0;
    int64_t taps = l->spec.in * l->spec.kernel * l->spec.kernel;
    int64_t terms = taps + l->spec.out * taps / l->spec.in + l->spec.batch * l->pixels + 2;
    double sums = (double)l->outputs * (double)taps * (double)terms * ldexp(1.0, -23);
    double by_weights = inner(l->w, l->dw, l->weights);
    assert_true(fabs(inner(l->ax, l->y, l->outputs) - by_weights) <= unit * rounded[0] + sums);
    assert_true(fabs(inner(l->x, l->aty, l->inputs) - by_weights) <= unit * rounded[1] + sums);
}

static void for_all_bf16(void (*check)(struct layer *))
{
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        print_message("no bf16 convolutions on this processor\n");
        skip();
    }
    static const struct v2v_conv_backend *const bf16_backends[] = {&v2v_conv_bf16, &v2v_conv_amx};
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++) {
        for (int j = 0; j < (v2v_amx_usable() ? 2 : 1); j++) {
            struct layer l = layer_init(&layers[i], bf16_backends[j]);
            check(&l);
            layer_fini(&l);
        }
    }
}

static void convolution_in_bf16_has_its_adjoints_within_rounding(void **unused)
{
    (void)unused;
    for_all_bf16(check_products_in_bf16);
}

static void check_repeats(struct layer *l)
{
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
        for_all(check_repeats);
    }
    v2v_op_set_threads(before);
}

static void the_same_thread_count_gives_the_same_bits_in_bf16(void **unused)
{
    (void)unused;
    for_all_bf16(check_repeats);
}

/** Each output element of forward and data gradient is one thread's work: only the weight gradient
 *  knows how many threads there are. */
static void forward_and_data_gradient_of_the_direct_kernel_ignore_the_thread_count(void **unused)
{
    (void)unused;
    int before = omp_get_max_threads();
    v2v_op_set_threads(1);
    struct layer one = layer_init(&layers[1], &v2v_conv_direct);
    run(&one);
    v2v_op_set_threads(3);
    struct layer three = layer_init(&layers[1], &v2v_conv_direct);
    run(&three);
    v2v_op_set_threads(before);
    assert_memory_equal(one.ax, three.ax, (size_t)one.outputs * sizeof(float));
    assert_memory_equal(one.aty, three.aty, (size_t)one.inputs * sizeof(float));
    layer_fini(&one);
    layer_fini(&three);
}

/** First of the group: the peak is this test's own. */
static void nothing_is_allocated_after_creation(void **unused)
{
    (void)unused;
    for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
        struct layer l = layer_init(&layers[1], backends[j]);
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
        cmocka_unit_test(average_pooling_has_its_adjoint),
        cmocka_unit_test(nearest_upsampling_has_its_adjoint),
        cmocka_unit_test(bilinear_upsampling_has_its_adjoint),
        cmocka_unit_test(max_pooling_has_its_adjoint),
        cmocka_unit_test(convolution_has_its_adjoints_in_data_and_weights),
        cmocka_unit_test(convolution_in_bf16_has_its_adjoints_within_rounding),
        cmocka_unit_test(the_same_thread_count_gives_the_same_bits),
        cmocka_unit_test(the_same_thread_count_gives_the_same_bits_in_bf16),
        cmocka_unit_test(forward_and_data_gradient_of_the_direct_kernel_ignore_the_thread_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
