/* Sums whose order depends on the sizes alone: the same bits on 1, 2 and 4 threads. Our own kernels
 * promise it; the libraries' rows of the table are for information. */
#include "op/conv_backend.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

/* Several panels and several chunks for every thread; sizes that nothing divides. */
enum { IN = 37, OUT = 45, HEIGHT = 50, WIDTH = 70, PIXELS = HEIGHT * WIDTH, COUNT = 3000017 };
enum { IN_FLOATS = IN * PIXELS, OUT_FLOATS = OUT * PIXELS, WEIGHTS = OUT * IN * 9 };

static const int threads[] = {1, 2, 4};
enum { RUNS = sizeof threads / sizeof *threads };

/* All that a layer computes. */
struct results {
    float out[OUT_FLOATS], din[IN_FLOATS], dweight[WEIGHTS], dbias[OUT];
};

/* Numbers of very different size: another order of their sum is another sum. */
static float *draw(int64_t count, uint64_t stream)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    for (int64_t i = 0; i < count; i++) {
        double size = i % 5 == 0 ? 1e3 : 1.0;
        x[i] = (float)(size * v2v_random_normal(83, stream, (uint64_t)i));
    }
    return x;
}

static void compute(struct results *results, const struct v2v_conv_backend *backend, int count,
                    float *const x[4])
{
    struct v2v_workspace workspace = {0};
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = IN,
                                 .out = OUT,
                                 .height = HEIGHT,
                                 .width = WIDTH,
                                 .kernel = 3,
                                 .stride = 1,
                                 .slope = 0.01f,
                                 .training = 1,
                                 .method = {.workspace = &workspace}};
    memset(results, 0, sizeof *results);
    v2v_op_set_threads(count);
    assert_ok(v2v_conv_create_with(&conv, &spec, backend));
    v2v_conv_set_weights(conv, x[2], x[3]);
    v2v_conv_forward(conv, results->out, x[0]);
    v2v_conv_backward_data(conv, results->din, x[1]);
    v2v_conv_backward_weights(conv, results->dweight, results->dbias, x[0], x[1]);
    v2v_conv_destroy(&conv);
    v2v_workspace_fini(&workspace);
    v2v_op_set_threads(1);
}

static const char *same(int bits)
{
    return bits ? "same bits" : "differs";
}

static void convolutions_and_their_gradients_have_the_bits_of_one_thread(void **state)
{
    static const struct {
        const struct v2v_conv_backend *backend;
        int promised;
    } rows[] = {{&v2v_conv_winograd, 1},
                {&v2v_conv_direct, 1},
                {&v2v_conv_onednn, 0},
                {&v2v_conv_openblas, 0}};
    static struct results one, many;
    float *x[4] = {draw(IN_FLOATS, 1), draw(OUT_FLOATS, 2), draw(WEIGHTS, 3), draw(OUT, 4)};
    (void)state;
    print_message("%-10s %7s %10s %10s %10s %10s\n", "", "threads", "forward", "data", "weights",
                  "bias");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        compute(&one, rows[i].backend, 1, x);
        for (int t = 1; t < RUNS; t++) {
            compute(&many, rows[i].backend, threads[t], x);
            int out = memcmp(one.out, many.out, sizeof one.out) == 0;
            int data = memcmp(one.din, many.din, sizeof one.din) == 0;
            int weights = memcmp(one.dweight, many.dweight, sizeof one.dweight) == 0;
            int bias = memcmp(one.dbias, many.dbias, sizeof one.dbias) == 0;
            print_message("%-10s %7d %10s %10s %10s %10s\n", rows[i].backend->name, threads[t],
                          same(out), same(data), same(weights), same(bias));
            assert_true(bias);
            assert_true(!rows[i].promised || (out && data && weights));
        }
    }
    for (int i = 0; i < 4; i++) {
        v2v_mem_free(x[i]);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void norms_have_the_bits_of_one_thread(void **state)
{
    float *x = draw(COUNT, 5);
    double norm[RUNS];
    (void)state;
    for (int t = 0; t < RUNS; t++) {
        v2v_op_set_threads(threads[t]);
        norm[t] = v2v_sum_of_squares(x, COUNT);
    }
    v2v_op_set_threads(1);
    print_message("sum of squares: %.17g, %.17g, %.17g on 1, 2, 4 threads\n", norm[0], norm[1],
                  norm[2]);
    assert_true(norm[1] == norm[0] && norm[2] == norm[0]);
    v2v_mem_free(x);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(convolutions_and_their_gradients_have_the_bits_of_one_thread),
        cmocka_unit_test(norms_have_the_bits_of_one_thread),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
