#include "v2v3d/tensor/bulk.h"

#include "v2v3d/base/bounds.h"

#include <string.h>

/* Floats that one thread takes at a time: 1 MB. */
enum { BLOCK = 1 << 18 };

void v2v_bulk_clear(float *to, int64_t count)
{
#pragma omp parallel for schedule(static) if (count > BLOCK)
    for (int64_t i = 0; i < count; i += BLOCK) {
        memset(to + i, 0, (size_t)v2v_smaller(BLOCK, count - i) * sizeof *to);
    }
}

void v2v_bulk_copy(float *to, const float *from, int64_t count)
{
#pragma omp parallel for schedule(static) if (count > BLOCK)
    for (int64_t i = 0; i < count; i += BLOCK) {
        memcpy(to + i, from + i, (size_t)v2v_smaller(BLOCK, count - i) * sizeof *to);
    }
}

void v2v_bulk_scale(float *x, int64_t count, float factor)
{
#pragma omp parallel for simd schedule(static) if (count > BLOCK)
    for (int64_t i = 0; i < count; i++) {
        x[i] *= factor;
    }
}
