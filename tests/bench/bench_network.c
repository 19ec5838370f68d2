/* The paper's network computed in every way that there is: its time beside what the machine allows,
 * and its error against the twin in double precision, which shares no code with it.
 *   bench_network PSF [SIDE [WIDTH [TURNS]]]
 * A forward pass over SIDE x SIDE pixels (256) and a training step's forward and backward pass over
 * half the sides; weights and views by rule. Ways take turns; medians. The floor: multiply-adds
 * over the rate of a large float32 matrix product, or bytes over the copy rate, whichever takes
 * longer; three times that of a forward pass for a step (itself, gradients of data, of weights).
 */
#include "network/network_twin.h"
#include "network/work.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/v2v/schema.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BRANCHES = 2, MOST_TURNS = 99, RULE_SEED = 7 };

/* Winograd needs no word where it is on. */
static const struct way {
    const char *name;
    int backend, winograd, every_slice, precision;
} ways[] = {
    {"float32, Winograd, merged taps", V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
    {"Winograd off", V2V_BACKEND_ONEDNN, 0, 0, V2V_PRECISION_F32},
    {"merging off", V2V_BACKEND_ONEDNN, 1, 1, V2V_PRECISION_F32},
    {"both off", V2V_BACKEND_ONEDNN, 0, 1, V2V_PRECISION_F32},
    {"OpenBLAS, Winograd off", V2V_BACKEND_OPENBLAS, 0, 0, V2V_PRECISION_F32},
    {"bf16", V2V_BACKEND_ONEDNN, 0, 0, V2V_PRECISION_BF16},
};
enum { WAYS = sizeof ways / sizeof ways[0] };

struct bench {
    struct v2v_psf_file psf;
    struct v2v_shifts shifts;
    struct v2v_fields fields;
    int64_t side, width, turns;
    float *views, *weights, *volume[BRANCHES];
    double *twin[BRANCHES];
    double macs_a_second, bytes_a_second;
};

struct row {
    float forward_s[MOST_TURNS], step_s[MOST_TURNS]; /* by turn */
    double error[BRANCHES];
};

static struct v2v_model_spec spec_of(const struct bench *b, const struct way *way)
{
    return (struct v2v_model_spec){.views = b->psf.views,
                                   .slices = b->psf.slices,
                                   .width = b->width,
                                   .features = 4,
                                   .branches = V2V_BRANCH_BOTH,
                                   .backend = way->backend,
                                   .winograd = way->winograd,
                                   .every_slice = way->every_slice,
                                   .precision = way->precision,
                                   .volume_scale = 1.0};
}

static int can_run(const struct way *way)
{
    return way->precision == V2V_PRECISION_F32 || v2v_op_bf16() >= V2V_BF16_NATIVE;
}

static enum v2v_status prepare(struct bench *b, const char *path)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_psf_read(&b->psf, path, "", V2V_NORMALIZE_VIEW, NULL));
    V2V_TRY(v2v_shifts_from_psf(&b->shifts, &b->psf));
    const struct v2v_model_spec spec = spec_of(b, &ways[0]);
    const int64_t pixels = b->psf.views * b->side * b->side;
    const int64_t voxels = b->psf.slices * b->side * b->side;
    V2V_TRY(v2v_model_schema(&b->fields, &spec));
    V2V_TRY(V2V_ALLOC(b->weights, "bench", b->fields.total));
    V2V_TRY(v2v_rule_weights(&b->fields, b->weights, V2V_RULE_HASH, RULE_SEED));
    V2V_TRY(V2V_ALLOC(b->views, "bench", pixels));
    for (int64_t i = 0; i < pixels; i++) {
        b->views[i] = (float)(0.2 + 0.2 * v2v_random_rule("lfi", 0, (uint64_t)i));
    }
    for (int k = 0; k < BRANCHES; k++) {
        V2V_TRY(V2V_ALLOC(b->volume[k], "bench", voxels));
        V2V_TRY(V2V_ALLOC(b->twin[k], "bench", voxels));
    }
    V2V_TRY(v2v_network_twin(b->twin, &spec, &b->shifts, &b->fields, b->weights, b->views, b->side,
                             b->side));
done:
    return rc;
}

static void forget(struct bench *b)
{
    for (int k = 0; k < BRANCHES; k++) {
        v2v_mem_free(b->twin[k]);
        v2v_mem_free(b->volume[k]);
    }
    v2v_mem_free(b->views);
    v2v_mem_free(b->weights);
    v2v_fields_fini(&b->fields);
    v2v_shifts_fini(&b->shifts);
    v2v_psf_file_fini(&b->psf);
}

/* ---- what the machine can do: the best of all tries ---- */

static enum v2v_status measure_machine(struct bench *b)
{
    enum { SIZE = 2048, PIECE = 1 << 20, COPIED = 256 << 20 };
    enum v2v_status rc = V2V_OK;
    float *matrices = NULL;
    char *from = NULL, *to = NULL;
    const int64_t count = (int64_t)SIZE * SIZE;
    V2V_TRY(V2V_ALLOC(matrices, "bench", 3 * count));
    V2V_TRY(V2V_ALLOC(from, "bench", COPIED));
    V2V_TRY(V2V_ALLOC(to, "bench", COPIED));
    for (int64_t i = 0; i < 2 * count; i++) {
        matrices[i] = 1.0f / (float)(1 + i % 7);
    }
    memset(from, 1, COPIED); /* untouched pages would all be one zero page */
    for (int try = 0; try < 4; try++) {
        double start = v2v_clock_now();
        v2v_gemm(try % 2 == 0 ? V2V_BACKEND_ONEDNN : V2V_BACKEND_OPENBLAS, 0, 0, SIZE, SIZE, SIZE,
                 1.0f, matrices, SIZE, matrices + count, SIZE, 0.0f, matrices + 2 * count, SIZE);
        const double taken = v2v_clock_now() - start;
        b->macs_a_second = fmax(b->macs_a_second, (double)SIZE * (double)count / taken);
        start = v2v_clock_now();
#pragma omp parallel for schedule(static)
        for (int at = 0; at < COPIED; at += PIECE) {
            memcpy(to + at, from + at, PIECE);
        }
        b->bytes_a_second = fmax(b->bytes_a_second, 2.0 * COPIED / (v2v_clock_now() - start));
    }
done:
    v2v_mem_free(to);
    v2v_mem_free(from);
    v2v_mem_free(matrices);
    return rc;
}

/* ---- one way, one turn ---- */

static double error_of(const struct bench *b, int branch)
{
    double difference = 0.0, norm = 0.0;
    for (int64_t i = 0; i < b->psf.slices * b->side * b->side; i++) {
        const double twin = b->twin[branch][i], d = b->volume[branch][i] - twin;
        difference += d * d;
        norm += twin * twin;
    }
    return sqrt(difference / norm);
}

/* Seconds of the second of two passes; the first one touches the memory. */
static double time_passes(struct bench *b, struct v2v_model *model, int training)
{
    double start = 0.0;
    for (int pass = 0; pass < 2; pass++) {
        start = v2v_clock_now();
        v2v_model_forward(model, b->volume[0], b->volume[1], b->views);
        if (training) {
            v2v_model_backward(model, b->volume[0], b->volume[1]);
        }
    }
    return v2v_clock_now() - start;
}

/* The model lives for one measurement: all of them together would not fit into memory. */
static enum v2v_status measure(struct bench *b, const struct way *way, struct row *row,
                               int64_t turn)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec spec = spec_of(b, way);
    struct v2v_model *model = NULL;
    V2V_TRY(v2v_model_create(&model, &spec, &b->shifts));
    memcpy(v2v_model_weights(model), b->weights, (size_t)b->fields.total * sizeof *b->weights);
    V2V_TRY(v2v_model_plan(model, b->side, b->side, 0));
    row->forward_s[turn] = (float)time_passes(b, model, 0);
    for (int k = 0; k < BRANCHES; k++) {
        row->error[k] = error_of(b, k);
    }
    V2V_TRY(v2v_model_plan(model, b->side / 2, b->side / 2, 1));
    row->step_s[turn] = (float)time_passes(b, model, 1);
done:
    v2v_model_destroy(&model);
    return rc;
}

/* ---- printing ---- */

static enum v2v_status print_row(const struct bench *b, const struct way *way, struct row *row)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_model_spec spec = spec_of(b, way);
    struct v2v_work work;
    double floor_s[2], forward_s = 0.0, step_s = 0.0;
    for (int k = 0; k < 2; k++) {
        V2V_TRY(v2v_work_of(&work, &spec, &b->shifts, b->side >> k, b->side >> k));
        floor_s[k] = fmax(work.macs / b->macs_a_second, work.bytes / b->bytes_a_second);
    }
    V2V_TRY(v2v_percentile(&forward_s, row->forward_s, b->turns, 50.0));
    V2V_TRY(v2v_percentile(&step_s, row->step_s, b->turns, 50.0));
    printf("%-32s  %9.4f  ", way->name, forward_s);
    if (way->precision == V2V_PRECISION_F32) { /* whose rate was measured */
        printf("%8.4f  %9.4f  %8.4f", floor_s[0], step_s, 3.0 * floor_s[1]);
    } else {
        printf("%8s  %9.4f  %8s", "-", step_s, "-");
    }
    printf("  %8.1e  %8.1e\n", row->error[0], row->error[1]);
done:
    return rc;
}

static enum v2v_status run(struct bench *b, const char *path)
{
    enum v2v_status rc = V2V_OK;
    static struct row rows[WAYS];
    V2V_TRY(prepare(b, path));
    for (int64_t turn = 0; turn < b->turns; turn++) {
        V2V_TRY(measure_machine(b));
        for (int i = 0; i < WAYS; i++) {
            if (can_run(&ways[i])) {
                V2V_TRY(measure(b, &ways[i], &rows[i], turn));
            }
        }
    }
    printf("width %" PRId64 ", forward pass over %" PRId64 "^2, step over %" PRId64
           "^2 pixels; floors: %.1f G multiply-adds/s, %.1f GB/s\n%-32s  %9s  %8s  %9s  %8s  %8s  "
           "%8s\n",
           b->width, b->side, b->side / 2, 1e-9 * b->macs_a_second, 1e-9 * b->bytes_a_second, "",
           "forward s", "floor s", "step s", "floor s", "error 1", "error 2");
    for (int i = 0; i < WAYS; i++) {
        if (can_run(&ways[i])) {
            V2V_TRY(print_row(b, &ways[i], &rows[i]));
        }
    }
done:
    return rc;
}

static int64_t number(int argc, char **argv, int i, int64_t otherwise, int64_t most)
{
    const int64_t given = argc > i ? strtoll(argv[i], NULL, 10) : otherwise;
    return given >= 1 && given <= most ? given : otherwise;
}

int main(int argc, char **argv)
{
    struct bench b = {.side = number(argc, argv, 2, 256, 16384),
                      .width = number(argc, argv, 3, 128, 1024),
                      .turns = number(argc, argv, 4, 3, MOST_TURNS)};
    if (argc < 2 || b.side % (2 * V2V_MODEL_GRID) != 0) {
        fprintf(stderr, "bench_network PSF [SIDE [WIDTH [TURNS]]], SIDE a multiple of %d\n",
                2 * V2V_MODEL_GRID);
        return 2;
    }
    const enum v2v_status rc = run(&b, argv[1]);
    if (rc != V2V_OK) {
        fprintf(stderr, "%s\n", v2v_status_message());
    }
    forget(&b);
    return rc == V2V_OK ? 0 : 1;
}
