#define LANES 8
#define TARGET __attribute__((target("arch=x86-64-v3")))
#define KERNEL v2v_direct_avx2
#include "op/direct_template.h"
