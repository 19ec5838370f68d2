/* Every instruction set that this processor has, not only the one that convolutions would take. */
#include "op/isa.h"
#include "op/panel_kernel.h"
#include "op/winograd_kernel.h"
#include "support.h"
#include "v2v3d/base/random.h"

#include <math.h>

enum { DEPTH = 37, COUNT = 21, STEP = 24 };
#define EPSILON 0x1p-24

static const struct {
    const char *name;
    const struct panel_kernel *panel;
    const struct winograd_kernel *winograd;
} sets[] = {
    {"any", &v2v_panel_any, &v2v_winograd_any},
#ifdef V2V_X86
    {"AVX2", &v2v_panel_avx2, &v2v_winograd_avx2},
    {"AVX-512", &v2v_panel_avx512, &v2v_winograd_avx512},
#endif
};
enum { SETS = sizeof sets / sizeof *sets };

static int runs(int set)
{
    int there = set <= v2v_kernel_set();
    print_message("%s: %s\n", sets[set].name, there ? "tested" : "this processor has it not");
    return there;
}

static void draw(float *x, int64_t count, uint64_t stream)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(2.0 * v2v_random_uniform(23, stream, (uint64_t)i) - 1.0);
    }
}

static void product_of_a_panel_equals_plain_loops(void **state)
{
    (void)state;
    float a[DEPTH * PANEL_ROWS], b[DEPTH * PANEL_COLUMNS], c[PANEL_ROWS * PANEL_COLUMNS];
    float before[PANEL_ROWS * PANEL_COLUMNS];
    draw(a, DEPTH * PANEL_ROWS, 1);
    draw(b, DEPTH * PANEL_COLUMNS, 2);
    for (int set = 0; set < SETS; set++) {
        for (int add = 0; add < 2 && runs(set); add++) {
            draw(c, PANEL_ROWS * PANEL_COLUMNS, 3);
            draw(before, PANEL_ROWS * PANEL_COLUMNS, 3);
            sets[set].panel->product(c, a, b, DEPTH, add);
            for (int i = 0; i < PANEL_ROWS * PANEL_COLUMNS; i++) {
                double sum = add ? before[i] : 0.0;
                for (int k = 0; k < DEPTH; k++) {
                    sum += (double)a[k * PANEL_ROWS + i / PANEL_COLUMNS] *
                           b[k * PANEL_COLUMNS + i % PANEL_COLUMNS];
                }
                assert_true(fabs(sum - c[i]) <= (DEPTH + 1) * (DEPTH + 1) * EPSILON);
            }
        }
    }
}

static void turned_blocks_are_transposed(void **state)
{
    (void)state;
    float from[PANEL_ROWS * 11], to[PANEL_ROWS * 13];
    draw(from, PANEL_ROWS * 11, 1);
    for (int set = 0; set < SETS; set++) {
        if (!runs(set)) {
            continue;
        }
        sets[set].panel->turn(to, 13, from, 11);
        for (int y = 0; y < PANEL_ROWS; y++) {
            for (int x = 0; x < PANEL_ROWS; x++) {
                assert_true(to[x * 13 + y] == from[y * 11 + x]);
            }
        }
    }
}

/* The definition: 4 outputs of a filter along one axis from 6 products. */
static void transforms_multiply_to_a_convolution(void **state)
{
    (void)state;
    float pixels[6 * STEP], points[6 * STEP], taps[9 * STEP], values[36 * STEP], out[4 * STEP];
    for (int set = 0; set < SETS; set++) {
        if (!runs(set)) {
            continue;
        }
        draw(pixels, 6 * STEP, 1);
        draw(taps, 9 * STEP, 2);
        sets[set].winograd->input(points, STEP, pixels, STEP, COUNT);
        sets[set].winograd->weights(values, STEP, taps, STEP, COUNT);
        /* the last row of values, the point infinity along y, has the filter's last row */
        for (int i = 0; i < 6 * STEP; i++) {
            points[i] *= values[30 * STEP + i];
        }
        sets[set].winograd->output(out, STEP, points, STEP, COUNT);
        for (int t = 0; t < COUNT; t++) {
            for (int x = 0; x < 4; x++) {
                double sum = 0.0;
                for (int l = 0; l < 3; l++) {
                    sum += (double)taps[(6 + l) * STEP + t] * pixels[(x + l) * STEP + t];
                }
                /* moduli of at most 48 on the way, rounded about ten times */
                assert_true(fabs(sum - out[x * STEP + t]) <= 48.0 * 10.0 * EPSILON);
            }
        }
    }
}

static void check_places(winograd_axis *apply, int outs)
{
    enum { MOST = 40, APART = 48 };
    _Alignas(64) float aligned[36 * APART];
    float in[9 * MOST], elsewhere[36 * APART + 1];
    draw(in, 9 * MOST, 4);
    for (int count = 4; count <= MOST; count += 4) {
        apply(aligned, APART, in, MOST, count);
        apply(elsewhere + 1, APART, in, MOST, count);
        for (int i = 0; i < outs; i++) {
            assert_memory_equal(aligned + i * APART, elsewhere + 1 + i * APART,
                                (size_t)count * sizeof *in);
        }
    }
}

/* Whole vectors take stores of their own where these lie on lines of the cache. */
static void values_have_the_same_bits_wherever_they_lie(void **state)
{
    (void)state;
    for (int set = 0; set < SETS; set++) {
        const struct winograd_kernel *kernel = sets[set].winograd;
        if (runs(set)) {
            check_places(kernel->input_past, 6);
            check_places(kernel->output_turned_past, 6);
            check_places(kernel->weights, 36);
        }
    }
}

static double inner(const float *a, const float *b, int rows)
{
    double sum = 0.0;
    for (int i = 0; i < rows; i++) {
        for (int t = 0; t < COUNT; t++) {
            sum += (double)a[i * STEP + t] * b[i * STEP + t];
        }
    }
    return sum;
}

static void check_adjoint(winograd_axis *apply, winograd_axis *turned, int ins, int outs)
{
    float x[36 * STEP], y[36 * STEP], ax[36 * STEP], aty[36 * STEP];
    draw(x, 36 * STEP, 1);
    draw(y, 36 * STEP, 2);
    apply(ax, STEP, x, STEP, COUNT);
    turned(aty, STEP, y, STEP, COUNT);
    /* coefficients of a row add up to at most 19 */
    double bound = 19.0 * 19.0 * 36.0 * COUNT * EPSILON;
    assert_true(fabs(inner(ax, y, outs) - inner(x, aty, ins)) <= bound);
}

static void turned_transforms_are_the_adjoints(void **state)
{
    (void)state;
    for (int set = 0; set < SETS; set++) {
        if (!runs(set)) {
            continue;
        }
        const struct winograd_kernel *k = sets[set].winograd;
        check_adjoint(k->input, k->input_turned, 6, 6);
        check_adjoint(k->output, k->output_turned, 6, 4);
        check_adjoint(k->weights, k->weights_turned, 9, 36);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(product_of_a_panel_equals_plain_loops),
        cmocka_unit_test(turned_blocks_are_transposed),
        cmocka_unit_test(transforms_multiply_to_a_convolution),
        cmocka_unit_test(values_have_the_same_bits_wherever_they_lie),
        cmocka_unit_test(turned_transforms_are_the_adjoints),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
