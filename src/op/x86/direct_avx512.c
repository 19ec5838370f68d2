#define LANES 16
#define TARGET __attribute__((target("arch=x86-64-v4,prefer-vector-width=512")))
#define KERNEL v2v_direct_avx512
#include "op/direct_template.h"
