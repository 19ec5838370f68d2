/* A small system against its known solution, and where steps end. */
#include "support.h"

#include "v2v3d/tensor/conjugate_gradients.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

enum { COUNT = 5 };

/* Diagonal 1 .. 5, and 0.5 beside it. */
struct matrix {
    double sign;
    int products;
};

static void multiply(void *of, double *product, const double *way)
{
    struct matrix *matrix = of;
    matrix->products++;
    for (int i = 0; i < COUNT; i++) {
        product[i] = (i + 1.0) * way[i];
        product[i] += i > 0 ? 0.5 * way[i - 1] : 0.0;
        product[i] += i + 1 < COUNT ? 0.5 * way[i + 1] : 0.0;
        product[i] *= matrix->sign;
    }
}

static const double solution[COUNT] = {1.0, -2.0, 0.5, 3.0, -1.0};

/* @param x out @param rest out */
static int solve(double *x, double *rest, double sign, int steps, double enough)
{
    struct matrix matrix = {.sign = 1.0};
    double way[COUNT], product[COUNT];
    multiply(&matrix, rest, solution);
    matrix = (struct matrix){.sign = sign};
    v2v_conjugate_gradients_solve(&(struct v2v_conjugate_gradients){.count = COUNT,
                                                                    .steps = steps,
                                                                    .enough = enough,
                                                                    .way = way,
                                                                    .product = product,
                                                                    .multiply = multiply,
                                                                    .of = &matrix},
                                  x, rest);
    return matrix.products;
}

static void as_many_steps_as_unknowns_solve(void **state)
{
    (void)state;
    double x[COUNT], rest[COUNT];
    assert_int_equal(solve(x, rest, 1.0, COUNT, 0.0), COUNT);
    for (int i = 0; i < COUNT; i++) {
        assert_true(fabs(x[i] - solution[i]) < 1e-12);
        assert_true(fabs(rest[i]) < 1e-12);
    }
}

static void steps_end_at_what_is_enough(void **state)
{
    (void)state;
    double x[COUNT], rest[COUNT];
    assert_int_equal(solve(x, rest, 1.0, 0, 1e-2), 0);
    const double enough = 1e-2 * v2v_dot(rest, rest, COUNT);
    const int steps = solve(x, rest, 1.0, COUNT, 1e-2);
    assert_in_range(steps, 2, COUNT - 1);
    assert_true(v2v_dot(rest, rest, COUNT) <= enough);
    assert_int_equal(solve(x, rest, 1.0, steps - 1, 1e-2), steps - 1);
    assert_true(v2v_dot(rest, rest, COUNT) > enough);
}

static void no_step_along_what_is_not_positive(void **state)
{
    (void)state;
    double x[COUNT], rest[COUNT];
    assert_int_equal(solve(x, rest, -1.0, COUNT, 0.0), 1);
    for (int i = 0; i < COUNT; i++) {
        assert_true(x[i] == 0.0);
    }
}

static void nothing_takes_no_step(void **state)
{
    (void)state;
    double x[COUNT], rest[COUNT] = {0.0}, way[COUNT], product[COUNT];
    struct matrix matrix = {.sign = 1.0};
    v2v_conjugate_gradients_solve(
        &(struct v2v_conjugate_gradients){COUNT, COUNT, 1e-6, way, product, multiply, &matrix}, x,
        rest);
    assert_int_equal(matrix.products, 0);
    assert_true(x[0] == 0.0 && x[COUNT - 1] == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(as_many_steps_as_unknowns_solve),
        cmocka_unit_test(steps_end_at_what_is_enough),
        cmocka_unit_test(no_step_along_what_is_not_positive),
        cmocka_unit_test(nothing_takes_no_step),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
