#define LANES 4
#define ROWS 4
#define TARGET
#define KERNEL v2v_panel_any
#include "op/panel_template.h"

const struct panel_kernel *v2v_panel_choose(void)
{
    if (__builtin_cpu_supports("x86-64-v4")) {
        return &v2v_panel_avx512;
    }
    return __builtin_cpu_supports("x86-64-v3") ? &v2v_panel_avx2 : &v2v_panel_any;
}
