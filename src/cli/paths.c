#include "cli/paths.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/conv.h"
#include "v2v3d/op/gemm.h"

#include <float.h>
#include <math.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

enum { FEW = 16, MANY = 48, SIDE = 24, TAPS = 9, THREADS = 2, LIMIT_SECONDS = 60 };

/* Exit codes of a process that tries a path, the worst of all ranks last: from 64 on, as libraries
 * end a process with small ones. What a shell would add to a signal's number. */
enum { PATH_IS_GOOD, PATH_IS_ABSENT = 64, PATH_IS_WRONG, PATH_FAILED, BY_SIGNAL = 128 };

/* One side adds up TAPS * channels products below 1: so many times this it may err by. Minimal
 * filtering loses up to 10 times more; bf16 rounds both factors to 8 bits. */
#define ROUNDS FLT_EPSILON
#define ROUNDS_TRANSFORMED (10.0 * FLT_EPSILON)
#define ROUNDS_BF16 0x1p-8

static const struct path {
    const char *name, *remedy;
    int channels;
    struct v2v_conv_method method;
    double rounds;
} paths[] = {
    {"own kernels", "a build with -DV2V_SIMD=OFF", FEW, {.backend = V2V_BACKEND_ONEDNN}, ROUNDS},
    {"Winograd",
     "--set model.winograd=false, or a build with -DV2V_SIMD=OFF",
     MANY,
     {.winograd = 1},
     ROUNDS_TRANSFORMED},
    {"oneDNN",
     "DNNL_MAX_CPU_ISA=AVX2 in the environment, or --set model.backend=openblas",
     MANY,
     {.backend = V2V_BACKEND_ONEDNN},
     ROUNDS_TRANSFORMED},
    {"OpenBLAS",
     "OPENBLAS_CORETYPE=Haswell in the environment, or --set model.backend=onednn",
     MANY,
     {.backend = V2V_BACKEND_OPENBLAS},
     ROUNDS},
    {"bf16",
     "DNNL_MAX_CPU_ISA=AVX512_CORE_BF16 (no tile unit) or AVX512_CORE (no bf16) in the "
     "environment, or no precision bf16",
     MANY,
     {.precision = V2V_PRECISION_BF16},
     ROUNDS_BF16},
};
enum { PATHS = sizeof paths / sizeof *paths };

/* ---- the process that tries ---- */

/* One output pixel by plain loops in double precision. */
static double plain_pixel(const float *in, const float *weight, int channels, int y, int x)
{
    double sum = 0.0;
    for (int c = 0; c < channels; c++) {
        for (int k = 0; k < TAPS; k++) {
            int sy = y + k / 3 - 1, sx = x + k % 3 - 1;
            if (sy >= 0 && sy < SIDE && sx >= 0 && sx < SIDE) {
                sum += (double)in[(c * SIDE + sy) * SIDE + sx] * weight[c * TAPS + k];
            }
        }
    }
    return sum;
}

static double error_of(const float *out, const float *in, const float *weight, int channels)
{
    double error = 0.0;
    for (int i = 0; i < channels * SIDE * SIDE; i++) {
        int o = i / (SIDE * SIDE), y = i / SIDE % SIDE, x = i % SIDE;
        const float *of_output = weight + (int64_t)o * channels * TAPS;
        double here = fabs(out[i] - plain_pixel(in, of_output, channels, y, x));
        error = here <= error ? error : here; /* NaN stays */
    }
    return error;
}

static enum v2v_status convolve(double *error, const struct path *path)
{
    static float in[MANY * SIDE * SIDE], out[MANY * SIDE * SIDE];
    static float weight[MANY * MANY * TAPS], bias[MANY];
    enum v2v_status rc = V2V_OK;
    struct v2v_workspace workspace = {0};
    struct v2v_conv *conv = NULL;
    struct v2v_conv_spec spec = {.batch = 1,
                                 .in = path->channels,
                                 .out = path->channels,
                                 .height = SIDE,
                                 .width = SIDE,
                                 .kernel = 3,
                                 .stride = 1,
                                 .slope = 1.0f,
                                 .method = path->method};
    spec.method.workspace = &workspace;
    for (int i = 0; i < path->channels * SIDE * SIDE; i++) {
        in[i] = (float)v2v_random_rule("in", 1, (uint64_t)i);
    }
    for (int i = 0; i < path->channels * path->channels * TAPS; i++) {
        weight[i] = (float)v2v_random_rule("weight", 1, (uint64_t)i);
    }
    V2V_TRY(v2v_conv_create(&conv, &spec));
    v2v_conv_set_weights(conv, weight, bias);
    v2v_conv_forward(conv, out, in);
    *error = error_of(out, in, weight, path->channels);
done:
    v2v_conv_destroy(&conv);
    v2v_workspace_fini(&workspace);
    return rc;
}

int v2v_cli_try_path(const char *number)
{
    int64_t i = 0;
    double error = INFINITY;
    alarm(LIMIT_SECONDS);
    prctl(PR_SET_DUMPABLE, 0); /* its end is looked at: no core file */
    if (v2v_text_to_i64(&i, number, 0, PATHS - 1, V2V_CLI_TRY_PATH, V2V_E_USAGE) != V2V_OK) {
        return PATH_FAILED;
    }
    v2v_op_set_threads(THREADS);
    if (paths[i].method.precision != V2V_PRECISION_F32 && v2v_op_bf16() == V2V_BF16_NONE) {
        return PATH_IS_ABSENT;
    }
    if (convolve(&error, &paths[i]) != V2V_OK) {
        return PATH_FAILED;
    }
    return error <= paths[i].rounds * TAPS * paths[i].channels ? PATH_IS_GOOD : PATH_IS_WRONG;
}

/* ---- the program ---- */

/* This program again, silent. posix_spawn does not copy this process's memory, which a network's
 * adapter may be about to write. */
static int try_apart(int path)
{
    extern char **environ;
    char program[] = "v2v3d", option[] = V2V_CLI_TRY_PATH, number[16];
    char *const words[] = {program, option, number, NULL};
    posix_spawn_file_actions_t silence;
    pid_t child = 0;
    int status = 0, code = PATH_FAILED;
    snprintf(number, sizeof number, "%d", path);
    if (posix_spawn_file_actions_init(&silence) != 0) {
        return code;
    }
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++) {
        posix_spawn_file_actions_addopen(&silence, fd, "/dev/null", fd > 0, 0);
    }
    if (posix_spawn(&child, "/proc/self/exe", &silence, NULL, words, environ) == 0 &&
        waitpid(child, &status, 0) == child) {
        code = WIFSIGNALED(status) ? BY_SIGNAL + WTERMSIG(status) : WEXITSTATUS(status);
        code = code > PATH_IS_GOOD && code < PATH_IS_ABSENT ? PATH_FAILED : code;
    }
    posix_spawn_file_actions_destroy(&silence);
    return code;
}

static int is_used(const struct path *path, const struct v2v_config *config)
{
    const struct v2v_conv_method *method = &path->method;
    if (method->precision != V2V_PRECISION_F32) {
        return config->train.precision != V2V_PRECISION_F32 ||
               config->recon.precision != V2V_PRECISION_F32;
    }
    if (method->winograd) {
        return config->model.winograd;
    }
    return path->channels == FEW || config->model.backend == method->backend;
}

static void print_result(const struct path *path, int code, int used)
{
    printf("convolution, %-17s  ", path->name);
    if (code == PATH_IS_GOOD || code == PATH_IS_ABSENT) {
        printf(code == PATH_IS_GOOD ? "ok\n" : "not here\n");
        return;
    }
    if (code == BY_SIGNAL + SIGALRM) {
        printf("FAILED: no end after %d s", LIMIT_SECONDS);
    } else if (code > BY_SIGNAL) {
        printf("FAILED: died, %s", strsignal(code - BY_SIGNAL));
    } else {
        printf("FAILED: %s", code == PATH_IS_WRONG ? "wrong numbers" : "could not be tried");
    }
    printf("; %swhat helps: %s\n", used ? "" : "these settings do not use it; ", path->remedy);
}

void v2v_cli_try_paths(int *failed, const struct v2v_session *session)
{
    for (int i = 0; i < PATHS; i++) {
        int64_t worst = try_apart(i);
        int used = is_used(&paths[i], &session->config);
        v2v_par_max_i64(session->world, &worst, 1);
        *failed += used && worst != PATH_IS_GOOD && worst != PATH_IS_ABSENT;
        if (v2v_comm_rank(session->world) == 0) {
            print_result(&paths[i], (int)worst, used);
        }
    }
}
