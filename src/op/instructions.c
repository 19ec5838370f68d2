#include "v2v3d/op/instructions.h"

#include "op/isa.h"

int64_t v2v_op_instructions(void)
{
    return (int64_t)v2v_onednn_isa() * 8 + v2v_amx_usable() * 4 + v2v_kernel_set();
}
