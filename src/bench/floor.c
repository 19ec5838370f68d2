#include "bench/floor.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/gemm.h"
#include <math.h>
#include <string.h>

/* Three matrices of 2048^2 floats: 48 MB, 8.6 G multiply-adds: some tenths of a second. */
enum { SIDE = 2048, TRIES = 2 };

/* Larger than any last-level cache of today by some factor. */
static const int64_t copied_bytes = (int64_t)256 << 20;

static double gemm_rate(int backend, float *matrices)
{
    const int64_t count = (int64_t)SIDE * SIDE;
    double best = 0.0;
    for (int i = 0; i < TRIES; i++) {
        double started = v2v_clock_now();
        v2v_gemm(backend, 0, 0, SIDE, SIDE, SIDE, 1.0f, matrices, SIDE, matrices + count, SIDE,
                 0.0f, matrices + 2 * count, SIDE);
        best = fmax(best, (double)SIDE * (double)count / (v2v_clock_now() - started));
    }
    return best;
}

static double copy_rate(char *to, const char *from)
{
    enum { PIECE = 1 << 20 };
    double best = 0.0;
    for (int i = 0; i < TRIES; i++) {
        double started = v2v_clock_now();
#pragma omp parallel for schedule(static)
        for (int64_t at = 0; at < copied_bytes; at += PIECE) {
            memcpy(to + at, from + at, PIECE);
        }
        best = fmax(best, 2.0 * (double)copied_bytes / (v2v_clock_now() - started));
    }
    return best;
}

enum v2v_status v2v_floor_measure(struct v2v_bench_rates *rates)
{
    enum v2v_status rc = V2V_OK;
    float *matrices = NULL;
    char *to = NULL, *from = NULL;
    V2V_TRY(V2V_ALLOC(matrices, "bench.gemm", v2v_mem_product(3, SIDE, SIDE)));
    for (int64_t i = 0; i < (int64_t)2 * SIDE * SIDE; i++) {
        matrices[i] = 1.0f / (float)(1 + i % 7);
    }
    rates->gemm_onednn = fmax(rates->gemm_onednn, gemm_rate(V2V_BACKEND_ONEDNN, matrices));
    rates->gemm_openblas = fmax(rates->gemm_openblas, gemm_rate(V2V_BACKEND_OPENBLAS, matrices));
    V2V_TRY(V2V_ALLOC(to, "bench.copy", copied_bytes));
    V2V_TRY(V2V_ALLOC(from, "bench.copy", copied_bytes));
    memset(from, 1, (size_t)copied_bytes); /* untouched pages would all be one zero page */
    rates->copy = fmax(rates->copy, copy_rate(to, from));
done:
    v2v_mem_free(from);
    v2v_mem_free(to);
    v2v_mem_free(matrices);
    return rc;
}

double v2v_floor_seconds(const struct v2v_bench_rates *rates, const struct v2v_work *work)
{
    double gemm = fmax(rates->gemm_onednn, rates->gemm_openblas);
    return fmax(work->macs / gemm, work->bytes / rates->copy);
}
