#include "v2v3d/op/instructions.h"

#include "op/amx.h"

#include <oneapi/dnnl/dnnl.h>

/* The levels that this room's own kernels are built for. */
static int64_t own_level(void)
{
    return __builtin_cpu_supports("x86-64-v4") ? 2 : __builtin_cpu_supports("x86-64-v3") ? 1 : 0;
}

int64_t v2v_op_instructions(void)
{
    int64_t levels = v2v_amx_usable() * 4 + own_level();
    return (int64_t)(uint32_t)dnnl_get_effective_cpu_isa() * 8 + levels;
}
