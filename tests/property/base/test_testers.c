/* The testers of adjoints and gradients, on functions so small that they are plain: right ones
 * pass, each of a table of wrong ones fails. */
#include "adjoint.h"
#include "gradient.h"
#include "support.h"
#include "v2v3d/base/random.h"
#include <math.h>
#include <string.h>

enum { IN = 4, HIDDEN = 5, OUT = 6, MODULI = 2000 };
enum { X, W1, B1, W2, B2, ARGUMENTS };

/* What is done to element `element` (-1: all) of argument or matrix `of` after it is computed. */
struct mutant {
    const char *name;
    int of, element;
    float factor;
};

/* y = W2 leaky(W1 x + b1) + b2; and m = sum of moduli */
struct network {
    float x[IN], w1[HIDDEN * IN], b1[HIDDEN], w2[OUT * HIDDEN], b2[OUT], m[MODULI];
    float dx[IN], dw1[HIDDEN * IN], db1[HIDDEN], dw2[OUT * HIDDEN], db2[OUT], dm[MODULI];
    const struct mutant *mutant;
};

static void fill(float *x, int count, int stream)
{
    for (int i = 0; i < count; i++) {
        x[i] = (float)(2.0 * v2v_random_uniform(6, (uint64_t)stream, (uint64_t)i) - 1.0);
    }
}

/* Moduli of W1 x are at most 4 and those of b1 5: all that is near is on the same side. */
static void network_init(struct network *n, const struct mutant *mutant)
{
    *n = (struct network){.mutant = mutant};
    fill(n->x, IN, 0);
    fill(n->w1, HIDDEN * IN, 1);
    fill(n->w2, OUT * HIDDEN, 2);
    fill(n->b2, OUT, 3);
    fill(n->m, MODULI, 4);
    for (int i = 0; i < HIDDEN; i++) {
        n->b1[i] = i % 2 ? 5.0f : -5.0f;
    }
}

static void hide(const struct network *n, float *hidden)
{
    for (int i = 0; i < HIDDEN; i++) {
        float sum = n->b1[i];
        for (int k = 0; k < IN; k++) {
            sum += n->w1[i * IN + k] * n->x[k];
        }
        hidden[i] = sum > 0.0f ? sum : 0.25f * sum;
    }
}

static void forward(void *self, double *out)
{
    float hidden[HIDDEN];
    const struct network *n = self;
    hide(n, hidden);
    for (int o = 0; o < OUT; o++) {
        float sum = n->b2[o];
        for (int i = 0; i < HIDDEN; i++) {
            sum += n->w2[o * HIDDEN + i] * hidden[i];
        }
        out[o] = (double)sum;
    }
}

static void mutate(const struct mutant *mutant, int of, float *x, int count)
{
    for (int i = 0; i < count && mutant->of == of; i++) {
        x[i] *= mutant->element < 0 || mutant->element == i ? mutant->factor : 1.0f;
    }
}

static void backward(void *self, const double *dout)
{
    float hidden[HIDDEN];
    struct network *n = self;
    hide(n, hidden);
    memset(n->dx, 0, sizeof n->dx);
    for (int i = 0; i < HIDDEN; i++) {
        float sum = 0.0f;
        for (int o = 0; o < OUT; o++) {
            sum += n->w2[o * HIDDEN + i] * (float)dout[o];
            n->dw2[o * HIDDEN + i] = (float)dout[o] * hidden[i];
            n->db2[o] = (float)dout[o];
        }
        n->db1[i] = sum * (hidden[i] > 0.0f ? 1.0f : 0.25f);
        for (int k = 0; k < IN; k++) {
            n->dw1[i * IN + k] = n->db1[i] * n->x[k];
            n->dx[k] += n->db1[i] * n->w1[i * IN + k];
        }
    }
    mutate(n->mutant, X, n->dx, IN);
    mutate(n->mutant, W1, n->dw1, HIDDEN * IN);
    mutate(n->mutant, B1, n->db1, HIDDEN);
    mutate(n->mutant, W2, n->dw2, OUT * HIDDEN);
    mutate(n->mutant, B2, n->db2, OUT);
}

static const char *fault_of(const struct mutant *mutant, double rounding)
{
    struct network n;
    network_init(&n, mutant);
    const struct test_argument arguments[ARGUMENTS] = {{"x", n.x, n.dx, IN},
                                                       {"w1", n.w1, n.dw1, HIDDEN * IN},
                                                       {"b1", n.b1, n.db1, HIDDEN},
                                                       {"w2", n.w2, n.dw2, OUT * HIDDEN},
                                                       {"b2", n.b2, n.db2, OUT}};
    return test_gradient_fault(&(struct test_function){.name = mutant->name,
                                                       .argument = arguments,
                                                       .arguments = ARGUMENTS,
                                                       .outs = OUT,
                                                       .self = &n,
                                                       .forward = forward,
                                                       .backward = backward,
                                                       .step = 0x1p-6,
                                                       .rounding = rounding,
                                                       .backward_rounding = rounding,
                                                       .elements = OUT * HIDDEN,
                                                       .sees = 0.005});
}

/* Passes exactly when the factor is 1. */
static void check(const struct mutant *mutant, const char *fault)
{
    if ((fault == NULL) != (mutant->factor == 1.0f)) {
        fail_msg("%s: %s", mutant->name, fault != NULL ? fault : "passes");
    }
}

/* Sums of at most 5 products and a bias, twice. */
static void wrong_gradients_fail(void **state)
{
    static const struct mutant mutants[] = {{"right", X, -1, 1.0f},
                                            {"one element by 1.01", W1, 7, 1.01f},
                                            {"one element of the bias by 1.01", B1, 2, 1.01f},
                                            {"one element of the last layer", W2, 29, 0.99f},
                                            {"all by 1.01", W2, -1, 1.01f},
                                            {"one sign flipped", W1, 19, -1.0f},
                                            {"all signs flipped", X, -1, -1.0f},
                                            {"one element left out", B2, 3, 0.0f},
                                            {"a group left out", B1, -1, 0.0f},
                                            {"not a number", W2, 0, NAN}};
    (void)state;
    for (size_t i = 0; i < sizeof mutants / sizeof *mutants; i++) {
        check(&mutants[i], fault_of(&mutants[i], test_rounding(12)));
    }
}

static void a_test_that_sees_nothing_fails(void **state)
{
    static const struct mutant right = {"right", X, -1, 1.0f};
    (void)state;
    assert_non_null(fault_of(&right, 1e-3));
    assert_null(fault_of(&right, test_rounding(12)));
}

static void forward_moduli(void *self, double *out)
{
    const struct network *n = self;
    *out = 0.0;
    for (int i = 0; i < MODULI; i++) {
        *out += fabs((double)n->m[i]);
    }
}

static void backward_moduli(void *self, const double *dout)
{
    struct network *n = self;
    for (int i = 0; i < MODULI; i++) {
        n->dm[i] = n->m[i] > 0.0f ? (float)*dout : -(float)*dout;
    }
    mutate(n->mutant, 0, n->dm, MODULI);
}

/* Some of 2000 numbers change sign within every step. */
static void kinks_within_the_steps_are_bounded(void **state)
{
    static const struct mutant mutants[] = {{"right", 0, -1, 1.0f},
                                            {"all by 1.01", 0, -1, 1.01f},
                                            {"a sign flipped", 0, 11, -1.0f},
                                            {"left out", 0, -1, 0.0f}};
    (void)state;
    for (size_t i = 0; i < sizeof mutants / sizeof *mutants; i++) {
        struct network n;
        network_init(&n, &mutants[i]);
        const struct test_argument argument = {"m", n.m, n.dm, MODULI};
        check(&mutants[i], test_gradient_fault(&(struct test_function){.name = mutants[i].name,
                                                                       .argument = &argument,
                                                                       .arguments = 1,
                                                                       .outs = 1,
                                                                       .self = &n,
                                                                       .forward = forward_moduli,
                                                                       .backward = backward_moduli,
                                                                       .step = 0x1p-10,
                                                                       .rounding = 1e-12,
                                                                       .backward_rounding = 0x1p-24,
                                                                       .elements = 20,
                                                                       .sees = 0.005,
                                                                       .kinks = TEST_CONVEX}));
    }
}

/* A matrix and its transpose, of which something is mutated. */
struct matrix {
    float a[OUT * IN], turned[IN * OUT];
};

static void apply(float *to, const float *a, const float *from, int rows, int columns)
{
    for (int i = 0; i < rows; i++) {
        to[i] = 0.0f;
        for (int k = 0; k < columns; k++) {
            to[i] += a[i * columns + k] * from[k];
        }
    }
}

static void multiply(void *self, float *out, const float *in)
{
    apply(out, ((struct matrix *)self)->a, in, OUT, IN);
}

static void multiply_turned(void *self, float *in, const float *out)
{
    apply(in, ((struct matrix *)self)->turned, out, IN, OUT);
}

static void wrong_adjoints_fail(void **state)
{
    static const struct mutant mutants[] = {{"right", 0, -1, 1.0f},
                                            {"one element by 1.01", 0, 9, 1.01f},
                                            {"one sign flipped", 0, 5, -1.0f},
                                            {"one element left out", 0, 23, 0.0f},
                                            {"all by 1.01", 0, -1, 1.01f},
                                            {"not a number", 0, 3, NAN}};
    (void)state;
    for (size_t i = 0; i < sizeof mutants / sizeof *mutants; i++) {
        struct matrix m;
        fill(m.a, OUT * IN, 5);
        for (int k = 0; k < OUT * IN; k++) {
            m.turned[k] = m.a[k % OUT * IN + k / OUT];
        }
        mutate(&mutants[i], 0, m.turned, IN * OUT);
        struct test_linear linear = {.name = mutants[i].name,
                                     .ins = IN,
                                     .outs = OUT,
                                     .self = &m,
                                     .forward = multiply,
                                     .adjoint = multiply_turned,
                                     .rounding = test_rounding(OUT)};
        check(&mutants[i], test_adjoint_fault(&linear));
        linear.rounding = 0.02;
        assert_non_null(test_adjoint_fault(&linear)); /* it would see nothing */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wrong_gradients_fail),
        cmocka_unit_test(a_test_that_sees_nothing_fails),
        cmocka_unit_test(kinks_within_the_steps_are_bounded),
        cmocka_unit_test(wrong_adjoints_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
