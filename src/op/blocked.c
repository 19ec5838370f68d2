#include "v2v3d/op/blocked.h"

#include "op/x86/amx.h"
#include "v2v3d/base/bounds.h"

_Static_assert((int)V2V_BLOCKED_CHANNELS == (int)AMX_DEPTH, "a block is what one step multiplies");

int64_t v2v_blocked_count(int64_t channels)
{
    return v2v_parts(channels, V2V_BLOCKED_CHANNELS);
}

int64_t v2v_blocked_floats(int64_t channels, int64_t height, int64_t width)
{
    return v2v_blocked_count(channels) * height * width * V2V_BLOCKED_CHANNELS / 2;
}

void v2v_blocked_set(const struct v2v_blocked *image, int64_t block, int64_t y, int64_t x,
                     const float *const row[V2V_BLOCKED_CHANNELS], int64_t pixels)
{
    bf16 *to = (bf16 *)image->data +
               ((block * image->height + y) * image->width + x) * V2V_BLOCKED_CHANNELS;
    v2v_amx_pack_pixels(to, row, pixels, 1);
}
