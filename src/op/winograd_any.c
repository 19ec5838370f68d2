#include "op/isa.h"

#define LANES 4
#define TARGET
#define WINOGRAD_KERNEL v2v_winograd_any
#include "op/winograd_template.h"

const struct winograd_kernel *v2v_winograd_choose(void)
{
    static const struct winograd_kernel *const sets[] = V2V_KERNEL_SETS(v2v_winograd);
    return sets[v2v_kernel_set()];
}
