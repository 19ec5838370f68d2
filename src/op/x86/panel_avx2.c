#define LANES 8
#define ROWS 4
#define TARGET __attribute__((target("arch=x86-64-v3")))
#define KERNEL v2v_panel_avx2
#include "op/panel_template.h"
