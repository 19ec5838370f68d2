/* Convolutions in bf16 by the tile unit: sizes beyond one group of channels, outputs and pixels,
 * blocked images, threads. What every backend must do is in test_conv.c. */
#include "op/conv_backend.h"
#include "op/isa.h"
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/gemm.h"

#include <math.h>
#include <omp.h>
#include <string.h>

static void skip_without_tiles(void)
{
    if (!v2v_amx_usable()) {
        test_skip("this processor has no tiles for bf16, or DNNL_MAX_CPU_ISA hides them");
    }
}

/* Multiples of 1/128: bf16 holds them, and their products are multiples of 2^-14 of modulus 1 at
 * most, whose sums float32 holds up to 2^10. Or all bits of float32: the order of a sum shows. */
enum numbers { EXACT, ANY };

static float *draw(int64_t count, uint64_t stream, enum numbers numbers)
{
    float *array = v2v_mem_alloc("test", count, sizeof *array);
    assert_non_null(array);
    for (int64_t i = 0; i < count; i++) {
        double value = 2.0 * v2v_random_uniform(29, stream, (uint64_t)i) - 1.0;
        array[i] = (float)(numbers == EXACT ? round(value * 128.0) / 128.0 : value);
    }
    return array;
}

struct layer {
    struct v2v_conv_spec spec;
    enum numbers numbers;
    int64_t inputs, outputs, weights;
    float *in, *dout, *weight, *bias;
};

static struct layer layer_init(const struct v2v_conv_spec *spec, enum numbers numbers)
{
    struct layer l = {.spec = *spec, .numbers = numbers};
    l.inputs = spec->batch * spec->in * spec->height * spec->width;
    l.outputs = spec->batch * spec->out * conv_out_height(spec) * conv_out_width(spec);
    l.weights = spec->in * spec->out * 9;
    l.in = draw(l.inputs, 1, numbers);
    l.dout = draw(l.outputs, 2, numbers);
    l.weight = draw(l.weights, 3, numbers);
    l.bias = draw(spec->out, 4, numbers);
    return l;
}

static void free_all(float *const *owned, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        v2v_mem_free(owned[i]);
    }
}

static void layer_fini(struct layer *l)
{
    free_all((float *[]){l->in, l->dout, l->weight, l->bias}, 4);
}

struct results {
    float *out, *din, *dweight;
};

static struct results compute(const struct layer *l, const struct v2v_conv_backend *backend)
{
    struct v2v_conv *conv = NULL;
    struct results r = {draw(l->outputs, 5, l->numbers), draw(l->inputs, 6, l->numbers),
                        draw(l->weights, 7, l->numbers)};
    assert_ok(v2v_conv_create_with(&conv, &l->spec, backend));
    v2v_conv_set_weights(conv, l->weight, l->bias);
    v2v_conv_forward(conv, r.out, l->in);
    v2v_conv_backward_data(conv, r.din, l->dout);
    v2v_conv_backward_weights(conv, r.dweight, NULL, l->in, l->dout);
    v2v_conv_destroy(&conv);
    return r;
}

static void results_fini(struct results *r)
{
    free_all((float *[]){r->out, r->din, r->dweight}, 3);
}

static void assert_equal(const float *a, const float *b, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        assert_true(a[i] == b[i]);
    }
}

static const struct v2v_conv_spec wide[] = {
    /* two chunks of channels, two groups of outputs, the second of them not whole */
    {1, 300, 150, 21, 37, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
    /* several groups of pixels, an odd last row, and as many channels as one chunk takes */
    {1, 256, 33, 23, 130, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
    /* every other pixel; several strips of the weights' gradient */
    {1, 40, 96, 131, 201, 3, 2, 0.01f, 1, 0, {0}, 0, 0},
    /* smaller than a tile */
    {1, 520, 24, 3, 5, 3, 1, 0.01f, 1, 0, {0}, 0, 0}};

/* No sum is rounded, whatever its order: at most 6666 products of standard deviation 1/3 stay below
 * 2^10, which is 37 of the sum's. Only the slope rounds, once, and alike. */
static void products_beyond_one_group_equal_those_in_float32(void **state)
{
    (void)state;
    skip_without_tiles();
    for (size_t i = 0; i < sizeof wide / sizeof *wide; i++) {
        struct layer l = layer_init(&wide[i], EXACT);
        struct results tiles = compute(&l, &v2v_conv_amx);
        struct results plain = compute(&l, &v2v_conv_openblas);
        assert_equal(tiles.out, plain.out, l.outputs);
        assert_equal(tiles.din, plain.din, l.inputs);
        assert_equal(tiles.dweight, plain.dweight, l.weights);
        results_fini(&tiles);
        results_fini(&plain);
        layer_fini(&l);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void threads_and_strips_do_not_change_a_bit(void **state)
{
    (void)state;
    skip_without_tiles();
    int before = omp_get_max_threads();
    for (size_t i = 0; i < sizeof wide / sizeof *wide; i++) {
        struct layer l = layer_init(&wide[i], ANY);
        v2v_op_set_threads(1);
        struct results one = compute(&l, &v2v_conv_amx);
        for (int threads = 2; threads <= 3; threads++) {
            v2v_op_set_threads(threads);
            struct results more = compute(&l, &v2v_conv_amx);
            assert_memory_equal(one.out, more.out, (size_t)l.outputs * sizeof(float));
            assert_memory_equal(one.din, more.din, (size_t)l.inputs * sizeof(float));
            assert_memory_equal(one.dweight, more.dweight, (size_t)l.weights * sizeof(float));
            results_fini(&more);
        }
        results_fini(&one);
        layer_fini(&l);
    }
    v2v_op_set_threads(before);
}

/* image [channels,y,x] */
static struct v2v_blocked blocked_of(const float *image, const struct v2v_conv_spec *spec)
{
    struct v2v_blocked blocked = {
        .channels = spec->in, .height = spec->height, .width = spec->width};
    int64_t floats = v2v_blocked_floats(spec->in, spec->height, spec->width);
    blocked.data = v2v_mem_alloc("test", floats, sizeof(float));
    assert_non_null(blocked.data);
    for (int64_t place = 0; place < v2v_blocked_count(spec->in) * spec->height; place++) {
        int64_t first = place / spec->height * V2V_BLOCKED_CHANNELS, y = place % spec->height;
        const float *row[V2V_BLOCKED_CHANNELS] = {NULL};
        for (int i = 0; i < V2V_BLOCKED_CHANNELS && first + i < spec->in; i++) {
            row[i] = image + ((first + i) * spec->height + y) * spec->width;
        }
        v2v_blocked_set(&blocked, place / spec->height, y, 0, row, spec->width);
    }
    return blocked;
}

static float *convolved(struct v2v_conv_spec spec, int in_form, int out_form, const float *in,
                        const struct layer *l)
{
    struct v2v_conv *conv = NULL;
    spec.training = 0;
    spec.in_form = in_form;
    spec.out_form = out_form;
    int64_t height = conv_out_height(&spec), width = conv_out_width(&spec);
    int64_t floats = out_form == V2V_FORM_BLOCKED ? v2v_blocked_floats(spec.out, height, width)
                                                  : spec.out * height * width;
    float *out = v2v_mem_alloc("test", floats, sizeof *out);
    assert_non_null(out);
    spec.method.precision = V2V_PRECISION_BF16;
    assert_true(v2v_conv_takes_blocked(&spec));
    assert_ok(v2v_conv_create(&conv, &spec));
    v2v_conv_set_weights(conv, l->weight, l->bias);
    v2v_conv_forward(conv, out, in);
    v2v_conv_destroy(&conv);
    return out;
}

/* An image between two layers is rounded to bf16 either way: by the one that writes it blocked, or
 * by the one that reads it plain. */
static void blocked_images_give_the_bits_of_plain_ones(void **state)
{
    (void)state;
    skip_without_tiles();
    for (size_t i = 0; i < sizeof wide / sizeof *wide; i++) {
        struct layer first = layer_init(&wide[i], EXACT);
        struct v2v_conv_spec next = {1,
                                     wide[i].out,
                                     50,
                                     conv_out_height(&wide[i]),
                                     conv_out_width(&wide[i]),
                                     3,
                                     1,
                                     1.0f,
                                     0,
                                     0,
                                     {0},
                                     0,
                                     0};
        struct layer second = layer_init(&next, EXACT);
        struct v2v_blocked in = blocked_of(first.in, &first.spec);
        float *plain = convolved(first.spec, 0, 0, first.in, &first);
        float *blocked = convolved(first.spec, V2V_FORM_BLOCKED, V2V_FORM_BLOCKED, in.data, &first);
        float *result[] = {convolved(next, 0, 0, plain, &second),
                           convolved(next, V2V_FORM_BLOCKED, 0, blocked, &second)};
        assert_memory_equal(result[0], result[1], (size_t)second.outputs * sizeof(float));
        free_all((float *[]){in.data, plain, blocked, result[0], result[1]}, 5);
        layer_fini(&first);
        layer_fini(&second);
    }
}

static float *convolved_directly(struct v2v_conv_spec spec, int precision, const struct layer *l)
{
    struct v2v_conv *conv = NULL;
    float *out = draw(l->outputs, 5, l->numbers);
    spec.training = 0;
    spec.method.precision = precision;
    assert_ok(v2v_conv_create_with(&conv, &spec, &v2v_conv_direct));
    v2v_conv_set_weights(conv, l->weight, l->bias);
    v2v_conv_forward(conv, out, l->in);
    v2v_conv_destroy(&conv);
    return out;
}

/* Few channels: no sum is rounded, whatever its order. Of numbers that bf16 rounds, both factors
 * of 288 products at most, of root mean square 1/3, are off by 2^-9 of themselves or less: sums
 * scatter by 0.016 or less, of which this allows three. */
static void few_channels_are_multiplied_by_tiles(void **state)
{
    (void)state;
    /* Pairs of channels in one, two and three parts of a tile, the last one beginning early; an odd
     * channel; a run of pixels that is not whole, one pixel beyond one, and less than a vector;
     * more rows than are made at a time; two images */
    static const struct v2v_conv_spec few[] = {{1, 4, 8, 21, 37, 3, 1, 0.01f, 0, 0, {0}, 0, 0},
                                               {1, 8, 8, 3, 65, 3, 1, 1.0f, 0, 0, {0}, 0, 0},
                                               {1, 16, 16, 19, 130, 3, 1, 0.01f, 0, 0, {0}, 0, 0},
                                               {1, 28, 16, 9, 64, 3, 1, 0.01f, 0, 0, {0}, 0, 0},
                                               {2, 32, 14, 8, 5, 3, 1, 0.01f, 0, 0, {0}, 0, 0},
                                               {1, 11, 3, 40, 200, 3, 1, 0.5f, 0, 0, {0}, 0, 0}};
    skip_without_tiles();
    for (size_t i = 0; i < sizeof few / sizeof *few; i++) {
        double apart = 0.0;
        for (int numbers = EXACT; numbers <= ANY; numbers++) {
            struct layer l = layer_init(&few[i], (enum numbers)numbers);
            float *tiles = convolved_directly(few[i], V2V_PRECISION_BF16, &l);
            float *plain = convolved_directly(few[i], V2V_PRECISION_F32, &l);
            for (int64_t k = 0; k < l.outputs; k++) {
                apart = fmax(apart, fabs((double)tiles[k] - (double)plain[k]));
            }
            assert_true(numbers == EXACT ? apart == 0.0 : apart > 0.0 && apart < 0.05);
            free_all((float *[]){tiles, plain}, 2);
            layer_fini(&l);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(products_beyond_one_group_equal_those_in_float32),
        cmocka_unit_test(threads_and_strips_do_not_change_a_bit),
        cmocka_unit_test(blocked_images_give_the_bits_of_plain_ones),
        cmocka_unit_test(few_channels_are_multiplied_by_tiles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
