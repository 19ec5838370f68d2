#define LANES 4
#define TARGET
#define KERNEL v2v_direct_any
#include "op/direct_template.h"
