#include <immintrin.h>

#define LANES 16
#define TARGET __attribute__((target("arch=x86-64-v4,prefer-vector-width=512")))
#define STREAM(to, vector) _mm512_stream_ps((to), (__m512)(vector))
#define WINOGRAD_KERNEL v2v_winograd_avx512
#include "op/winograd_template.h"
