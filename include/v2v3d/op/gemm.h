#ifndef V2V3D_OP_GEMM_H
#define V2V3D_OP_GEMM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** c[m,n] = alpha * op(a)[m,k] op(b)[k,n] + beta * c, row-major, leading dimensions in elements.
 *  @kind Local. @param backend enum v2v_backend: dnnl_sgemm or cblas_sgemm */
void v2v_gemm(int backend, int transpose_a, int transpose_b, int64_t m, int64_t n, int64_t k,
              float alpha, const float *a, int64_t lda, const float *b, int64_t ldb, float beta,
              float *c, int64_t ldc);

/** Threads of the libraries and of OpenMP for this process. @kind Local. */
void v2v_op_set_threads(int threads);

#ifdef __cplusplus
}
#endif

#endif
