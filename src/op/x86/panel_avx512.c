#define LANES 16
#define ROWS 8
#define TARGET __attribute__((target("arch=x86-64-v4,prefer-vector-width=512")))
#define KERNEL v2v_panel_avx512
#include "op/panel_template.h"
