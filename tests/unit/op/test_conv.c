/* Every backend against plain loops in double precision, over one table of layers. */
#include "op/conv_backend.h"
#include "op/isa.h"
#include "support.h"
#include "twin_conv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/bf16.h"
#include <math.h>
#include <string.h>

/** Channels that are and are not multiples of a vector, odd sizes, one pixel; runs of several
 * strips for each backend (the direct kernel's and the strips of OpenBLAS hold few rows). */
static const struct v2v_conv_spec cases[] = {{1, 1, 4, 37, 21, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {3, 4, 4, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {3, 4, 8, 21, 37, 1, 1, 1.0f, 1, 0, {0}, 0, 0},
                                             {2, 8, 16, 9, 70, 3, 1, 0.05f, 1, 0, {0}, 0, 0},
                                             {1, 28, 16, 13, 33, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {3, 16, 4, 8, 8, 1, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 5, 3, 1, 1, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 3, 7, 2, 5, 3, 1, 0.5f, 1, 0, {0}, 0, 0},
                                             {1, 17, 33, 37, 21, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 32, 48, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 2, 3, 40, 520, 3, 1, 0.01f, 1, 0, {0}, 0, 0},
                                             {3, 16, 8, 16, 16, 3, 2, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 19, 5, 37, 21, 3, 2, 0.01f, 1, 0, {0}, 0, 0},
                                             {2, 6, 6, 12, 7, 1, 2, 0.01f, 1, 0, {0}, 0, 0},
                                             {1, 64, 39, 12, 12, 3, 1, 0.01f, 1, 0, {0}, 0, 0}};

static const struct v2v_conv_backend *const backends[] = {&v2v_conv_direct, &v2v_conv_onednn,
                                                          &v2v_conv_openblas};

struct fixture {
    struct v2v_conv_spec spec;
    int64_t inputs, outputs, weights;
    float *in, *out, *weight, *bias;
    float *result;
    struct twin twin;
    double factor_unit; /**< unit round-off with which what is multiplied is rounded first */
    double image_unit;  /**< and an image that comes out, at the end; 0 for both: not rounded */
};

static float *draw(int64_t count, uint64_t stream)
{
    float *array = v2v_mem_alloc("test", count, sizeof *array);
    assert_non_null(array);
    for (int64_t i = 0; i < count; i++) {
        array[i] = (float)(2.0 * v2v_random_uniform(3, stream, (uint64_t)i) - 1.0);
    }
    return array;
}

static struct fixture fixture_init(const struct v2v_conv_spec *spec)
{
    struct fixture f = {.spec = *spec};
    f.inputs = spec->batch * spec->in * spec->height * spec->width;
    f.outputs = spec->batch * spec->out * conv_out_height(spec) * conv_out_width(spec);
    f.weights = spec->out * spec->in * spec->kernel * spec->kernel;
    int64_t most = f.inputs > f.outputs ? f.inputs : f.outputs;
    most = most > f.weights ? most : f.weights;
    f.in = draw(f.inputs, 1);
    f.out = draw(f.outputs, 2);
    f.weight = draw(f.weights, 3);
    f.bias = draw(spec->out, 4);
    f.result = draw(most, 5);
    f.twin.value = v2v_mem_alloc("test", most, sizeof(double));
    f.twin.moduli = v2v_mem_alloc("test", most, sizeof(double));
    assert_true(f.twin.value != NULL && f.twin.moduli != NULL);
    return f;
}

static void fixture_fini(struct fixture *f)
{
    void *owned[] = {f->in, f->out, f->weight, f->bias, f->result, f->twin.value, f->twin.moduli};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
}

/** A float32 sum of n products in any order, with or without fused multiply-adds, errs by at most
 *  (n + 2) * 2^-24 times the sum of the moduli (Higham, Accuracy and Stability, 3.1; the 2 for
 *  slope and bias). Factors rounded with unit u first: each product errs by (1 + u)^2 - 1 more; a
 *  result rounded with unit w: by w of its modulus more. */
static void assert_close(const struct fixture *f, const char *what, const char *name, int64_t count,
                         int64_t terms, double result_unit)
{
    double u = f->factor_unit;
    double share = (1.0 + u) * (1.0 + u) * (1.0 + (double)(terms + 2) * ldexp(1.0, -24)) - 1.0;
    for (int64_t i = 0; i < count; i++) {
        double bound = share * f->twin.moduli[i];
        bound += result_unit * (fabs(f->twin.value[i]) + bound);
        double error = fabs((double)f->result[i] - f->twin.value[i]);
        if (!(error <= bound)) {
            fail_msg("%s %s, %lld to %lld channels, %lld x %lld, kernel %d stride %d: element %lld "
                     "is %g, twin %g, off by %g, bound %g",
                     name, what, (long long)f->spec.in, (long long)f->spec.out,
                     (long long)f->spec.height, (long long)f->spec.width, f->spec.kernel,
                     f->spec.stride, (long long)i, (double)f->result[i], f->twin.value[i], error,
                     bound);
        }
    }
}

/** The twin's activation: exact in sign away from zero; at a value within rounding of zero both
 *  branches differ by less than the bound. */
static void twin_activate(struct fixture *f)
{
    for (int64_t i = 0; i < f->outputs; i++) {
        double x = f->twin.value[i];
        f->twin.value[i] = x > 0.0 ? x : (double)f->spec.slope * x;
    }
}

typedef void (*check)(struct fixture *f, struct v2v_conv *conv, const char *name);

static void check_forward(struct fixture *f, struct v2v_conv *conv, const char *name)
{
    const struct v2v_conv_spec *s = &f->spec;
    twin_conv_forward(f->twin, s, f->in, f->weight, f->bias);
    twin_activate(f);
    v2v_conv_forward(conv, f->result, f->in);
    assert_close(f, "forward", name, f->outputs, s->in * s->kernel * s->kernel + 1, f->image_unit);
}

static void check_data(struct fixture *f, struct v2v_conv *conv, const char *name)
{
    const struct v2v_conv_spec *s = &f->spec;
    twin_conv_backward_data(f->twin, s, f->out, f->weight);
    v2v_conv_backward_data(conv, f->result, f->out);
    assert_close(f, "data gradient", name, f->inputs, s->out * s->kernel * s->kernel,
                 f->image_unit);
}

/** Gradients are added: the result starts at 1, one more term. */
static void check_weights(struct fixture *f, struct v2v_conv *conv, const char *name)
{
    const struct v2v_conv_spec *s = &f->spec;
    int64_t pixels = conv_out_height(s) * conv_out_width(s);
    float *dbias = draw(s->out, 6);
    float *before = draw(s->out, 6);
    twin_conv_backward_weights(f->twin, s, f->in, f->out);
    for (int64_t i = 0; i < f->weights; i++) {
        f->result[i] = 1.0f;
        f->twin.value[i] += 1.0;
        f->twin.moduli[i] += 1.0;
    }
    v2v_conv_backward_weights(conv, f->result, dbias, f->in, f->out);
    assert_close(f, "weight gradient", name, f->weights, s->batch * pixels + 1, 0.0);
    for (int64_t o = 0; o < s->out; o++) {
        double sum = (double)before[o], moduli = fabs(sum);
        for (int64_t i = 0; i < s->batch * pixels; i++) {
            double term = (double)f->out[(i / pixels * s->out + o) * pixels + i % pixels];
            sum += term;
            moduli += fabs(term);
        }
        double bound = (double)(s->batch * pixels + 2) * ldexp(1.0, -24) * moduli;
        assert_true(fabs((double)dbias[o] - sum) <= bound);
    }
    v2v_mem_free(dbias);
    v2v_mem_free(before);
}

static void run_check(struct fixture *f, check check_one, const struct v2v_conv_backend *backend)
{
    struct v2v_conv *conv = NULL;
    assert_ok(v2v_conv_create_with(&conv, &f->spec, backend));
    v2v_conv_set_weights(conv, f->weight, f->bias);
    check_one(f, conv, backend->name);
    v2v_conv_destroy(&conv);
}

static void for_one(const struct v2v_conv_spec *spec, check check_one)
{
    struct fixture f = fixture_init(spec);
    for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
        if (backends[j] != &v2v_conv_direct || f.spec.stride == 1) {
            run_check(&f, check_one, backends[j]);
        }
    }
    fixture_fini(&f);
}

static void for_all(check check_one)
{
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for_one(&cases[i], check_one);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void forward_matches_plain_loops(void **unused)
{
    (void)unused;
    for_all(check_forward);
}

static void data_gradient_matches_plain_loops(void **unused)
{
    (void)unused;
    for_all(check_data);
}

static void weight_gradient_matches_plain_loops_and_is_added(void **unused)
{
    (void)unused;
    for_all(check_weights);
}

/** A frame so wide that every backend works in several strips, the last of which overlaps: all
 *  must give the twin's figures. (2 + 2) channels * 4 bytes * 320000 columns = 5 MB a row against
 *  oneDNN's 16 MB: strips of 3 rows for 7. */
static void frames_of_several_strips_match_plain_loops(void **unused)
{
    (void)unused;
    static const struct v2v_conv_spec wide = {1, 2, 2, 7, 320000, 3, 1, 0.01f, 1, 0, {0}, 0, 0};
    static const check checks[] = {check_forward, check_data, check_weights};
    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++) {
        for_one(&wide, checks[i]);
    }
}

/** Half a unit in the last place of 8 significant bits. */
static const double bf16_unit = 1.0 / 256.0;

static void round_everything(struct fixture *f)
{
    f->factor_unit = f->image_unit = bf16_unit;
}

/** By oneDNN, and by our own kernel where there are tiles. */
static void for_one_bf16(const struct v2v_conv_spec *spec, check check_one,
                         void (*prepare)(struct fixture *f))
{
    static const struct v2v_conv_backend *const bf16_backends[] = {&v2v_conv_bf16, &v2v_conv_amx};
    for (int i = 0; i < (v2v_amx_usable() ? 2 : 1); i++) {
        struct fixture f = fixture_init(spec);
        prepare(&f);
        run_check(&f, check_one, bf16_backends[i]);
        fixture_fini(&f);
    }
}

static void skip_without_bf16(void)
{
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
}

static void for_all_bf16(check check_one, void (*prepare)(struct fixture *f))
{
    skip_without_bf16();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for_one_bf16(&cases[i], check_one, prepare);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void forward_in_bf16_errs_by_rounding_factors_and_result(void **unused)
{
    (void)unused;
    for_all_bf16(check_forward, round_everything);
}

static void data_gradient_in_bf16_errs_by_rounding_factors_and_result(void **unused)
{
    (void)unused;
    for_all_bf16(check_data, round_everything);
}

static void weight_gradient_in_bf16_errs_by_rounding_factors_alone(void **unused)
{
    (void)unused;
    for_all_bf16(check_weights, round_everything);
}

/** Pixels of half the bytes: twice the columns. */
static void frames_of_several_strips_in_bf16_err_by_rounding(void **unused)
{
    (void)unused;
    static const struct v2v_conv_spec wide = {1, 2, 2, 5, 640000, 3, 1, 0.01f, 1, 0, {0}, 0, 0};
    static const check checks[] = {check_forward, check_data, check_weights};
    skip_without_bf16();
    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++) {
        for_one_bf16(&wide, checks[i], round_everything);
    }
}

/** Nothing is left to round of these factors: 7 bits and the sign. */
static void draw_bf16(struct fixture *f)
{
    float *arrays[] = {f->in, f->out, f->weight};
    const int64_t counts[] = {f->inputs, f->outputs, f->weights};
    for (int i = 0; i < 3; i++) {
        for (int64_t j = 0; j < counts[i]; j++) {
            arrays[i][j] = roundf(arrays[i][j] * 128.0f) / 128.0f;
        }
    }
    f->image_unit = bf16_unit;
}

static void sums_in_bf16_are_float32(void **unused)
{
    (void)unused;
    static const check checks[] = {check_forward, check_data, check_weights};
    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++) {
        for_all_bf16(checks[i], draw_bf16);
    }
}

/** din is overwritten whatever it held and taken back through the activation before it, dweight and
 *  dbias are added to, or set. */
static void all_gradients_at_once_are_those_one_by_one(void **state)
{
    (void)state;
    static const float SLOPE = 0.25f;
    enum { BATCH = 2, IN = 5, OUT = 7, SIDE = 10, WEIGHTS = OUT * IN * 9 };
    static const struct v2v_conv_backend *const all[] = {&v2v_conv_direct, &v2v_conv_onednn,
                                                         &v2v_conv_openblas, &v2v_conv_winograd};
    struct v2v_workspace workspace = {0};
    for (size_t i = 0; i < 2 * sizeof all / sizeof *all; i++) {
        int upsample = i % 2 == 1;
        int64_t inputs = BATCH * IN * (SIDE >> upsample) * (SIDE >> upsample);
        struct v2v_conv_spec spec = {BATCH,
                                     IN,
                                     OUT,
                                     SIDE,
                                     SIDE,
                                     3,
                                     1,
                                     1,
                                     1,
                                     upsample,
                                     {.winograd = 1, .workspace = &workspace},
                                     0,
                                     0};
        float *in = draw(inputs, 1), *dout = draw(BATCH * OUT * SIDE * SIDE, 2);
        float *weight = draw(WEIGHTS, 3), *bias = draw(OUT, 4);
        float *din[] = {draw(inputs, 5), draw(inputs, 6)};
        float *dweight[] = {draw(WEIGHTS, 7), draw(WEIGHTS, 7)};
        float *dbias[] = {draw(OUT, 8), draw(OUT, 8)};
        struct v2v_conv *conv = NULL;
        assert_ok(v2v_conv_create_with(&conv, &spec, all[i / 2]));
        v2v_conv_set_weights(conv, weight, bias);
        struct v2v_gradients to = {
            .din = din[0], .dweight = dweight[0], .dbias = dbias[0], .in_slope = SLOPE};
        v2v_conv_backward(conv, &to, in, dout);
        v2v_conv_backward_weights(conv, dweight[1], dbias[1], in, dout);
        v2v_conv_backward_data(conv, din[1], dout);
        v2v_leaky_backward(din[1], din[1], in, inputs, SLOPE);
        assert_memory_equal(din[0], din[1], (size_t)inputs * sizeof *in);
        assert_memory_equal(dweight[0], dweight[1], WEIGHTS * sizeof *in);
        assert_memory_equal(dbias[0], dbias[1], OUT * sizeof *in);
        to.sets = 1; /* whatever is left there: as added to zeros */
        memset(dweight[1], 0, WEIGHTS * sizeof *in);
        memset(dbias[1], 0, OUT * sizeof *in);
        v2v_conv_backward(conv, &to, in, dout);
        v2v_conv_backward_weights(conv, dweight[1], dbias[1], in, dout);
        assert_memory_equal(dweight[0], dweight[1], WEIGHTS * sizeof *in);
        assert_memory_equal(dbias[0], dbias[1], OUT * sizeof *in);
        float *owned[] = {in,     dout,       weight,     bias,     din[0],
                          din[1], dweight[0], dweight[1], dbias[0], dbias[1]};
        for (size_t k = 0; k < sizeof owned / sizeof *owned; k++) {
            v2v_mem_free(owned[k]);
        }
        v2v_conv_destroy(&conv);
    }
    v2v_workspace_fini(&workspace);
    assert_int_equal(v2v_mem_held(), 0);
}

static void fused_activation_is_the_separate_one(void **unused)
{
    (void)unused;
    for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
        struct fixture f = fixture_init(&cases[1]);
        struct v2v_conv *fused = NULL, *bare = NULL;
        assert_ok(v2v_conv_create_with(&fused, &f.spec, backends[j]));
        f.spec.slope = 1.0f;
        assert_ok(v2v_conv_create_with(&bare, &f.spec, backends[j]));
        v2v_conv_set_weights(fused, f.weight, f.bias);
        v2v_conv_set_weights(bare, f.weight, f.bias);
        v2v_conv_forward(fused, f.result, f.in);
        v2v_conv_forward(bare, f.out, f.in);
        v2v_leaky_forward(f.out, f.out, f.outputs, cases[1].slope);
        assert_memory_equal(f.result, f.out, (size_t)f.outputs * sizeof(float));
        v2v_conv_destroy(&fused);
        v2v_conv_destroy(&bare);
        fixture_fini(&f);
    }
}

static void
few_channels_take_the_direct_kernel_many_tiles_winograd_others_the_backend(void **unused)
{
    (void)unused;
    struct v2v_conv_spec spec = cases[1];
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_direct);
    spec.stride = 2;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_onednn);
    spec.method.backend = V2V_BACKEND_OPENBLAS;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_openblas);
    spec = (struct v2v_conv_spec){
        .batch = 1, .in = 1024, .out = 512, .height = 128, .width = 128, .kernel = 3, .stride = 1};
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_onednn);
    spec.method.winograd = 1;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_winograd);
    spec.height = spec.width = 8;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_onednn);
}

static void bf16_takes_large_layers_of_3_x_3_alone(void **unused)
{
    (void)unused;
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = 64,
                                 .out = 32,
                                 .height = 64,
                                 .width = 64,
                                 .kernel = 3,
                                 .stride = 2,
                                 .method.precision = V2V_PRECISION_BF16};
    const struct v2v_conv_backend *chosen = v2v_amx_usable() ? &v2v_conv_amx : &v2v_conv_bf16;
    assert_ptr_equal(v2v_conv_choose(&spec), chosen);
    spec.method.backend = V2V_BACKEND_OPENBLAS;
    assert_ptr_equal(v2v_conv_choose(&spec), chosen);
    spec.kernel = 1;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_openblas);
    spec.kernel = 3;
    spec.stride = 1;
    spec.in = spec.out = 16;
    assert_ptr_equal(v2v_conv_choose(&spec), &v2v_conv_direct);
}

static void check_nan(struct fixture *f, struct v2v_conv *conv, const char *name)
{
    (void)name;
    f->in[0] = NAN;
    v2v_conv_forward(conv, f->result, f->in);
    assert_true(isnan(f->result[0]));
}

static void a_nan_in_the_input_is_seen_in_the_output(void **unused)
{
    (void)unused;
    for_one(&cases[1], check_nan);
}

static void a_nan_in_the_input_is_seen_in_the_output_in_bf16(void **unused)
{
    (void)unused;
    for_all_bf16(check_nan, round_everything);
}

static void sizes_that_overflow_are_refused(void **unused)
{
    (void)unused;
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = cases[0];
    spec.height = INT64_MAX / 2;
    assert_int_equal(v2v_conv_create(&conv, &spec), V2V_E_INTERNAL);
    assert_null(conv);
}

static void too_little_memory_is_a_failure_that_leaves_nothing_behind(void **unused)
{
    (void)unused;
    for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
        struct v2v_conv *conv = NULL;
        enum v2v_status status = V2V_E_MEMORY;
        size_t limit = 256;
        for (; limit < (size_t)1 << 30 && status == V2V_E_MEMORY; limit *= 2) {
            v2v_mem_set_limit(limit);
            status = v2v_conv_create_with(&conv, &cases[1], backends[j]);
            assert_true(status == V2V_OK || v2v_mem_held() == 0);
        }
        v2v_mem_set_limit(0);
        assert_int_equal(status, V2V_OK);
        assert_true(limit > 1024);
        v2v_conv_destroy(&conv);
        assert_int_equal(v2v_mem_held(), 0);
    }
}

/** The example of include/v2v3d/op/conv.h. */
static enum v2v_status example(float *out, const float *in, const float *weight, const float *bias)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = 8,
                                 .out = 16,
                                 .height = 64,
                                 .width = 64,
                                 .kernel = 3,
                                 .stride = 1,
                                 .slope = 0.01f,
                                 .training = 1};
    V2V_TRY(v2v_conv_create(&conv, &spec));
    v2v_conv_set_weights(conv, weight, bias);
    v2v_conv_forward(conv, out, in);
done:
    v2v_conv_destroy(&conv);
    return rc;
}

static void the_example_of_the_header_runs(void **unused)
{
    (void)unused;
    float *in = draw(8 * 64 * 64, 1), *weight = draw(16 * 8 * 9, 2), *bias = draw(16, 3);
    float *out = draw(16 * 64 * 64, 4);
    memset(in, 0, 8 * 64 * 64 * sizeof *in);
    assert_ok(example(out, in, weight, bias));
    float expected = bias[5] > 0.0f ? bias[5] : 0.01f * bias[5];
    assert_true(out[5 * 64 * 64 + 100] == expected);
    float *owned[] = {in, weight, bias, out};
    for (size_t i = 0; i < 4; i++) {
        v2v_mem_free(owned[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_matches_plain_loops),
        cmocka_unit_test(data_gradient_matches_plain_loops),
        cmocka_unit_test(weight_gradient_matches_plain_loops_and_is_added),
        cmocka_unit_test(frames_of_several_strips_match_plain_loops),
        cmocka_unit_test(forward_in_bf16_errs_by_rounding_factors_and_result),
        cmocka_unit_test(data_gradient_in_bf16_errs_by_rounding_factors_and_result),
        cmocka_unit_test(weight_gradient_in_bf16_errs_by_rounding_factors_alone),
        cmocka_unit_test(frames_of_several_strips_in_bf16_err_by_rounding),
        cmocka_unit_test(sums_in_bf16_are_float32),
        cmocka_unit_test(bf16_takes_large_layers_of_3_x_3_alone),
        cmocka_unit_test(all_gradients_at_once_are_those_one_by_one),
        cmocka_unit_test(fused_activation_is_the_separate_one),
        cmocka_unit_test(
            few_channels_take_the_direct_kernel_many_tiles_winograd_others_the_backend),
        cmocka_unit_test(a_nan_in_the_input_is_seen_in_the_output),
        cmocka_unit_test(a_nan_in_the_input_is_seen_in_the_output_in_bf16),
        cmocka_unit_test(sizes_that_overflow_are_refused),
        cmocka_unit_test(too_little_memory_is_a_failure_that_leaves_nothing_behind),
        cmocka_unit_test(the_example_of_the_header_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
