/* Adam against its formulas in double precision. */
#include "support.h"

#include "v2v3d/base/random.h"
#include "v2v3d/nn/adam.h"

#include <math.h>
#include <string.h>

enum { COUNT = 1000, STEPS = 2 };

static const struct v2v_adam adam = {
    .learning_rate = 8e-5, .beta1 = 0.9, .beta2 = 0.999, .epsilon = 1e-8};

static float gradient(int step, int64_t i)
{
    /* from 1e-9, where epsilon counts, to 1e3 */
    double size = pow(10.0, 12.0 * v2v_random_uniform(5, 1, (uint64_t)i) - 9.0);
    return (float)(size * v2v_random_normal(5, (uint64_t)(2 + step), (uint64_t)i));
}

/* m / (1 - beta1) = g and v / (1 - beta2) = g^2 after one step: the weight moves by the learning
 * rate against the gradient. Five roundings of 6e-8 in the step, one in a weight below 1. */
static void the_first_step_has_the_size_of_the_learning_rate(void **state)
{
    (void)state;
    static const float g[] = {3.0f, -1e-3f, 100.0f, -7e-5f, 0.0f};
    float w[5] = {0}, m[5] = {0}, v[5] = {0};
    v2v_adam_step(&adam, w, m, v, g, 5, 1);
    for (int i = 0; i < 5; i++) {
        double size = (double)g[i] / (fabs((double)g[i]) + adam.epsilon) * adam.learning_rate;
        assert_true(fabs((double)w[i] + size) <= 5 * 6e-8 * adam.learning_rate);
    }
}

/* Relative to the step: ten roundings of 6e-8 on the way through m and v, whose differences g - m
 * lose as much as |m| / |m_new| where signs cancel (bounded by the absolute term), plus one of the
 * weight's own. */
static void two_steps_match_double_precision(void **state)
{
    (void)state;
    static float w[COUNT], m[COUNT], v[COUNT], g[COUNT];
    static double w2[COUNT], m2[COUNT], v2[COUNT];
    for (int64_t i = 0; i < COUNT; i++) {
        w[i] = (float)v2v_random_normal(5, 0, (uint64_t)i);
        w2[i] = w[i];
    }
    for (int step = 1; step <= STEPS; step++) {
        for (int64_t i = 0; i < COUNT; i++) {
            g[i] = gradient(step, i);
            m2[i] = adam.beta1 * m2[i] + (1.0 - adam.beta1) * g[i];
            v2[i] = adam.beta2 * v2[i] + (1.0 - adam.beta2) * g[i] * g[i];
            double mean = m2[i] / (1.0 - pow(adam.beta1, step));
            double root = sqrt(v2[i] / (1.0 - pow(adam.beta2, step)));
            w2[i] -= adam.learning_rate * mean / (root + adam.epsilon);
        }
        v2v_adam_step(&adam, w, m, v, g, COUNT, step);
    }
    for (int64_t i = 0; i < COUNT; i++) {
        double bound = STEPS * (6e-8 * fabs(w2[i]) + 10 * 6e-8 * adam.learning_rate);
        assert_true(fabs((double)w[i] - w2[i]) <= bound);
    }
}

static void without_a_gradient_nothing_decays(void **state)
{
    (void)state;
    float w[3] = {1.0f, -2.0f, 1e-30f}, m[3] = {0}, v[3] = {0};
    const float before[3] = {1.0f, -2.0f, 1e-30f}, g[3] = {0};
    for (int step = 1; step <= 100; step++) {
        v2v_adam_step(&adam, w, m, v, g, 3, step);
    }
    assert_memory_equal(w, before, sizeof w);
}

/* The largest gradient whose square is a float32, and one whose square underflows. */
static void extreme_gradients_leave_finite_weights(void **state)
{
    (void)state;
    static const float g[] = {1.8e19f, -1.8e19f, 1e-30f, 1e-45f};
    float w[4] = {0}, m[4] = {0}, v[4] = {0};
    for (int step = 1; step <= 5; step++) {
        v2v_adam_step(&adam, w, m, v, g, 4, step);
    }
    for (int i = 0; i < 4; i++) {
        assert_true(isfinite(w[i]) && fabs((double)w[i]) <= 5.001 * adam.learning_rate);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_first_step_has_the_size_of_the_learning_rate),
        cmocka_unit_test(two_steps_match_double_precision),
        cmocka_unit_test(without_a_gradient_nothing_decays),
        cmocka_unit_test(extreme_gradients_leave_finite_weights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
