#ifndef V2V3D_TENSOR_BULK_H
#define V2V3D_TENSOR_BULK_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Long arrays by all threads: one alone does not reach the memory's speed. @kind Local. */
void v2v_bulk_clear(float *to, int64_t count);

/** The two share no memory. @kind Local. */
void v2v_bulk_copy(float *to, const float *from, int64_t count);

/** x <- factor * x. */
void v2v_bulk_scale(float *x, int64_t count, float factor);

#ifdef __cplusplus
}
#endif

#endif
