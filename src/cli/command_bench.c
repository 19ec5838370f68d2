#include "cli/bench_methods.h"
#include "cli/processor.h"
#include "cli/steps.h"
#include "cli/versions.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/io/json.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/tensor/statistics.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SIZE = 256, REPEAT = 3, MOST_REPEAT = 99, OUTPUTS = V2V_NETWORK_MOST_OUTPUTS };

/* Ways to compute the configured network, the most exact one first: settings over the
 * configuration, bf16 where the processor has it. */
static const struct variant {
    const char *name;
    const char *setting[2];
    int precision;
} variants[] = {
    {.name = "exact", .setting = {"model.winograd=false", "model.merge=false"}},
    {.name = "as configured"},
    {.name = "winograd off", .setting = {"model.winograd=false"}},
    {.name = "merging off", .setting = {"model.merge=false"}},
    {.name = "openblas", .setting = {"model.backend=openblas", "model.winograd=false"}},
    {.name = "bf16", .precision = V2V_PRECISION_BF16},
};
enum { VARIANTS = sizeof variants / sizeof variants[0] };

struct arguments {
    struct v2v_common common;
    const char *psf, *calibration, *input, *truth;
    struct v2v_words weights, only;
    int64_t size, repeat;
    int json, methods, fit_scale;
};

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 0),
    {.name = "size",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, size),
     .value = "N",
     .help = "pixels of a frame's side; default: 256",
     .least = 1,
     .most = 16384},
    {.name = "repeat",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, repeat),
     .value = "N",
     .help = "rounds of which the median is taken; default: 3",
     .least = 1,
     .most = MOST_REPEAT},
    V2V_OPTION_SWITCH(struct arguments, json, "json", "one JSON object a row"),
    V2V_OPTION_SWITCH(struct arguments, methods, "methods",
                      "instead: every method on the first frame of --input, with seconds and the "
                      "prediction error on held-out views; tv-T: by deconv.tolerance T",
                      .needs = "input"),
    V2V_OPTION_FILE(struct arguments, input, "input", 0, "with --methods: recording",
                    .needs = "methods"),
    V2V_OPTION_FILE(struct arguments, truth, "truth", 0,
                    "with --methods: true volume, for PSNR and SSIM", .needs = "methods"),
    V2V_OPTION_SWITCH(struct arguments, fit_scale, "fit-scale",
                      "with --truth: allow every volume one least-squares scale, as of counts",
                      .needs = "truth"),
    {.name = "weights",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, weights),
     .value = "FILE...",
     .help = "with --methods: of trained networks, plain, with --skip auto and in bf16",
     .needs = "methods"},
    {.name = "only",
     .kind = V2V_OPTION_LIST,
     .at = offsetof(struct arguments, only),
     .value = "NAME...",
     .help = "with --methods: rows of these names alone",
     .needs = "methods"},
    V2V_OPTION_FILE(struct arguments, calibration, "calibration", 0, "with --methods: of the views",
                    .needs = "methods"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    V2V_OPTIONS_INPUT,
    {0}};

struct row {
    float forward_s[MOST_REPEAT], gradient_s[MOST_REPEAT]; /* by round */
    double error[OUTPUTS], bytes;
};

struct bench {
    const struct v2v_network_ops *ops;
    struct v2v_psf_file psf;
    int64_t size, rounds, voxels; /* voxels: of what the network makes */
    float *views, *volume[OUTPUTS], *exact[OUTPUTS];
    struct row row[VARIANTS];
};

static enum v2v_status prepare(struct bench *bench, const struct arguments *given,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_config *config = &session->config;
    struct v2v_grid_work work = {0};
    struct v2v_network *network = NULL; /* tells what it takes and makes */
    V2V_TRY(v2v_network_find(&bench->ops, config->model.method));
    if (given->psf != NULL) {
        V2V_TRY(v2v_step_psf(session, &bench->psf, given->psf));
    } else {
        V2V_TRY(v2v_psf_simulate(&bench->psf, &config->optics));
        if (config->psf.normalize == V2V_NORMALIZE_VIEW) {
            v2v_psf_normalize_views(&bench->psf);
        }
    }
    const struct v2v_network_spec spec = {.config = config,
                                          .psf = &bench->psf,
                                          .views = bench->psf.views,
                                          .slices = bench->psf.slices,
                                          .outputs = V2V_NETWORK_ALL};
    bench->rounds = given->repeat > 0 ? given->repeat : REPEAT;
    bench->size = given->size > 0 ? given->size : SIZE;
    bench->ops->describe_work(&work, &spec, bench->size, bench->size);
    bench->size = v2v_round_up(bench->size, work.unit);
    V2V_TRY(v2v_network_create(&network, bench->ops->name, &spec));
    bench->voxels = v2v_mem_product(network->slices, bench->size, bench->size);
    const int64_t pixels = v2v_mem_product(network->inputs, bench->size, bench->size);
    V2V_TRY(V2V_ALLOC(bench->views, "bench.views", pixels));
    for (int64_t i = 0; i < pixels; i++) {
        bench->views[i] = (float)(0.2 + 0.2 * v2v_random_rule("lfi", 0, (uint64_t)i));
    }
    for (int o = 0; o < bench->ops->outputs; o++) {
        V2V_TRY(V2V_ALLOC(bench->volume[o], "bench.volume", bench->voxels));
        V2V_TRY(V2V_ALLOC(bench->exact[o], "bench.volume", bench->voxels));
    }
done:
    v2v_network_destroy(&network);
    return rc;
}

static void forget(struct bench *bench)
{
    for (int o = 0; o < OUTPUTS; o++) {
        v2v_mem_free(bench->exact[o]);
        v2v_mem_free(bench->volume[o]);
    }
    v2v_mem_free(bench->views);
    v2v_psf_file_fini(&bench->psf);
}

/* The time of emulated bf16 would say nothing about bf16. */
static int can_run(const struct variant *variant, const struct v2v_network_ops *ops)
{
    return variant->precision == V2V_PRECISION_F32 ||
           ((ops->traits & V2V_TRAIT_BF16) && v2v_op_bf16() >= V2V_BF16_NATIVE);
}

/* Seconds of the second of two passes: the first one touches the memory. */
static enum v2v_status time_passes(float *seconds, struct bench *bench, struct v2v_network *network,
                                   int training)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_projector *projector = NULL;
    struct v2v_network_plan plan = {
        .height = bench->size, .width = bench->size, .training = training};
    const float *dvolume[OUTPUTS];
    double began = 0.0;
    if (bench->ops->traits & V2V_TRAIT_PROJECTS) {
        V2V_TRY(v2v_projector_create(&projector, &bench->psf, bench->size, bench->size,
                                     V2V_SPLIT_SLICES, NULL));
        plan.projector = projector;
    }
    V2V_TRY(bench->ops->plan(network, &plan));
    for (int pass = 0; pass < 2; pass++) {
        began = v2v_clock_now();
        bench->ops->forward(network, bench->volume, bench->views);
        if (training) {
            memcpy(dvolume, bench->volume, sizeof dvolume); /* any gradient takes as long */
            bench->ops->backward(network, dvolume);
        }
    }
    *seconds = (float)(v2v_clock_now() - began);
done:
    v2v_projector_destroy(&projector);
    return rc;
}

static double relative_error(const float *volume, const float *exact, int64_t count)
{
    double difference = 0.0, norm = 0.0;
    for (int64_t i = 0; i < count; i++) {
        const double d = (double)volume[i] - exact[i];
        difference += d * d;
        norm += (double)exact[i] * exact[i];
    }
    return sqrt(difference / norm);
}

/* The network lives for one measurement: all of them together would not fit into memory. */
static enum v2v_status measure(struct bench *bench, int i, int64_t round,
                               const struct v2v_config *configured)
{
    enum v2v_status rc = V2V_OK;
    const struct variant *variant = &variants[i];
    struct row *row = &bench->row[i];
    struct v2v_config config = *configured;
    struct v2v_network *network = NULL;
    const size_t held = v2v_mem_held();
    if (v2v_stop_requested()) {
        V2V_TRY(V2V_FAIL(V2V_STOPPED, "stopped on request"));
    }
    for (int s = 0; s < 2 && variant->setting[s] != NULL; s++) {
        V2V_TRY(v2v_config_set(&config, variant->setting[s]));
    }
    const struct v2v_network_spec spec = {.config = &config,
                                          .psf = &bench->psf,
                                          .views = bench->psf.views,
                                          .slices = bench->psf.slices,
                                          .outputs = V2V_NETWORK_ALL,
                                          .precision = variant->precision};
    V2V_TRY(v2v_network_create(&network, bench->ops->name, &spec));
    V2V_TRY(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HASH, 7));
    V2V_TRY(time_passes(&row->forward_s[round], bench, network, 0));
    row->bytes = (double)(v2v_mem_held() - held);
    for (int o = 0; o < bench->ops->outputs; o++) {
        if (i == 0) {
            memcpy(bench->exact[o], bench->volume[o], (size_t)bench->voxels * sizeof(float));
        }
        row->error[o] = relative_error(bench->volume[o], bench->exact[o], bench->voxels);
    }
    V2V_TRY(time_passes(&row->gradient_s[round], bench, network, 1));
    v2v_log(V2V_LOG_INFO, "round %" PRId64 ", %s: %.3f s", round + 1, variant->name,
            row->forward_s[round]);
done:
    v2v_network_destroy(&network);
    return rc;
}

static enum v2v_status print(struct bench *bench, const struct arguments *given,
                             const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_processor processor;
    v2v_cli_processor(&processor);
    if (!given->json) {
        printf("%s, threads: %d; %s\n%s, %" PRId64 " views of %" PRId64 " x %" PRId64
               " pixels, %" PRId64 " slices\n%-14s  %10s  %11s  %9s  %s\n",
               processor.model, session->threads, V2V_LIBRARY_VERSIONS, bench->ops->name,
               bench->psf.views, bench->size, bench->size, bench->psf.slices, "", "forward s",
               "+ gradient s", "memory MB", "relative L2 error of each volume");
    }
    for (int i = 0; i < VARIANTS; i++) {
        struct row *row = &bench->row[i];
        if (!can_run(&variants[i], bench->ops)) {
            continue;
        }
        double forward_s = 0.0, gradient_s = 0.0;
        V2V_TRY(v2v_percentile(&forward_s, row->forward_s, bench->rounds, 50.0));
        V2V_TRY(v2v_percentile(&gradient_s, row->gradient_s, bench->rounds, 50.0));
        const struct v2v_json_item items[] = {
            {.name = "variant", .text = variants[i].name},
            {.name = "method", .text = bench->ops->name},
            {.name = "processor", .text = processor.model},
            {.name = "threads", .number = session->threads},
            {.name = "size", .number = (double)bench->size},
            {.name = "forward_s", .number = forward_s},
            {.name = "forward_backward_s", .number = gradient_s},
            {.name = "bytes", .number = row->bytes},
            {.name = "error", .values = row->error, .count = bench->ops->outputs}};
        if (given->json) {
            V2V_TRY(v2v_json_print(stdout, items, sizeof items / sizeof items[0]));
            continue;
        }
        printf("%-14s  %10.4f  %12.4f  %9.0f ", variants[i].name, forward_s, gradient_s,
               row->bytes / 1e6);
        for (int o = 0; o < bench->ops->outputs; o++) {
            printf(" %8.1e", row->error[o]);
        }
        printf("\n");
    }
done:
    return rc;
}

/* Do the words fit together? Local: the same on all ranks. */
static enum v2v_status check_words(const struct arguments *given)
{
    const char *of_recording = v2v_options_of(&given->common, "input.");
    if (given->methods && given->psf == NULL) {
        return V2V_FAIL(V2V_E_USAGE, "--methods needs --psf");
    }
    if (given->methods && (given->size > 0 || given->repeat > 0)) {
        return V2V_FAIL(V2V_E_USAGE, "--%s: --methods runs each on the frame of --input once",
                        given->size > 0 ? "size" : "repeat");
    }
    if (!given->methods && of_recording != NULL) {
        return V2V_FAIL(V2V_E_USAGE, "--%s is of a recording: --methods is missing", of_recording);
    }
    return V2V_OK;
}

static enum v2v_status compare_methods(const struct arguments *given, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_methods methods = {.psf = given->psf,
                                              .input = given->input,
                                              .truth = given->truth,
                                              .fit_scale = given->fit_scale,
                                              .weights = given->weights,
                                              .only = given->only,
                                              .json = given->json};
    V2V_TRY(v2v_step_calibration(session, given->calibration));
    V2V_TRY(v2v_bench_methods(&methods, session));
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct bench *bench = NULL;
    if (v2v_comm_size(session->world) > 1) {
        return V2V_FAIL(V2V_E_USAGE, "bench measures one rank; here are %d",
                        v2v_comm_size(session->world));
    }
    V2V_TRY(check_words(given));
    if (given->methods) {
        V2V_TRY(compare_methods(given, session));
        goto done;
    }
    V2V_TRY(V2V_ALLOC(bench, "bench", 1));
    V2V_TRY(prepare(bench, given, session));
    for (int64_t round = 0; round < bench->rounds; round++) {
        for (int i = 0; i < VARIANTS; i++) {
            if (can_run(&variants[i], bench->ops)) {
                V2V_TRY(measure(bench, i, round, &session->config));
            }
        }
    }
    V2V_TRY(print(bench, given, session));
done:
    if (bench != NULL) {
        forget(bench);
    }
    v2v_mem_free(bench);
    return rc;
}

const struct v2v_command v2v_command_bench = {
    .name = "bench",
    .summary =
        "run time against error: every way to compute the network, or every method; no ranks",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
