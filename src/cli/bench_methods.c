#include "cli/bench_methods.h"

#include "cli/evaluation.h"
#include "cli/heldout.h"
#include "cli/processor.h"
#include "cli/steps.h"
#include "cli/volumes.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/json.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/op/bf16.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SETTINGS = 3, CROP = 128 * 128 };

/* A method: settings over the configuration, and what it needs to differ from others. */
struct method {
    const char *name;
    const char *setting[SETTINGS];
    int64_t views, frames; /* at least */
    int64_t pixels;        /* of a frame, at most; 0: any */
    unsigned traits;       /* of the network */
};

/* Without training, the quickest of a kind first. */
static const struct method deconvolvers[] = {
    {.name = "rl-10", .setting = {"deconv.method=rl", "deconv.iterations=10"}},
    {.name = "rl-30", .setting = {"deconv.method=rl", "deconv.iterations=30"}},
    {.name = "rl-heldout", .setting = {"deconv.method=rl", "deconv.stop=heldout"}, .views = 3},
    {.name = "rld-1", .setting = {"deconv.method=rld", "deconv.iterations=1"}},
    {.name = "rld-3", .setting = {"deconv.method=rld", "deconv.iterations=3"}},
    {.name = "rld-10", .setting = {"deconv.method=rld", "deconv.iterations=10"}},
    {.name = "rld-heldout", .setting = {"deconv.method=rld", "deconv.stop=heldout"}, .views = 3},
    {.name = "frl-1", .setting = {"deconv.method=frl", "deconv.iterations=1"}},
    {.name = "frl-3", .setting = {"deconv.method=frl", "deconv.iterations=3"}},
    {.name = "frl-10", .setting = {"deconv.method=frl", "deconv.iterations=10"}},
    {.name = "frl-heldout", .setting = {"deconv.method=frl", "deconv.stop=heldout"}, .views = 3},
    {.name = "tv-5e-2", .setting = {"deconv.method=tv", "deconv.tolerance=5e-2"}},
    {.name = "tv-1.5e-2", .setting = {"deconv.method=tv", "deconv.tolerance=1.5e-2"}},
    {.name = "tv-5e-3", .setting = {"deconv.method=tv", "deconv.tolerance=5e-3"}},
    {.name = "tv-1e-3", .setting = {"deconv.method=tv", "deconv.tolerance=1e-3"}},
    {.name = "tv-neighbours",
     .setting = {"deconv.method=tv", "deconv.tolerance=1.5e-2", "recon.neighbours=5"},
     .frames = 2},
    {.name = "diner-100",
     .setting = {"deconv.method=diner", "deconv.iterations=100"},
     .pixels = CROP},
    {.name = "diner-1000",
     .setting = {"deconv.method=diner", "deconv.iterations=1000"},
     .pixels = CROP},
};

/* Of each weight file. */
static const struct method networks[] = {
    {.name = "weights"},
    {.name = "weights-skip", .setting = {"recon.skip=auto"}, .traits = V2V_TRAIT_SKIPS},
    {.name = "weights-bf16", .setting = {"recon.precision=bf16"}, .traits = V2V_TRAIT_BF16},
    {.name = "weights-bf16-skip",
     .setting = {"recon.precision=bf16", "recon.skip=auto"},
     .traits = V2V_TRAIT_BF16 | V2V_TRAIT_SKIPS},
};

enum {
    DECONVOLVERS = sizeof deconvolvers / sizeof *deconvolvers,
    NETWORKS = sizeof networks / sizeof *networks
};

struct bench {
    const struct v2v_bench_methods *given;
    const struct v2v_session *session;
    int64_t views, frames, pixels; /* of the recording */
    char folder[V2V_PATH_BYTES], volume[V2V_PATH_BYTES];
};

struct row {
    const struct method *method;
    const char *weights; /* NULL: none */
    struct v2v_volumes_result made;
    double psnr, ssim;
    struct v2v_heldout heldout;
};

/* Is there a row of this name? @param weights files of networks that there are */
static enum v2v_status check_row(const char *name, int64_t weights)
{
    char rows[512] = "";
    for (int i = 0; i < DECONVOLVERS + NETWORKS; i++) {
        const struct method *method =
            i < DECONVOLVERS ? &deconvolvers[i] : &networks[i - DECONVOLVERS];
        const size_t used = strlen(rows);
        if (strcmp(name, method->name) == 0) {
            return i < DECONVOLVERS || weights > 0
                       ? V2V_OK
                       : V2V_FAIL(V2V_E_USAGE, "--only %s needs --weights", name);
        }
        snprintf(rows + used, sizeof rows - used, "%s%s", i > 0 ? ", " : "", method->name);
    }
    return V2V_FAIL(V2V_E_USAGE, "--only: there is no row '%s'; there are %s", name, rows);
}

static int is_wanted(const struct v2v_words *only, const char *name)
{
    int wanted = only->count == 0;
    for (int64_t i = 0; i < only->count; i++) {
        wanted |= strcmp(only->item[i], name) == 0;
    }
    return wanted;
}

/* Is it by total variation of averaged frames, which refuses what is known of single ones? */
static int averages_counts(const struct v2v_config *config, const struct v2v_network_ops *network)
{
    const int is_by_tv = network != NULL ? (network->traits & V2V_TRAIT_CORRECTS) != 0
                                         : strcmp(config->deconv.method, "tv") == 0;
    return is_by_tv && config->recon.neighbours > 0 &&
           config->deconv.electrons_per_count.mode == V2V_NUMBER_GIVEN;
}

/* Where a method cannot differ from another one, it is left out. The time of emulated bf16 would
 * say nothing about bf16. @param config with the method's settings */
static int can_run(const struct bench *bench, const struct method *method,
                   const struct v2v_network_ops *network, const struct v2v_config *config)
{
    const unsigned traits = network != NULL ? network->traits : 0;
    return bench->views >= method->views && bench->frames >= method->frames &&
           (method->pixels == 0 || bench->pixels <= method->pixels) &&
           (traits & method->traits) == method->traits && !averages_counts(config, network) &&
           (!(method->traits & V2V_TRAIT_BF16) || v2v_op_bf16() >= V2V_BF16_NATIVE);
}

static enum v2v_status print(const struct bench *bench, const struct row *row)
{
    struct v2v_processor processor;
    const struct v2v_heldout *heldout = &row->heldout;
    v2v_cli_processor(&processor);
    const struct v2v_json_item items[] = {
        {.name = "method", .text = row->method->name},
        {.name = "weights", .text = row->weights != NULL ? row->weights : ""},
        {.name = "processor", .text = processor.model},
        {.name = "threads", .number = bench->session->threads},
        {.name = "start_s", .number = row->made.ready_s},
        {.name = "frame_s", .number = row->made.frames_s},
        {.name = "psnr", .number = row->psnr},
        {.name = "ssim", .number = row->ssim},
        {.name = "heldout_residual", .number = heldout->residual},
        {.name = "heldout_sigmas", .number = heldout->sigmas}};
    if (bench->given->json) {
        return v2v_json_print(stdout, items, sizeof items / sizeof *items);
    }
    printf("%-17s %8.3f %8.3f", row->method->name, row->made.ready_s, row->made.frames_s);
    if (bench->given->truth != NULL) {
        printf(" %8.2f %7.3f", row->psnr, row->ssim);
    }
    printf(" %9.4f %9.4f  %s\n", heldout->residual, heldout->sigmas,
           row->weights != NULL ? row->weights : "");
    fflush(stdout);
    return V2V_OK;
}

/* One row. What volumes decide of the settings stays for the views left out.
 * @param network of the session's configuration; NULL: none
 * @param session with the method's settings */
static enum v2v_status measure(const struct bench *bench, struct row *row,
                               const struct v2v_network_ops *network, struct v2v_session session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_methods *given = bench->given;
    const struct v2v_estimator_ops *ops = NULL;
    struct v2v_evaluation evaluation = {0};
    const struct v2v_volumes volumes = {.common.quiet = 1,
                                        .psf = given->psf,
                                        .input = given->input,
                                        .weights = row->weights,
                                        .output = bench->volume,
                                        .frames = "0:1",
                                        .result = &row->made};
    session.force = 1;
    if (network != NULL) {
        ops = v2v_estimator_of_network(network);
    } else {
        V2V_TRY(v2v_estimator_find(&ops, session.config.deconv.method));
    }
    V2V_TRY(v2v_volumes_make(&volumes, ops, NULL, &session));
    row->psnr = row->ssim = NAN;
    if (given->truth != NULL) {
        const struct v2v_evaluation_job job = {
            .volume = bench->volume, .truth = given->truth, .fit_scale = given->fit_scale};
        V2V_TRY(v2v_evaluation_run(&evaluation, &job, &session));
        row->psnr = evaluation.mean[V2V_FIGURE_PSNR];
        row->ssim = evaluation.mean[V2V_FIGURE_SSIM];
    }
    V2V_TRY(v2v_heldout_of(&row->heldout, given->psf, given->input, row->weights, ops, &session));
    V2V_TRY(print(bench, row));
done:
    v2v_evaluation_fini(&evaluation);
    return rc;
}

static enum v2v_status measure_all(const struct bench *bench, const struct method *methods,
                                   int count, const char *weights)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_session session = *bench->session;
    const struct v2v_network_ops *network = NULL;
    if (weights != NULL) {
        V2V_TRY(v2v_step_network(&session, &network, weights, 0));
    }
    for (int i = 0; i < count; i++) {
        struct row row = {.method = &methods[i], .weights = weights};
        struct v2v_session own = session;
        for (int s = 0; s < SETTINGS && methods[i].setting[s] != NULL; s++) {
            V2V_TRY(v2v_config_set(&own.config, methods[i].setting[s]));
        }
        if (is_wanted(&bench->given->only, methods[i].name) &&
            can_run(bench, &methods[i], network, &own.config)) {
            V2V_TRY(measure(bench, &row, network, own));
        }
    }
done:
    return rc;
}

/* The inputs must fit each other; and a place for volumes. */
static enum v2v_status prepare(struct bench *bench)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_bench_methods *given = bench->given;
    const char *folder = getenv("TMPDIR");
    struct v2v_psf_file psf = {0};
    struct v2v_recording *recording = NULL;
    for (int64_t i = 0; i < given->only.count; i++) {
        V2V_TRY(check_row(given->only.item[i], given->weights.count));
    }
    V2V_TRY(v2v_step_psf(bench->session, &psf, given->psf));
    V2V_TRY(v2v_step_recording(bench->session, &recording, given->input, &psf));
    bench->views = psf.views;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    bench->frames = info->frames;
    bench->pixels = info->height * info->width;
    V2V_TRY(v2v_text_format(bench->folder, sizeof bench->folder, "%s/v2v3d-bench.XXXXXX",
                            folder != NULL ? folder : "/tmp"));
    if (mkdtemp(bench->folder) == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: no folder can be made there", bench->folder));
    }
    V2V_TRY(v2v_text_format(bench->volume, sizeof bench->volume, "%s/volume.h5", bench->folder));
done:
    v2v_recording_close(&recording);
    v2v_psf_file_fini(&psf);
    return rc;
}

/* What a run that was stopped leaves as well. */
static void clean_up(const struct bench *bench)
{
    char temporary[V2V_PATH_BYTES];
    if (bench->volume[0] == '\0') { /* nor was a folder made */
        return;
    }
    if (v2v_file_temporary(temporary, bench->volume) == V2V_OK) {
        unlink(temporary);
    }
    unlink(bench->volume);
    rmdir(bench->folder);
}

static void print_head(const struct bench *bench)
{
    struct v2v_processor processor;
    v2v_cli_processor(&processor);
    printf("%s, threads: %d; %s\n%-17s %8s %8s", processor.model, bench->session->threads,
           bench->given->input, "", "start s", "frame s");
    if (bench->given->truth != NULL) {
        printf(" %8s %7s", "PSNR, dB", "SSIM");
    }
    printf(" %9s %9s\n", "held out", "of noise");
}

enum v2v_status v2v_bench_methods(const struct v2v_bench_methods *given,
                                  const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct bench bench = {.given = given, .session = session};
    V2V_TRY(prepare(&bench));
    if (!given->json) {
        print_head(&bench);
    }
    V2V_TRY(measure_all(&bench, deconvolvers, DECONVOLVERS, NULL));
    for (int64_t i = 0; i < given->weights.count; i++) {
        V2V_TRY(measure_all(&bench, networks, NETWORKS, given->weights.item[i]));
    }
done:
    clean_up(&bench);
    return rc;
}
