/* How the error of a convolution grows with the number of terms of its sums: Winograd
 * F(4 x 4, 3 x 3) beside the kernels that add products one by one, all against plain loops in
 * double precision, forward and both gradients.
 *
 * The bound is that of independent roundings. A sum of n products of independent numbers has the
 * variance n s^2; a rounding behind its k-th term errs by at most u = 2^-24 of a sum of variance
 * k s^2; n of them leave, relative to the result, u sqrt((n + 1) / 2), in whatever order.
 * Winograd has n = channels (tiles for the weight gradient), but the products behind its
 * transforms are larger than what becomes of them: by `amplification`, see there. Beside the sum,
 * six transforms along an axis round their values at most 4 times each. */
#include "op/conv_backend.h"
#include "support.h"
#include "twin_conv.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>

enum { THIN = 8, SIDE = 12, TAPS = 9, TILE = 4, POINTS = 6, KERNEL = 3 };
enum { TRANSFORM_ROUNDINGS = 6 * 4 };

static const double unit = 0x1p-24;

static const struct v2v_conv_backend *const backends[] = {&v2v_conv_direct, &v2v_conv_onednn,
                                                          &v2v_conv_openblas, &v2v_conv_winograd};
enum { BACKENDS = sizeof backends / sizeof *backends, WINOGRAD = BACKENDS - 1 };

static const int64_t depths[] = {16, 64, 256, 1024, 4096};
enum { DEPTHS = sizeof depths / sizeof *depths, JUDGED = 2 /* 256 */ };

/* ---- the transforms: points 0, 1, -1, 2, -2, infinity ---- */

struct transforms {
    double output[POINTS][TILE];   /* y = sum_p output[p][y] * product[p] */
    double input[POINTS][POINTS];  /* of six pixels */
    double filter[POINTS][KERNEL]; /* of three taps */
};

static const struct transforms exact = {
    .output =
        {{1, 0, 0, 0}, {1, 1, 1, 1}, {1, -1, 1, -1}, {1, 2, 4, 8}, {1, -2, 4, -8}, {0, 0, 0, 1}},
    .input = {{4, 0, -5, 0, 1, 0},
              {0, -4, -4, 1, 1, 0},
              {0, 4, -4, -1, 1, 0},
              {0, -2, -1, 2, 1, 0},
              {0, 2, -1, -2, 1, 0},
              {0, 4, 0, -5, 0, 1}},
    .filter = {{1 / 4.0, 0, 0},
               {-1 / 6.0, -1 / 6.0, -1 / 6.0},
               {-1 / 6.0, 1 / 6.0, -1 / 6.0},
               {1 / 24.0, 1 / 12.0, 1 / 6.0},
               {1 / 24.0, -1 / 12.0, 1 / 6.0},
               {0, 0, 1}},
};

static double squares(const double *x, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        sum += x[i] * x[i];
    }
    return sum;
}

/* Size of what comes out when the values at the points err independently by the same fraction,
 * relative to that fraction of the result: along one axis, for independent pixels and taps, the
 * root of sum_p |output_p|^2 |input_p|^2 |filter_p|^2 over the 4 outputs of 3 terms each; the same
 * along the other. The trilinear form makes it the same for both gradients. */
static double amplification(void)
{
    double sum = 0.0;
    for (int p = 0; p < POINTS; p++) {
        sum += squares(exact.output[p], TILE) * squares(exact.input[p], POINTS) *
               squares(exact.filter[p], KERNEL);
    }
    return sum / (TILE * KERNEL);
}

/* What the transforms make of pixel j and tap k in output y: 1 where j = y + k, else 0. */
static double weight_of(const struct transforms *t, int y, int j, int k)
{
    double sum = 0.0;
    for (int p = 0; p < POINTS; p++) {
        sum += t->output[p][y] * t->input[p][j] * t->filter[p][k];
    }
    return sum;
}

/* Relative error of filtering along both axes by `t`, for independent pixels and taps: with
 * e = weight - exact weight along one axis, both axes together err by e x 1 + 1 x e + e x e. */
static double error_of(const struct transforms *t)
{
    double inner = 0.0, square = 0.0, norm = TILE * KERNEL;
    for (int i = 0; i < TILE * POINTS * KERNEL; i++) {
        int y = i / (POINTS * KERNEL), j = i / KERNEL % POINTS, k = i % KERNEL;
        double truth = j == y + k ? 1.0 : 0.0, e = weight_of(t, y, j, k) - truth;
        inner += e * truth;
        square += e * e;
    }
    double both =
        2.0 * square * norm + 2.0 * inner * inner + 4.0 * square * inner + square * square;
    return sqrt(both) / norm;
}

static double plain_bound(int64_t terms)
{
    return unit * sqrt(((double)terms + 1.0) / 2.0);
}

static double winograd_bound(int64_t terms)
{
    return amplification() * (plain_bound(terms) + unit * sqrt(TRANSFORM_ROUNDINGS));
}

/* ---- what is computed ---- */

enum what { FORWARD, DATA, WEIGHTS };

static const char *const name_of[] = {"forward: channels", "data gradient: channels",
                                      "weight gradient: pixels"};

/* Terms of the sums of every kind: `depth` times the taps of a filter, or the pixels alone. */
static int64_t terms_of(enum what what, int64_t depth)
{
    return what == WEIGHTS ? depth : depth * TAPS;
}

static int64_t winograd_terms_of(enum what what, int64_t depth)
{
    return what == WEIGHTS ? depth / (TILE * TILE) : depth;
}

struct problem {
    struct v2v_conv_spec spec;
    struct v2v_workspace workspace;
    int64_t in_floats, out_floats, weights;
    float *in, *out, *weight, *bias;
    float *result; /* room for the largest */
    double *twin;
};

static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)v2v_random_normal(53, stream, (uint64_t)i);
    }
    return x;
}

static void problem_init(struct problem *p, enum what what, int64_t depth)
{
    int64_t side = what == WEIGHTS ? (int64_t)sqrt((double)depth) : SIDE;
    *p = (struct problem){.spec = {.batch = 1,
                                   .in = what == FORWARD ? depth : THIN,
                                   .out = what == DATA ? depth : THIN,
                                   .height = side,
                                   .width = side,
                                   .kernel = KERNEL,
                                   .stride = 1,
                                   .slope = 1.0f,
                                   .training = 1}};
    p->in_floats = p->spec.in * side * side;
    p->out_floats = p->spec.out * side * side;
    p->weights = p->spec.in * p->spec.out * TAPS;
    int64_t most = p->in_floats > p->out_floats ? p->in_floats : p->out_floats;
    most = most > p->weights ? most : p->weights;
    p->in = draw(p->in_floats, 1);
    p->out = draw(p->out_floats, 2);
    p->weight = draw(p->weights, 3);
    assert_ok(V2V_ALLOC(p->bias, "test", p->spec.out));
    assert_ok(V2V_ALLOC(p->result, "test", most));
    assert_ok(V2V_ALLOC(p->twin, "test", most));
}

static void problem_fini(struct problem *p)
{
    void *memory[] = {p->in, p->out, p->weight, p->bias, p->result, p->twin};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_workspace_fini(&p->workspace);
    assert_int_equal(v2v_mem_held(), 0);
}

/* The twin's result; how many numbers it has. */
static int64_t compute_twin(struct problem *p, enum what what)
{
    struct twin twin = {p->twin, NULL};
    switch (what) {
    case FORWARD:
        twin_conv_forward(twin, &p->spec, p->in, p->weight, p->bias);
        return p->out_floats;
    case DATA:
        twin_conv_backward_data(twin, &p->spec, p->out, p->weight);
        return p->in_floats;
    default:
        twin_conv_backward_weights(twin, &p->spec, p->in, p->out);
        return p->weights;
    }
}

static double error_by(struct problem *p, const struct v2v_conv_backend *backend, enum what what,
                       int64_t count)
{
    struct v2v_conv *conv = NULL;
    float dbias[4096] = {0};
    p->spec.method.workspace = &p->workspace;
    assert_ok(v2v_conv_create_with(&conv, &p->spec, backend));
    v2v_conv_set_weights(conv, p->weight, p->bias);
    for (int64_t i = 0; i < count; i++) {
        p->result[i] = 0.0f;
    }
    if (what == FORWARD) {
        v2v_conv_forward(conv, p->result, p->in);
    } else if (what == DATA) {
        v2v_conv_backward_data(conv, p->result, p->out);
    } else {
        v2v_conv_backward_weights(conv, p->result, dbias, p->in, p->out);
    }
    v2v_conv_destroy(&conv);
    return test_relative_l2_to_double(p->result, p->twin, count);
}

static void check(enum what what)
{
    print_message("%-24s %9s %9s %9s %9s | %9s %9s\n", name_of[what], backends[0]->name,
                  backends[1]->name, backends[2]->name, backends[3]->name, "bound", "Winograd's");
    for (int d = 0; d < DEPTHS; d++) {
        struct problem p;
        double error[BACKENDS];
        double plain = plain_bound(terms_of(what, depths[d]));
        double winograd = winograd_bound(winograd_terms_of(what, depths[d]));
        problem_init(&p, what, depths[d]);
        int64_t count = compute_twin(&p, what);
        for (int b = 0; b < BACKENDS; b++) {
            error[b] = error_by(&p, backends[b], what, count);
        }
        print_message("%24lld %9.1e %9.1e %9.1e %9.1e | %9.1e %9.1e\n", (long long)depths[d],
                      error[0], error[1], error[2], error[3], plain, winograd);
        for (int b = 0; b < BACKENDS; b++) {
            assert_true(error[b] <= (b == WINOGRAD ? winograd : plain));
        }
        problem_fini(&p);
    }
}

static void forward_errs_as_independent_roundings_do(void **state)
{
    (void)state;
    check(FORWARD);
}

static void data_gradient_errs_as_independent_roundings_do(void **state)
{
    (void)state;
    check(DATA);
}

static void weight_gradient_errs_as_independent_roundings_do(void **state)
{
    (void)state;
    check(WEIGHTS);
}

/* The bound is of use only if it is below what a wrong constant would do: every entry of the three
 * matrices, 1e-4 off, along both axes. Ones are no constants of the code. */
static void a_constant_off_by_1e_4_would_break_the_bound_at_256_channels(void **state)
{
    (void)state;
    double least = 1.0, bound = winograd_bound(depths[JUDGED]);
    struct transforms broken = exact;
    double *entry = &broken.output[0][0];
    assert_true(error_of(&exact) <= 1e-15);
    for (size_t i = 0; i < sizeof broken / sizeof *entry; i++) {
        double value = entry[i];
        if (value != 0.0 && fabs(value) != 1.0) {
            entry[i] = value * (1.0 + 1e-4);
            double error = error_of(&broken);
            least = error < least ? error : least;
            entry[i] = value;
        }
    }
    print_message("transforms amplify by %.1f; a constant off by 1e-4 costs at least %.1e, the "
                  "bound at %lld channels is %.1e\n",
                  amplification(), least, (long long)depths[JUDGED], bound);
    assert_true(least > bound);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forward_errs_as_independent_roundings_do),
        cmocka_unit_test(data_gradient_errs_as_independent_roundings_do),
        cmocka_unit_test(weight_gradient_errs_as_independent_roundings_do),
        cmocka_unit_test(a_constant_off_by_1e_4_would_break_the_bound_at_256_channels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
