#include "v2v3d/op/bf16.h"

#include "op/isa.h"

#include <oneapi/dnnl/dnnl.h>

/* An instruction set's number has the bits of all the sets that it contains; 0 elsewhere than on
 * x86-64. */
static int contains(unsigned isa, dnnl_cpu_isa_t part)
{
    return (isa & (unsigned)part) == (unsigned)part;
}

int v2v_op_bf16(void)
{
    unsigned isa = v2v_onednn_isa();
    if (v2v_amx_usable()) {
        return V2V_BF16_TILES;
    }
    if (contains(isa, dnnl_cpu_isa_avx512_core_bf16)) {
        return V2V_BF16_NATIVE;
    }
    return contains(isa, dnnl_cpu_isa_avx512_core) ? V2V_BF16_EMULATED : V2V_BF16_NONE;
}

const char *v2v_op_bf16_text(int kind)
{
    static const char *const text[] = {[V2V_BF16_NONE] = "none",
                                       [V2V_BF16_EMULATED] = "emulated, slower than float32",
                                       [V2V_BF16_NATIVE] = "by oneDNN",
                                       [V2V_BF16_TILES] = "by the tile unit (AMX)"};
    return text[kind];
}
