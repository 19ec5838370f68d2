#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/op/gemm.h"
#include <math.h>
#include <omp.h>

enum { M = 7, N = 33, K = 50, PAD = 3 };

static void fill(float *array, int64_t count, uint64_t stream)
{
    for (int64_t i = 0; i < count; i++) {
        array[i] = (float)(2.0 * v2v_random_uniform(11, stream, (uint64_t)i) - 1.0);
    }
}

/** Element of op(x) of an array stored with leading dimension ld. */
static double at(const float *x, int transpose, int64_t row, int64_t column, int64_t ld)
{
    return (double)(transpose ? x[column * ld + row] : x[row * ld + column]);
}

/** K products and beta * c: (K + 3) * 2^-24 * sum of moduli (Higham 3.1). What lies between the
 * rows of c stays. */
static void check(int backend, int ta, int tb)
{
    float a[(M + K) * (M + K)], b[(N + K) * (N + K)], c[M * (N + PAD)], before[M * (N + PAD)];
    int64_t lda = (ta ? M : K) + PAD, ldb = (tb ? K : N) + PAD, ldc = N + PAD;
    fill(a, M * K + PAD * (ta ? K : M), 1);
    fill(b, N * K + PAD * (tb ? N : K), 2);
    fill(c, M * ldc, 3);
    fill(before, M * ldc, 3);
    v2v_gemm(backend, ta, tb, M, N, K, 0.5f, a, lda, b, ldb, 2.0f, c, ldc);
    for (int64_t m = 0; m < M; m++) {
        for (int64_t n = 0; n < ldc; n++) {
            double sum = (n < N ? 2.0 : 1.0) * (double)before[m * ldc + n], moduli = fabs(sum);
            for (int64_t k = 0; n < N && k < K; k++) {
                double term = 0.5 * at(a, ta, m, k, lda) * at(b, tb, k, n, ldb);
                sum += term;
                moduli += fabs(term);
            }
            double bound = n < N ? (K + 3) * ldexp(1.0, -24) * moduli : 0.0;
            assert_true(fabs((double)c[m * ldc + n] - sum) <= bound);
        }
    }
}

static void products_of_all_transpositions_match_plain_loops(void **unused)
{
    (void)unused;
    static const int libraries[] = {V2V_BACKEND_ONEDNN, V2V_BACKEND_OPENBLAS};
    for (int i = 0; i < 8; i++) {
        check(libraries[i / 4], i / 2 % 2, i % 2);
    }
}

static void the_thread_count_reaches_openmp(void **unused)
{
    (void)unused;
    int before = omp_get_max_threads();
    v2v_op_set_threads(2);
    assert_int_equal(omp_get_max_threads(), 2);
    v2v_op_set_threads(before);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(products_of_all_transpositions_match_plain_loops),
        cmocka_unit_test(the_thread_count_reaches_openmp),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
