/* U-Nets against plain loops in double precision. */
#include "small_unet.h"

#include "v2v3d/conf/config.h"
#include "v2v3d/op/gemm.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- the twin ---- */

/* [depth,channels,y,x] */
struct images {
    int64_t depth, channels, height, width;
    double *data;
};

static struct images images_of(int64_t depth, int64_t channels, int64_t height, int64_t width)
{
    const struct images new = {
        depth, channels, height, width,
        v2v_mem_alloc("test", depth * channels * height * width, sizeof(double))};
    assert_non_null(new.data);
    return new;
}

static double *at(const struct images *a, int64_t d, int64_t c, int64_t y, int64_t x)
{
    return &a->data[((d * a->channels + c) * a->height + y) * a->width + x];
}

static double sample(const struct images *a, int64_t d, int64_t c, int64_t y, int64_t x)
{
    const int is_outside =
        d < 0 || d >= a->depth || y < 0 || y >= a->height || x < 0 || x >= a->width;
    return is_outside ? 0.0 : *at(a, d, c, y, x);
}

static const float *named(const struct small_unet *u, const char *layer, const char *what)
{
    char name[64];
    snprintf(name, sizeof name, "net.%s.%s", layer, what);
    const struct v2v_fields_item *field = v2v_fields_find(&u->fields, name);
    assert_non_null(field);
    return u->parameters.weights + field->offset;
}

/* `in` is taken. Kernels are `deep` images deep and `side` pixels wide. */
static struct images convolve(struct images in, const struct small_unet *u, const char *layer,
                              int64_t out, int64_t side, double slope)
{
    const struct images result = images_of(in.depth, out, in.height, in.width);
    const float *weight = named(u, layer, "weight"), *bias = named(u, layer, "bias");
    const int64_t deep = u->size->spec.is_deep && side == 3 ? 3 : 1;
    for (int64_t i = 0; i < in.depth * out * in.height * in.width; i++) {
        const int64_t x = i % in.width, y = i / in.width % in.height;
        const int64_t o = i / in.width / in.height % out, d = i / in.width / in.height / out;
        const float *w = weight + o * deep * in.channels * side * side;
        double sum = (double)bias[o];
        for (int64_t k = 0; k < deep; k++) {
            for (int64_t c = 0; c < in.channels; c++) {
                for (int64_t t = 0; t < side * side; t++) {
                    sum += (double)*w++ * sample(&in, d + k - deep / 2, c, y + t / side - side / 2,
                                                 x + t % side - side / 2);
                }
            }
        }
        result.data[i] = sum > 0.0 ? sum : slope * sum;
    }
    v2v_mem_free(in.data);
    return result;
}

static struct images pool(const struct images *in, int64_t deep)
{
    const struct images result =
        images_of(in->depth / deep, in->channels, in->height / 2, in->width / 2);
    for (int64_t i = 0; i < in->depth * in->channels * in->height * in->width; i++) {
        const int64_t x = i % in->width, y = i / in->width % in->height;
        const int64_t plane = i / in->width / in->height;
        const int64_t c = plane % in->channels, d = plane / in->channels;
        double *to = at(&result, d / deep, c, y / 2, x / 2);
        const int is_first = x % 2 == 0 && y % 2 == 0 && d % deep == 0;
        *to = is_first ? in->data[i] : fmax(*to, in->data[i]);
    }
    return result;
}

/* [skip, below repeated]; both are taken. */
static struct images join(struct images skip, struct images below, int64_t deep)
{
    const struct images result =
        images_of(skip.depth, skip.channels + below.channels, skip.height, skip.width);
    for (int64_t d = 0; d < result.depth; d++) {
        for (int64_t c = 0; c < result.channels; c++) {
            for (int64_t i = 0; i < skip.height * skip.width; i++) {
                const int64_t y = i / skip.width, x = i % skip.width;
                *at(&result, d, c, y, x) =
                    c < skip.channels ? *at(&skip, d, c, y, x)
                                      : *at(&below, d / deep, c - skip.channels, y / 2, x / 2);
            }
        }
    }
    v2v_mem_free(skip.data);
    v2v_mem_free(below.data);
    return result;
}

static struct images two(struct images in, const struct small_unet *u, const char *way, int level)
{
    for (int k = 0; k < 2; k++) {
        char name[16];
        snprintf(name, sizeof name, "%s%d.%d", way, level, k);
        in = convolve(in, u, name, u->size->spec.width << level, 3,
                      u->size->spec.slope > 0.0f ? (double)u->size->spec.slope : 0.01);
    }
    return in;
}

/* From level `level` on down, and back up to it. */
static struct images descend(struct images in, const struct small_unet *u, int level)
{
    const int64_t deep = u->size->spec.is_deep ? 2 : 1;
    struct images out = two(in, u, "down", level);
    if (level < u->size->spec.levels - 1) {
        struct images below = descend(pool(&out, deep), u, level + 1);
        out = two(join(out, below, deep), u, "up", level);
    }
    return out;
}

/* Terms of a sum in a layer, added over the layers: rounding errors add up in squares. */
static double terms_of(const struct v2v_fields *fields)
{
    double terms = 0.0;
    for (int64_t i = 0; i < fields->count; i++) {
        terms += (double)fields->item[i].count / (double)fields->item[i].shape[0];
    }
    return terms;
}

static void assert_as_twin(const struct small_unet *u)
{
    struct images in = images_of(u->size->depth, u->size->spec.in, u->size->height, u->size->width);
    for (int64_t i = 0; i < u->ins; i++) {
        in.data[i] = (double)u->in[i];
    }
    struct images out = convolve(descend(in, u, 0), u, "last", u->size->spec.out, 1, 1.0);
    const double error = test_relative_l2_to_double(u->out, out.data, u->outs);
    print_message("%d levels, %s: %.1e\n", u->size->spec.levels,
                  u->size->spec.is_deep ? "deep" : "flat", error);
    assert_true(error <= test_rounding(terms_of(&u->fields)));
    v2v_mem_free(out.data);
}

/* ---- tests ---- */

static const struct small_unet_size sizes[] = {
    {{3, 2, 4, 1, 0, 0.0f}, 2, 5, 7, 0, 0},   {{3, 2, 4, 1, 1, 0.0f}, 3, 5, 7, 0, 0},
    {{2, 3, 5, 2, 0, 0.2f}, 3, 6, 10, 0, 0},  {{2, 3, 5, 2, 1, 0.2f}, 2, 6, 10, 0, 0},
    {{13, 5, 3, 3, 0, 0.0f}, 1, 12, 8, 0, 0}, {{1, 1, 3, 3, 1, 0.0f}, 8, 12, 8, 0, 0},
    {{1, 1, 3, 3, 1, 0.0f}, 4, 8, 4, 1, 0},   {{2, 3, 32, 2, 0, 0.0f}, 2, 16, 24, 0, 1},
    {{2, 3, 32, 2, 1, 0.0f}, 2, 16, 24, 0, 1}};
enum { SIZES = sizeof sizes / sizeof *sizes, DEEP = 5 };

/* At small widths and at those where Winograd computes. */
static void u_nets_are_what_plain_loops_compute(void **state)
{
    (void)state;
    for (int i = 0; i < SIZES; i++) {
        for (int training = V2V_TRAINING_OFF; training <= V2V_TRAINING_KEEPS; training++) {
            struct small_unet u;
            small_unet_make(&u, &sizes[i], training);
            v2v_plain_unet_forward(u.unet, u.out, u.in);
            assert_as_twin(&u);
            small_unet_drop(&u);
        }
    }
}

/* The first convolution takes the image before, the second the image after, the last layer
 * doubles and adds one; beyond the ends there is nothing. */
static void a_deep_kernel_begins_with_the_image_before(void **state)
{
    (void)state;
    enum { CENTRE = 4, BEFORE = 0, AFTER = 18, DEPTH = 3, PIXELS = 6 };
    static const struct small_unet_size size = {{1, 1, 1, 1, 1, 0.0f}, DEPTH, 2, 3, 0, 0};
    struct small_unet u;
    small_unet_make(&u, &size, V2V_TRAINING_OFF);
    memset(u.parameters.weights, 0, (size_t)u.fields.total * sizeof(float));
    for (int64_t i = 1; i < u.fields.count; i++) {
        float *w = v2v_parameter(&u.fields, u.parameters.weights, i);
        if (i == 1) {
            w[BEFORE + CENTRE] = 1.0f;
        } else if (i == 3) {
            w[AFTER + CENTRE] = 1.0f;
        } else if (i >= 5) {
            w[0] = i == 5 ? 2.0f : 1.0f;
        }
    }
    for (int64_t i = 0; i < u.ins; i++) {
        u.in[i] = (float)(i + 1);
    }
    v2v_plain_unet_weights_changed(u.unet, &u.parameters);
    v2v_plain_unet_forward(u.unet, u.out, u.in);
    for (int64_t i = 0; i < u.outs; i++) {
        assert_true(u.out[i] == (i < (DEPTH - 1) * PIXELS ? 2.0f * (float)(i + 1) + 1.0f : 1.0f));
    }
    small_unet_drop(&u);
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    enum { MOST = 1 << 19 };
    static float out[MOST], gradients[MOST];
    (void)state;
    for (int is_deep = 0; is_deep < 2; is_deep++) {
        for (int threads = 1; threads <= 3; threads++) {
            const struct small_unet_size size = {{3, 2, 16, 3, is_deep, 0.0f}, 4, 32, 24,
                                                 V2V_BACKEND_ONEDNN,           1};
            struct small_unet u;
            v2v_op_set_threads(threads);
            small_unet_make(&u, &size, V2V_TRAINING_LEAN);
            for (int pass = 0; pass < 2; pass++) { /* what the first left changes nothing */
                v2v_plain_unet_forward(u.unet, u.out, u.in);
                v2v_plain_unet_backward(u.unet, &u.parameters, u.dout);
            }
            assert_true(u.outs <= MOST && u.fields.total <= MOST);
            if (threads == 1) {
                memcpy(out, u.out, (size_t)u.outs * sizeof(float));
                memcpy(gradients, u.parameters.gradients, (size_t)u.fields.total * sizeof(float));
            }
            assert_memory_equal(out, u.out, (size_t)u.outs * sizeof(float));
            assert_memory_equal(gradients, u.parameters.gradients,
                                (size_t)u.fields.total * sizeof(float));
            small_unet_drop(&u);
        }
    }
    v2v_op_set_threads(1);
}

/* What backward told of. */
struct told {
    const float *gradients;
    float *seen;
    int64_t end; /* the first float told of last */
};

static void listen(void *context, int64_t first, int64_t count)
{
    struct told *told = context;
    assert_int_equal(first + count, told->end);
    memcpy(told->seen + first, told->gradients + first, (size_t)count * sizeof(float));
    told->end = first;
}

static void layers_are_told_of_once_from_the_last_with_their_gradients(void **state)
{
    (void)state;
    struct small_unet u;
    small_unet_make(&u, &sizes[DEEP], V2V_TRAINING_LEAN);
    struct told told = {.gradients = u.parameters.gradients,
                        .seen = small_draw(u.fields.total, 1, 1.0),
                        .end = u.fields.total};
    u.parameters.ready = listen;
    u.parameters.context = &told;
    v2v_plain_unet_forward(u.unet, u.out, u.in);
    v2v_plain_unet_backward(u.unet, &u.parameters, u.dout);
    const int64_t first = u.fields.item[1].offset;
    assert_int_equal(told.end, first);
    assert_memory_equal(told.seen + first, u.parameters.gradients + first,
                        (size_t)(u.fields.total - first) * sizeof(float));
    v2v_mem_free(told.seen);
    small_unet_drop(&u);
}

static void nothing_is_taken_in_a_pass_and_the_bytes_are_those_of_the_plan(void **state)
{
    (void)state;
    const struct small_unet_size *size = &sizes[DEEP];
    for (int training = 0; training < 2; training++) {
        struct small_unet u;
        small_unet_make(&u, &sizes[DEEP], training);
        const size_t held = v2v_mem_held(), peak = v2v_mem_peak();
        v2v_plain_unet_forward(u.unet, u.out, u.in);
        if (training) {
            v2v_plain_unet_backward(u.unet, &u.parameters, u.dout);
        }
        assert_true(v2v_mem_held() == held && v2v_mem_peak() == peak);
        const int64_t bytes =
            v2v_plain_unet_bytes(&size->spec, size->depth, size->height, size->width, training);
        v2v_plain_unet_destroy(&u.unet);
        assert_true(bytes > 0 && (size_t)bytes <= held - v2v_mem_held());
        small_unet_drop(&u);
    }
    const struct v2v_plain_unet_spec huge = {1, 1, 1 << 20, 6, 1, 0.0f};
    assert_int_equal(v2v_plain_unet_bytes(&huge, 1 << 20, 1 << 20, 1 << 20, 1), INT64_MAX);
    assert_int_equal(v2v_plain_unet_unit(&huge), 32);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(u_nets_are_what_plain_loops_compute),
        cmocka_unit_test(a_deep_kernel_begins_with_the_image_before),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
        cmocka_unit_test(layers_are_told_of_once_from_the_last_with_their_gradients),
        cmocka_unit_test(nothing_is_taken_in_a_pass_and_the_bytes_are_those_of_the_plan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
