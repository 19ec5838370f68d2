/* A linear map of which every step alone goes slowly. */
#include "method/anderson.h"
#include "support.h"

#include <math.h>

enum { COUNT = 3 };

/* Fixed point (1, -2, 3); eigenvalues 0.95, 0.9, -0.5. */
static void map(double g[COUNT], const double x[COUNT])
{
    const double e[COUNT] = {x[0] - 1.0, x[1] + 2.0, x[2] - 3.0};
    g[0] = 1.0 + 0.95 * e[0];
    g[1] = -2.0 + 0.1 * e[0] + 0.9 * e[1];
    g[2] = 3.0 - 0.2 * e[1] - 0.5 * e[2];
}

static double miss(const double x[COUNT])
{
    return fabs(x[0] - 1.0) + fabs(x[1] + 2.0) + fabs(x[2] - 3.0);
}

static void a_linear_map_is_solved_in_two_steps_more_than_it_has_dimensions(void **state)
{
    (void)state;
    struct v2v_anderson *anderson = NULL;
    double x[COUNT] = {0.0, 0.0, 0.0}, plain[COUNT] = {0.0, 0.0, 0.0}, g[COUNT];
    assert_ok(v2v_anderson_create(&anderson, COUNT));
    for (int k = 0; k < COUNT + 2; k++) {
        map(g, x);
        v2v_anderson_step(anderson, x, g);
        map(g, plain);
        for (int i = 0; i < COUNT; i++) {
            plain[i] = g[i];
        }
    }
    assert_true(miss(plain) > 1.0);
    assert_true(miss(x) < 1e-9); /* differences lose digits: 1e-16 over the square of 0.01 */
    v2v_anderson_destroy(&anderson);
}

static void at_the_fixed_point_it_stays(void **state)
{
    (void)state;
    struct v2v_anderson *anderson = NULL;
    double x[COUNT] = {1.0, -2.0, 3.0}, g[COUNT];
    assert_ok(v2v_anderson_create(&anderson, COUNT));
    for (int k = 0; k < 6; k++) {
        map(g, x);
        v2v_anderson_step(anderson, x, g);
        assert_true(miss(x) == 0.0);
    }
    v2v_anderson_destroy(&anderson);
}

static void after_a_restart_the_first_step_is_plain(void **state)
{
    (void)state;
    struct v2v_anderson *anderson = NULL;
    double x[COUNT] = {0.0, 0.0, 0.0}, g[COUNT];
    assert_ok(v2v_anderson_create(&anderson, COUNT));
    for (int k = 0; k < 3; k++) {
        map(g, x);
        v2v_anderson_step(anderson, x, g);
    }
    v2v_anderson_restart(anderson);
    map(g, x);
    v2v_anderson_step(anderson, x, g);
    assert_memory_equal(x, g, sizeof x);
    v2v_anderson_destroy(&anderson);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_linear_map_is_solved_in_two_steps_more_than_it_has_dimensions),
        cmocka_unit_test(at_the_fixed_point_it_stays),
        cmocka_unit_test(after_a_restart_the_first_step_is_plain),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
