#include "v2v3d/op/gemm.h"

#include "op/isa.h"
#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <cblas.h>
#include <limits.h>
#include <omp.h>
#include <oneapi/dnnl/dnnl.h>

/** OpenBLAS counts in int. */
static int blas_int(int64_t x)
{
    V2V_ASSERT(x >= 0 && x <= INT_MAX);
    return (int)x;
}

static CBLAS_TRANSPOSE blas_transpose(int transpose)
{
    return transpose ? CblasTrans : CblasNoTrans;
}

void v2v_gemm(int backend, int transpose_a, int transpose_b, int64_t m, int64_t n, int64_t k,
              float alpha, const float *a, int64_t lda, const float *b, int64_t ldb, float beta,
              float *c, int64_t ldc)
{
    if (backend == V2V_BACKEND_ONEDNN) {
        (void)v2v_onednn_isa();
        dnnl_status_t status = dnnl_sgemm(transpose_a ? 'T' : 'N', transpose_b ? 'T' : 'N', m, n, k,
                                          alpha, a, lda, b, ldb, beta, c, ldc);
        V2V_ASSERT(status == dnnl_success);
        return;
    }
    cblas_sgemm(CblasRowMajor, blas_transpose(transpose_a), blas_transpose(transpose_b),
                blas_int(m), blas_int(n), blas_int(k), alpha, a, blas_int(lda), b, blas_int(ldb),
                beta, c, blas_int(ldc));
}

void v2v_op_set_threads(int threads)
{
    V2V_ASSERT(threads >= 1);
    omp_set_num_threads(threads);
    openblas_set_num_threads(threads);
}
