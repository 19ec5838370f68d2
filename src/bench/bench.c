#include "v2v3d/bench/bench.h"

#include "bench/floor.h"
#include "bench/judge.h"
#include "bench/variants.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/loss/loss.h"
#include "v2v3d/nn/adam.h"
#include "v2v3d/op/bf16.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

enum { BRANCHES = V2V_JUDGE_BRANCHES };

struct bench {
    const struct v2v_bench_job *job;
    struct v2v_bench_result *result;
    struct v2v_shifts shifts;
    struct v2v_variant variant[V2V_BENCH_MOST_ROWS];
    struct v2v_judge judge[V2V_BENCH_MOST_ROWS]; /* one a width */
    int64_t judges;
    float *volume[BRANCHES], *dvolume[BRANCHES]; /* of a frame; of a step: its first part */
    float *step_views;                           /* [v,step_size,step_size] */
    struct v2v_loss *loss;                       /* of a step */
    double *forward, *step, *step_forward;       /* seconds [rows, repeat]; the last within step */
};

static struct v2v_judge *judge_of(struct bench *bench, int64_t width)
{
    int64_t i = 0;
    while (i < bench->judges && bench->judge[i].width != width) {
        i++;
    }
    return i < bench->judges ? &bench->judge[i] : NULL;
}

static enum v2v_status stop_when_asked(void)
{
    return v2v_stop_requested() ? V2V_FAIL(V2V_STOPPED, "stopped on request") : V2V_OK;
}

/* The upper left part of the frame. */
static void cut_step_views(struct bench *bench)
{
    int64_t size = bench->job->size, side = bench->job->step_size;
    for (int64_t row = 0; row < bench->job->psf->views * side; row++) {
        memcpy(bench->step_views + row * side,
               bench->job->views + (row / side * size + row % side) * size,
               (size_t)side * sizeof(float));
    }
}

static enum v2v_status take_memory(struct bench *bench)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_job *job = bench->job;
    int64_t voxels = v2v_mem_product(job->psf->slices, job->size, job->size);
    int64_t side = job->step_size;
    struct v2v_loss_setup setup = {.settings = &job->config->loss,
                                   .psf = job->psf,
                                   .reduce = job->config->psf.reduce,
                                   .height = side,
                                   .width = side,
                                   .window = {0, side, 0, side}};
    for (int b = 0; b < BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(bench->volume[b], "bench.volumes", voxels));
        V2V_TRY(V2V_ALLOC(bench->dvolume[b], "bench.volumes", voxels));
    }
    V2V_TRY(
        V2V_ALLOC(bench->step_views, "bench.views", v2v_mem_product(job->psf->views, side, side)));
    V2V_TRY(V2V_ALLOC(bench->forward, "bench.seconds", V2V_BENCH_MOST_ROWS * job->repeat));
    V2V_TRY(V2V_ALLOC(bench->step, "bench.seconds", V2V_BENCH_MOST_ROWS * job->repeat));
    V2V_TRY(V2V_ALLOC(bench->step_forward, "bench.seconds", V2V_BENCH_MOST_ROWS * job->repeat));
    cut_step_views(bench);
    V2V_TRY(v2v_loss_create(&bench->loss, &setup));
done:
    return rc;
}

static enum v2v_status make_judges(struct bench *bench)
{
    enum v2v_status rc = V2V_OK;
    for (int64_t i = 0; i < bench->result->rows; i++) {
        const struct v2v_variant *variant = &bench->variant[i];
        if (judge_of(bench, variant->width) == NULL) {
            V2V_TRY(stop_when_asked());
            v2v_log(V2V_LOG_INFO, "twin in double precision, width %lld",
                    (long long)variant->width);
            struct v2v_judge *judge = &bench->judge[bench->judges++];
            V2V_TRY(v2v_judge_init(judge, variant, bench->job, &bench->shifts));
        }
    }
    bench->result->twin_psnr = judge_of(bench, bench->job->width)->psnr;
done:
    return rc;
}

/* ---- one variant, one round ---- */

/* Seconds of the second of two forward passes. */
static double time_forward(struct bench *bench, struct v2v_model *model)
{
    double started = 0.0;
    for (int pass = 0; pass < 2; pass++) {
        started = v2v_clock_now();
        v2v_model_forward(model, bench->volume[0], bench->volume[1], bench->job->views);
    }
    return v2v_clock_now() - started;
}

/* Forward, losses, backward, Adam, new weights. Returns the forward pass's seconds. */
static double run_step(struct bench *bench, struct v2v_model *model, float *m, float *v,
                       int64_t step)
{
    const struct v2v_train_settings *train = &bench->job->config->train;
    const float *const volume[BRANCHES] = {bench->volume[0], bench->volume[1]};
    int64_t total = v2v_model_fields(model)->total;
    double terms[V2V_LOSS_TERMS];
    struct v2v_adam adam = {.learning_rate = train->learning_rate,
                            .beta1 = train->beta1,
                            .beta2 = train->beta2,
                            .epsilon = train->epsilon};
    double forward_s = v2v_clock_now();
    v2v_model_forward(model, bench->volume[0], bench->volume[1], bench->step_views);
    forward_s = v2v_clock_now() - forward_s;
    v2v_loss_evaluate(bench->loss, terms, V2V_BRANCH_BOTH, bench->dvolume, volume,
                      bench->step_views);
    v2v_model_backward(model, bench->dvolume[0], bench->dvolume[1]);
    v2v_adam_step(&adam, v2v_model_weights(model), m, v, v2v_model_gradients(model), total, step);
    v2v_model_weights_changed(model);
    return forward_s;
}

/* Seconds of the second of two steps. */
static enum v2v_status time_step(double *seconds, double *forward_s, struct bench *bench,
                                 struct v2v_model *model)
{
    enum v2v_status rc = V2V_OK;
    float *m = NULL, *v = NULL;
    int64_t total = v2v_model_fields(model)->total;
    V2V_TRY(V2V_ALLOC(m, "adam.m", total));
    V2V_TRY(V2V_ALLOC(v, "adam.v", total));
    V2V_TRY(v2v_model_plan(model, bench->job->step_size, bench->job->step_size, 1));
    for (int64_t step = 1; step <= 2; step++) {
        double started = v2v_clock_now();
        *forward_s = run_step(bench, model, m, v, step);
        *seconds = v2v_clock_now() - started;
    }
done:
    v2v_mem_free(v);
    v2v_mem_free(m);
    return rc;
}

/* The model lives for one measurement: all of them together would not fit into memory. */
static enum v2v_status measure(struct bench *bench, int64_t i, int64_t round)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_job *job = bench->job;
    struct v2v_bench_row *row = &bench->result->row[i];
    struct v2v_model_spec spec = v2v_variant_spec(&bench->variant[i], job);
    const struct v2v_judge *judge = judge_of(bench, spec.width);
    struct v2v_model *model = NULL;
    double *forward = &bench->forward[i * job->repeat + round];
    double *step = &bench->step[i * job->repeat + round];
    double *step_forward = &bench->step_forward[i * job->repeat + round];
    size_t held = v2v_mem_held();
    V2V_TRY(stop_when_asked());
    V2V_TRY(v2v_model_create(&model, &spec, &bench->shifts));
    V2V_ASSERT(v2v_model_fields(model)->total == judge->fields.total);
    memcpy(v2v_model_weights(model), judge->weights,
           (size_t)judge->fields.total * sizeof *judge->weights);
    V2V_TRY(v2v_model_plan(model, job->size, job->size, 0));
    row->model_bytes = (double)(v2v_mem_held() - held);
    *forward = time_forward(bench, model);
    row->computed_part = v2v_model_computed_part(model);
    if (round == 0) {
        V2V_TRY(v2v_judge_row(row, judge, job, bench->volume));
    }
    V2V_TRY(time_step(step, step_forward, bench, model));
    v2v_log(V2V_LOG_INFO, "round %lld of %lld, %s: forward %.3f s, step %.3f s",
            (long long)round + 1, (long long)job->repeat, row->name, *forward, *step);
done:
    v2v_model_destroy(&model);
    return rc;
}

/* ---- from seconds to rows ---- */

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int64_t count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return (values[(count - 1) / 2] + values[count / 2]) / 2.0;
}

/* The rate of multiply-adds was measured in float32. */
static double floor_of(const struct bench *bench, const struct v2v_model_spec *spec,
                       const struct v2v_work *work)
{
    return spec->precision == V2V_PRECISION_F32 ? v2v_floor_seconds(&bench->result->rates, work)
                                                : NAN;
}

static enum v2v_status finish_row(struct bench *bench, int64_t i)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_job *job = bench->job;
    struct v2v_bench_row *row = &bench->result->row[i];
    struct v2v_model_spec spec = v2v_variant_spec(&bench->variant[i], job);
    struct v2v_work work;
    V2V_TRY(v2v_work_of(&work, &spec, &bench->shifts, job->size, job->size));
    row->macs = work.macs;
    row->bytes = work.bytes;
    row->forward_floor_s = floor_of(bench, &spec, &work);
    V2V_TRY(v2v_work_of(&work, &spec, &bench->shifts, job->step_size, job->step_size));
    row->step_floor_s = 3.0 * floor_of(bench, &spec, &work);
    row->forward_s = median(bench->forward + i * job->repeat, job->repeat);
    row->step_s = median(bench->step + i * job->repeat, job->repeat);
    row->step_forward_s = median(bench->step_forward + i * job->repeat, job->repeat);
done:
    return rc;
}

static double peak_resident(void)
{
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024.0 * (double)usage.ru_maxrss : NAN;
}

static void bench_fini(struct bench *bench)
{
    for (int64_t i = 0; i < bench->judges; i++) {
        v2v_judge_fini(&bench->judge[i]);
    }
    v2v_loss_destroy(&bench->loss);
    for (int b = 0; b < BRANCHES; b++) {
        v2v_mem_free(bench->volume[b]);
        v2v_mem_free(bench->dvolume[b]);
    }
    v2v_mem_free(bench->step_views);
    v2v_mem_free(bench->forward);
    v2v_mem_free(bench->step);
    v2v_mem_free(bench->step_forward);
    v2v_shifts_fini(&bench->shifts);
}

enum v2v_status v2v_bench_run(struct v2v_bench_result *result, const struct v2v_bench_job *job)
{
    enum v2v_status rc = V2V_OK;
    struct bench bench = {.job = job, .result = result};
    V2V_ASSERT(job->step_size <= job->size && job->repeat >= V2V_BENCH_LEAST_REPEAT &&
               job->repeat <= V2V_BENCH_MOST_REPEAT);
    *result = (struct v2v_bench_result){.views = job->psf->views,
                                        .slices = job->psf->slices,
                                        .size = job->size,
                                        .step_size = job->step_size,
                                        .repeat = job->repeat,
                                        .bf16 = v2v_op_bf16()};
    result->rows = v2v_variants_list(bench.variant, job);
    for (int64_t i = 0; i < result->rows; i++) {
        result->row[i] = (struct v2v_bench_row){.name = bench.variant[i].name,
                                                .id = bench.variant[i].id,
                                                .width = bench.variant[i].width};
    }
    V2V_TRY(v2v_shifts_from_psf(&bench.shifts, job->psf));
    V2V_TRY(make_judges(&bench));
    V2V_TRY(take_memory(&bench));
    for (int64_t round = 0; round < job->repeat; round++) {
        V2V_TRY(v2v_floor_measure(&result->rates));
        for (int64_t i = 0; i < result->rows; i++) {
            V2V_TRY(measure(&bench, i, round));
        }
    }
    for (int64_t i = 0; i < result->rows; i++) {
        V2V_TRY(finish_row(&bench, i));
    }
    result->peak_bytes = peak_resident();
done:
    bench_fini(&bench);
    return rc;
}
