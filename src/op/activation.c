#include "v2v3d/op/activation.h"
#include "op/pixels.h"
#include "v2v3d/base/clones.h"

/** Elements that one thread takes at a time: 256 KB stay in a core's second-level cache. */
enum { BLOCK = 65536 };

V2V_SIMD_CLONES
static void forward_block(float *out, const float *in, int64_t count, float slope)
{
#pragma omp simd
    for (int64_t i = 0; i < count; i++) {
        out[i] = in[i] > 0.0f ? in[i] : slope * in[i];
    }
}

static int64_t block_length(int64_t first, int64_t count)
{
    return count - first < BLOCK ? count - first : BLOCK;
}

void v2v_leaky_forward(float *out, const float *in, int64_t count, float slope)
{
#pragma omp parallel for schedule(static) if (count > BLOCK)
    for (int64_t i = 0; i < count; i += BLOCK) {
        forward_block(out + i, in + i, block_length(i, count), slope);
    }
}

void v2v_leaky_backward(float *din, const float *dout, const float *y, int64_t count, float slope)
{
#pragma omp parallel for schedule(static) if (count > BLOCK)
    for (int64_t i = 0; i < count; i += BLOCK) {
        v2v_pixels_activate_turned(din + i, dout + i, y + i, block_length(i, count), slope);
    }
}
