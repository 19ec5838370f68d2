#include "op/isa.h"

#include "op/conv_backend.h"
#include "op/direct_kernel.h"
#include "op/x86/amx.h"
#include "v2v3d/base/log.h"
#include "v2v3d/op/tile_conv.h"

#include <oneapi/dnnl/dnnl.h>
#include <pthread.h>
#include <stdlib.h>
#include <strings.h>
#include <sys/syscall.h>
#include <unistd.h>

/* What oneDNN 2.6 understands as a limit below the tile unit. */
static int user_limits(void)
{
    static const char *const limits[] = {
        "SSE41", "AVX", "AVX2", "AVX2_VNNI", "AVX512_CORE", "AVX512_CORE_VNNI", "AVX512_CORE_BF16"};
    const char *text = getenv("ONEDNN_MAX_CPU_ISA"); /* comes first there, too */
    text = text != NULL && *text != '\0' ? text : getenv("DNNL_MAX_CPU_ISA");
    for (size_t i = 0; text != NULL && i < sizeof limits / sizeof *limits; i++) {
        if (strcasecmp(text, limits[i]) == 0) {
            return 1;
        }
    }
    return 0;
}

static void limit_onednn(void)
{
    const dnnl_cpu_isa_t most = dnnl_cpu_isa_avx512_core_bf16;
    if (!user_limits() && dnnl_set_max_cpu_isa(most) == dnnl_invalid_arguments) {
        v2v_log(V2V_LOG_WARNING, "oneDNN was in use before and cannot be kept off the tile unit; "
                                 "DNNL_MAX_CPU_ISA=AVX512_CORE_BF16 would");
    }
}

unsigned v2v_onednn_isa(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, limit_onednn);
    return (unsigned)dnnl_get_effective_cpu_isa();
}

#ifdef V2V_X86

/* Of Linux's asm/prctl.h: ask for a part of the processor's state. */
enum { REQUEST_PERMISSION = 0x1023, TILE_DATA = 18 };

int v2v_amx_usable(void)
{
    static int usable = -1;
    if (usable < 0) {
        usable = !user_limits() && __builtin_cpu_supports("avx512bf16") &&
                 __builtin_cpu_supports("amx-bf16") &&
                 syscall(SYS_arch_prctl, REQUEST_PERMISSION, TILE_DATA) == 0;
    }
    return usable;
}

int v2v_kernel_set(void)
{
    return __builtin_cpu_supports("x86-64-v4")   ? V2V_SET_AVX512
           : __builtin_cpu_supports("x86-64-v3") ? V2V_SET_AVX2
                                                 : V2V_SET_ANY;
}

#else

int v2v_amx_usable(void)
{
    return 0;
}

/* Never chosen, never called. */
const struct v2v_conv_backend v2v_conv_amx = {.name = "AMX bf16"};
const struct direct_tiles v2v_direct_tiles = {0};

void v2v_amx_pack_pixels(bf16 *to, const float *const row[AMX_DEPTH], int64_t pixels, int64_t step)
{
    (void)to, (void)row, (void)pixels, (void)step;
    V2V_ASSERT(v2v_amx_usable());
}

int v2v_tile_conv_usable(void)
{
    return 0;
}

enum v2v_status v2v_tile_conv_create(struct v2v_tile_conv **conv,
                                     const struct v2v_tile_conv_spec *spec)
{
    (void)spec;
    *conv = NULL;
    return V2V_FAIL(V2V_E_INTERNAL, "convolution: this processor has no instructions for bf16");
}

void v2v_tile_conv_destroy(struct v2v_tile_conv **conv)
{
    V2V_ASSERT(*conv == NULL);
}

void v2v_tile_conv_set_weights(struct v2v_tile_conv *conv, const float *weight, const float *bias)
{
    (void)conv, (void)weight, (void)bias;
}

void v2v_tile_conv_forward(struct v2v_tile_conv *conv, float *out, const float *in,
                           const struct v2v_winograd_part *part)
{
    (void)conv, (void)out, (void)in, (void)part;
}

int v2v_kernel_set(void)
{
    return V2V_SET_ANY;
}

#endif
