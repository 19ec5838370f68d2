#include "cli/bench_input.h"
#include "cli/processor.h"
#include "cli/steps.h"
#include "cli/versions.h"

#include "v2v3d/base/text.h"
#include "v2v3d/bench/bench.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/v2v/model.h"
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

struct arguments {
    struct v2v_common common;
    const char *psf, *weights, *input, *truth, *folder;
    int64_t size, step_size, width, repeat; /* 0: not given */
    int quick;
};

enum { SIZE, STEP_SIZE, WIDTH, WIDEST, REPEAT, SIZES };
static const int64_t full_sizes[SIZES] = {256, 128, 128, 128, 3};
static const int64_t quick_sizes[SIZES] = {64, 32, 16, 32, 3};

#define OPTION_INTEGER(field, word, letters, low, high, text)                                      \
    {                                                                                              \
        .name = (word), .kind = V2V_OPTION_INTEGER, .at = offsetof(struct arguments, field),       \
        .value = (letters), .help = (text), .least = (low), .most = (high)                         \
    }

static const struct v2v_option options[] = {
    V2V_OPTION_PSF(struct arguments, psf, 0),
    OPTION_INTEGER(size, "size", "N", 32, 16384, "pixels of the frame's side; 256 if not given"),
    OPTION_INTEGER(step_size, "step-size", "N", 32, 16384,
                   "pixels of a training step's side; 128 if not given"),
    OPTION_INTEGER(width, "width", "N", 1, 1024, "of the network; that of --weights, or 128"),
    OPTION_INTEGER(repeat, "repeat", "N", V2V_BENCH_LEAST_REPEAT, V2V_BENCH_MOST_REPEAT,
                   "rounds of which the median is taken; 3 if not given"),
    V2V_OPTION_FILE(struct arguments, weights, "weights", 0, "of a trained network"),
    V2V_OPTION_FILE(struct arguments, input, "input", 0,
                    "recording: the middle of its first frame, not random views"),
    V2V_OPTION_FILE(struct arguments, truth, "truth", 0,
                    "true volume: with --weights and --input, the change of PSNR"),
    {.name = "output",
     .letter = 'o',
     .kind = V2V_OPTION_TEXT,
     .at = offsetof(struct arguments, folder),
     .value = "FOLDER",
     .help = "for bench.json and bench.png",
     .required = 1},
    V2V_OPTION_SWITCH(struct arguments, quick, "quick",
                      "sizes 64 and 32, width 16: seconds, to see that it works"),
    V2V_OPTION_OFFSET,
    V2V_OPTION_GAIN,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    {0}};

/* What was given, or else --quick's figures or the full ones. */
static void settle_sizes(int64_t *sizes, const struct arguments *given)
{
    const int64_t own[SIZES] = {given->size, given->step_size, given->width, 0, given->repeat};
    for (int i = 0; i < SIZES; i++) {
        sizes[i] = own[i] != 0 ? own[i] : given->quick ? quick_sizes[i] : full_sizes[i];
    }
}

static enum v2v_status check(const struct arguments *given, const int64_t *sizes,
                             const struct v2v_session *session)
{
    if (v2v_comm_size(session->world) > 1) {
        return V2V_FAIL(V2V_E_USAGE, "bench measures one rank; here are %d",
                        v2v_comm_size(session->world));
    }
    if (sizes[SIZE] % V2V_MODEL_GRID != 0 || sizes[STEP_SIZE] % V2V_MODEL_GRID != 0) {
        return V2V_FAIL(V2V_E_USAGE,
                        "--size %" PRId64 ", --step-size %" PRId64 ": both must be multiples of %d",
                        sizes[SIZE], sizes[STEP_SIZE], V2V_MODEL_GRID);
    }
    if (sizes[STEP_SIZE] > sizes[SIZE]) {
        return V2V_FAIL(V2V_E_USAGE, "--step-size %" PRId64 " is larger than --size %" PRId64,
                        sizes[STEP_SIZE], sizes[SIZE]);
    }
    if (given->truth != NULL && (given->input == NULL || given->weights == NULL)) {
        return V2V_FAIL(V2V_E_USAGE, "--truth needs --input and --weights");
    }
    return V2V_OK;
}

static enum v2v_status open_folder(char (*path)[V2V_PATH_BYTES], const struct arguments *given,
                                   const struct v2v_session *session)
{
    static const char *const names[] = {"bench.json", "bench.png"};
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_file_make_folder(given->folder));
    for (int i = 0; i < 2; i++) {
        V2V_TRY(v2v_text_format(path[i], V2V_PATH_BYTES, "%s/%s", given->folder, names[i]));
        V2V_TRY(v2v_step_output(session, path[i], NULL, 0));
    }
done:
    return rc;
}

/* The network: the weight file's, or the configuration's at the width asked for. */
static enum v2v_status settle_network(struct v2v_bench_job *job, const struct arguments *given,
                                      struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights_info info;
    if (given->weights != NULL) {
        V2V_TRY(v2v_step_weights_info(session, &info, given->weights, job->psf));
        job->width = session->config.model.width;
    }
    if (given->weights != NULL && given->width != 0 && given->width != job->width) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--width %" PRId64 ", but %s has width %" PRId64,
                         given->width, given->weights, job->width));
    }
    job->features = session->config.model.features;
    job->volume_scale = session->config.model.volume_scale;
done:
    return rc;
}

static enum v2v_status write_results(char (*path)[V2V_PATH_BYTES],
                                     const struct v2v_bench_result *result, double load,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_processor processor;
    struct v2v_canvas canvas = {0};
    v2v_cli_processor(&processor);
    struct v2v_bench_machine machine = {.processor = processor.model,
                                        .instructions = processor.instructions,
                                        .libraries = V2V_LIBRARY_VERSIONS,
                                        .threads = session->threads,
                                        .load = load};
    v2v_bench_print(stdout, result, &machine);
    V2V_TRY(v2v_bench_write_json(path[0], result, &machine));
    V2V_TRY(v2v_bench_plot(&canvas, result));
    V2V_TRY(v2v_png_write(path[1], canvas.rgb, canvas.height, canvas.width, 3));
done:
    v2v_canvas_fini(&canvas);
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    int64_t sizes[SIZES];
    char path[2][V2V_PATH_BYTES];
    struct v2v_bench_input input = {0};
    struct v2v_bench_result result;
    struct v2v_bench_paths paths = {
        .psf = given->psf, .input = given->input, .truth = given->truth};
    double load = NAN;
    settle_sizes(sizes, given);
    V2V_TRY(check(given, sizes, session));
    v2v_watchdog_disarm(); /* one rank waits for nobody */
    V2V_TRY(open_folder(path, given, session));
    V2V_TRY(v2v_bench_input_init(&input, &paths, sizes[SIZE], session));
    struct v2v_bench_job job = {.config = &session->config,
                                .psf = &input.psf,
                                .views = input.views,
                                .truth = input.truth,
                                .gain = input.gain,
                                .weights = given->weights,
                                .size = sizes[SIZE],
                                .step_size = sizes[STEP_SIZE],
                                .width = sizes[WIDTH],
                                .widest = sizes[WIDEST],
                                .repeat = sizes[REPEAT]};
    V2V_TRY(settle_network(&job, given, session));
    if (getloadavg(&load, 1) != 1) {
        load = NAN;
    }
    V2V_TRY(v2v_bench_run(&result, &job));
    V2V_TRY(write_results(path, &result, load, session));
done:
    v2v_bench_input_fini(&input);
    return rc;
}

const struct v2v_command v2v_command_bench = {
    .name = "bench",
    .summary = "run time against error, every way to compute the network",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
