#define LANES 8
#define TARGET __attribute__((target("arch=x86-64-v3")))
#define WINOGRAD_KERNEL v2v_winograd_avx2
#include "op/winograd_template.h"
