#include "op/isa.h"

#define LANES 4
#define ROWS 4
#define TARGET
#define KERNEL v2v_panel_any
#include "op/panel_template.h"

const struct panel_kernel *v2v_panel_choose(void)
{
    static const struct panel_kernel *const sets[] = V2V_KERNEL_SETS(v2v_panel);
    return sets[v2v_kernel_set()];
}
