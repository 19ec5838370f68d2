/* oneDNN is told what it may use before anything else of it is called, whoever calls it first. Each
 * case is a process of its own: oneDNN takes one limit, once. */
#include "op/isa.h"
#include "support.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/conv.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/op/instructions.h"

#include <dlfcn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

/* Of oneDNN 2's dnnl_cpu_isa_t and dnnl_status_t. */
enum { ISA_AVX2 = 0x7, ISA_BF16 = 0xe7, TILE_BITS = 0x300, SUCCESS = 0, REFUSED = 2 };

int dnnl_set_max_cpu_isa(int isa);
int dnnl_get_effective_cpu_isa(void);

static int calls, asked, answered;

/* In place of the library's, which does it. */
int dnnl_set_max_cpu_isa(int isa)
{
    int (*real)(int);
    *(void **)&real = dlsym(RTLD_NEXT, "dnnl_set_max_cpu_isa");
    calls++;
    asked = isa;
    answered = real(isa);
    return answered;
}

static int by_convolution(void)
{
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = 48,
                                 .out = 48,
                                 .height = 8,
                                 .width = 8,
                                 .kernel = 1,
                                 .stride = 1,
                                 .slope = 1.0f,
                                 .method.backend = V2V_BACKEND_ONEDNN};
    int failed = v2v_conv_create(&conv, &spec) != V2V_OK;
    v2v_conv_destroy(&conv);
    return failed;
}

static int by_product(void)
{
    float a[4] = {1, 0, 0, 1}, b[4] = {1, 2, 3, 4}, c[4] = {0};
    v2v_gemm(V2V_BACKEND_ONEDNN, 0, 0, 2, 2, 2, 1.0f, a, 2, b, 2, 0.0f, c, 2);
    return c[3] != 4.0f;
}

static int by_kind(void)
{
    return v2v_op_bf16() < V2V_BF16_NONE;
}

static int by_number(void)
{
    return v2v_op_instructions() < 0;
}

static int (*const first_use[])(void) = {by_convolution, by_product, by_kind, by_number};
enum { USES = sizeof first_use / sizeof *first_use };

/* In a process of its own, with this limit of the user. */
static int in_child(int (*check)(int (*use)(void)), int (*use)(void), const char *name,
                    const char *limit)
{
    int status = 0;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        unsetenv("DNNL_MAX_CPU_ISA");
        unsetenv("ONEDNN_MAX_CPU_ISA");
        _exit(setenv(name, limit, 1) != 0 || check(use));
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/* A second limit is refused: oneDNN has looked at the first. */
static int is_kept_from_tiles(int (*use)(void))
{
    return use() || use() || calls != 1 || asked != ISA_BF16 || answered != SUCCESS ||
           (dnnl_get_effective_cpu_isa() & TILE_BITS) != 0 ||
           dnnl_set_max_cpu_isa(ISA_AVX2) != REFUSED;
}

static int is_left_to_user(int (*use)(void))
{
    return use() || calls != 0 || (dnnl_get_effective_cpu_isa() & ~ISA_AVX2) != 0 ||
           v2v_amx_usable();
}

static void onednn_never_sees_tiles(void **state)
{
    (void)state;
    static const char *const limits[] = {"", "ALL", "AVX512_CORE_AMX", "no such instructions"};
    for (int i = 0; i < USES; i++) {
        for (size_t k = 0; k < sizeof limits / sizeof *limits; k++) {
            assert_int_equal(
                in_child(is_kept_from_tiles, first_use[i], "DNNL_MAX_CPU_ISA", limits[k]), 0);
        }
    }
}

static void lower_limit_of_user_is_kept(void **state)
{
    (void)state;
    for (int i = 0; i < USES; i++) {
        assert_int_equal(in_child(is_left_to_user, first_use[i], "DNNL_MAX_CPU_ISA", "AVX2"), 0);
        assert_int_equal(in_child(is_left_to_user, first_use[i], "ONEDNN_MAX_CPU_ISA", "sse41"), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(onednn_never_sees_tiles),
        cmocka_unit_test(lower_limit_of_user_is_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
