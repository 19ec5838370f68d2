#define LANES 4
#define TARGET
#define WINOGRAD_KERNEL v2v_winograd_any
#include "op/winograd_template.h"

const struct winograd_kernel *v2v_winograd_choose(void)
{
    if (__builtin_cpu_supports("x86-64-v4")) {
        return &v2v_winograd_avx512;
    }
    return __builtin_cpu_supports("x86-64-v3") ? &v2v_winograd_avx2 : &v2v_winograd_any;
}
