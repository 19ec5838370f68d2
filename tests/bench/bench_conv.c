/* GFLOP/s of every convolution backend on the network's layers (REFERENCE.md 4): forward, gradient
 * of the data, gradient of the weights.
 *   bench_conv [THREADS [NAME]]     NAME: part of a layer's name */
#include "op/conv_backend.h"
#include "op/isa.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/gemm.h"
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct layer {
    const char *name;
    struct v2v_conv_spec spec;
} layers[] = {
    {"encoder 1->4 3x3 512", {13, 1, 4, 512, 512, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 4->4 3x3 512", {13, 4, 4, 512, 512, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 4->4 3x3 128", {13, 4, 4, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 4->8 3x3 128", {13, 4, 8, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 4->8 1x1 128", {13, 4, 8, 128, 128, 1, 1, 1.0f, 1, 0, {0}, 0, 0}},
    {"encoder 8->8 3x3 128", {13, 8, 8, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 8->16 3x3 128", {13, 8, 16, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 16->16 3x3 128", {13, 16, 16, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 16->16 3x3 512", {13, 16, 16, 512, 512, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 28->16 3x3 128", {13, 28, 16, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 16->4 1x1 128", {13, 16, 4, 128, 128, 1, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"encoder 16->4 1x1 16", {13, 16, 4, 16, 16, 1, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 16->16 3x3 16", {1, 16, 16, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 16->32 3x3 8", {1, 16, 32, 8, 8, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 16->32 3x3 32", {1, 16, 32, 32, 32, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 16->32 3x3 128", {4, 16, 32, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 32->32 3x3 128", {2, 32, 32, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 32->39 3x3 128", {2, 32, 39, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 32->32 3x3 16", {1, 32, 32, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 32->64 3x3 8", {1, 32, 64, 8, 8, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 64->32 3x3 128", {1, 64, 32, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"crossover 64->64 3x3 128", {1, 64, 64, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"deep 48->16 3x3 128", {1, 48, 16, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"deep 144->16 3x3 128", {1, 144, 16, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"deep 96->32 3x3 64", {1, 96, 32, 64, 64, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"deep 384->128 3x3 16", {1, 384, 128, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 1024->512 3x3 128", {1, 1024, 512, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 512->256 3x3 128", {1, 512, 256, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 256->128 3x3/2 128", {1, 256, 128, 128, 128, 3, 2, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 128->64 3x3 128", {1, 128, 64, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 128->39 3x3 128", {1, 128, 39, 128, 128, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 896->384 3x3 16", {1, 896, 384, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 512->512 3x3 16", {1, 512, 512, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 256->384 3x3 16", {1, 256, 384, 16, 16, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
    {"U-Net 384->512 3x3 8", {1, 384, 512, 8, 8, 3, 1, 0.01f, 1, 0, {0}, 0, 0}},
};

static const struct v2v_conv_backend *const backends[] = {&v2v_conv_direct, &v2v_conv_winograd,
                                                          &v2v_conv_onednn, &v2v_conv_openblas,
                                                          &v2v_conv_bf16,   &v2v_conv_amx};

struct buffers {
    float *in, *out, *weight, *bias, *dweight, *dbias;
};

enum pass { FORWARD, DATA, WEIGHTS, PACK, PASSES };

static void run(struct v2v_conv *conv, const struct buffers *b, enum pass pass)
{
    switch (pass) {
    case FORWARD:
        v2v_conv_forward(conv, b->out, b->in);
        break;
    case DATA:
        v2v_conv_backward_data(conv, b->in, b->out);
        break;
    case WEIGHTS:
        v2v_conv_backward_weights(conv, b->dweight, b->dbias, b->in, b->out);
        break;
    default:
        v2v_conv_set_weights(conv, b->weight, b->bias);
    }
}

/** Seconds of the fastest of the runs that fit into a third of a second, at least two. */
static double fastest(struct v2v_conv *conv, const struct buffers *b, enum pass pass)
{
    double best = 1e30;
    double end = v2v_clock_now() + 0.33;
    for (int i = 0; i < 2 || v2v_clock_now() < end; i++) {
        double start = v2v_clock_now();
        run(conv, b, pass);
        double seconds = v2v_clock_now() - start;
        best = seconds < best ? seconds : best;
    }
    return best;
}

static enum v2v_status fill(float **array, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(V2V_ALLOC(*array, "bench", count));
    for (int64_t i = 0; i < count; i++) {
        (*array)[i] = (float)v2v_random_uniform(1, 0, (uint64_t)i) - 0.5f;
    }
done:
    return rc;
}

/* GFLOP/s are those of the direct sums, whatever a backend saves. */
static enum v2v_status measure(const struct layer *layer, const struct v2v_conv_backend *backend)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_workspace workspace = {0};
    struct v2v_conv_spec with_workspace = layer->spec;
    const struct v2v_conv_spec *spec = &with_workspace;
    with_workspace.method.workspace = &workspace;
    struct buffers b = {0};
    struct v2v_conv *conv = NULL;
    int64_t taps = (int64_t)spec->kernel * spec->kernel;
    int64_t outputs = spec->batch * spec->out * conv_out_height(spec) * conv_out_width(spec);
    V2V_TRY(fill(&b.in, spec->batch * spec->in * spec->height * spec->width));
    V2V_TRY(fill(&b.out, outputs));
    V2V_TRY(fill(&b.weight, spec->out * spec->in * taps));
    V2V_TRY(fill(&b.dweight, spec->out * spec->in * taps));
    V2V_TRY(fill(&b.bias, spec->out));
    V2V_TRY(fill(&b.dbias, spec->out));
    double held = (double)v2v_mem_held();
    V2V_TRY(v2v_conv_create_with(&conv, spec, backend));
    v2v_conv_set_weights(conv, b.weight, b.bias);
    double gflop = 2e-9 * (double)(outputs * spec->in * taps);
    double seconds[PASSES];
    for (int pass = 0; pass < PASSES; pass++) {
        seconds[pass] = fastest(conv, &b, (enum pass)pass);
    }
    printf("%-26s %-9s %7.1f %7.1f %7.1f GFLOP/s  %8.3f ms forward  %7.3f ms pack  %6.1f MB\n",
           layer->name, backend->name, gflop / seconds[FORWARD], gflop / seconds[DATA],
           gflop / seconds[WEIGHTS], 1e3 * seconds[FORWARD], 1e3 * seconds[PACK],
           1e-6 * ((double)v2v_mem_held() - held));
    fflush(stdout);
done:
    v2v_conv_destroy(&conv);
    v2v_workspace_fini(&workspace);
    float *owned[] = {b.in, b.out, b.weight, b.dweight, b.bias, b.dbias};
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++) {
        v2v_mem_free(owned[i]);
    }
    return rc;
}

static int applies(const struct v2v_conv_backend *backend, const struct v2v_conv_spec *spec)
{
    if (backend == &v2v_conv_direct) {
        return spec->stride == 1 && spec->in * spec->out <= 128 * 64;
    }
    if (backend == &v2v_conv_amx) {
        return v2v_amx_usable();
    }
    if (backend == &v2v_conv_bf16) {
        return v2v_op_bf16() >= V2V_BF16_NATIVE;
    }
    return backend != &v2v_conv_winograd || (spec->kernel == 3 && spec->stride == 1);
}

int main(int argc, char **argv)
{
    long threads = argc > 1 ? strtol(argv[1], NULL, 10) : omp_get_num_procs();
    v2v_op_set_threads(threads >= 1 && threads <= 4096 ? (int)threads : 1);
    printf("%d threads; forward, data, weights\n", omp_get_max_threads());
    for (size_t i = 0; i < sizeof layers / sizeof *layers; i++) {
        if (argc > 2 && strstr(layers[i].name, argv[2]) == NULL) {
            continue;
        }
        for (size_t j = 0; j < sizeof backends / sizeof *backends; j++) {
            if (!applies(backends[j], &layers[i].spec)) {
                continue;
            }
            if (measure(&layers[i], backends[j]) != V2V_OK) {
                fprintf(stderr, "%s\n", v2v_status_message());
                return 1;
            }
        }
    }
    return 0;
}
