#include "cli/evaluation.h"
#include "cli/steps.h"

#include "v2v3d/base/text.h"
#include "v2v3d/io/json.h"
#include <inttypes.h>

struct arguments {
    struct v2v_common common;
    const char *truth, *volume, *psf, *input;
    int64_t slices;
    int fit_scale, json;
};

static const struct v2v_option options[] = {
    V2V_OPTION_FILE(struct arguments, volume, "volume", 1, "volume to judge"),
    V2V_OPTION_FILE(struct arguments, truth, "truth", 0,
                    "true volume; integers are read as fractions of their type's maximum"),
    V2V_OPTION_PSF(struct arguments, psf, 0),
    V2V_OPTION_FILE(struct arguments, input, "input", 0,
                    "recording: with --psf, the residual of its views"),
    V2V_OPTION_SWITCH(struct arguments, fit_scale, "fit-scale",
                      "allow the volume one least-squares scale"),
    V2V_OPTION_SWITCH(struct arguments, json, "json", "one JSON object instead of a table"),
    {.name = "slices",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct arguments, slices),
     .value = "Z",
     .help = "of a frame, for TIFF volumes that do not say",
     .least = 1,
     .most = 1e6},
    V2V_OPTION_OFFSET,
    V2V_OPTION_NORMALIZE,
    V2V_OPTIONS_PAGES,
    {0}};

static void print_table(const struct v2v_evaluation *evaluation, int fit_scale)
{
    printf("frame");
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            printf("  %17s", v2v_figure_names[f]);
        }
    }
    printf("\n");
    for (int64_t t = 0; t <= evaluation->frames; t++) {
        int is_mean = t == evaluation->frames;
        if (is_mean) {
            printf(" mean");
        } else {
            printf("%5" PRId64, t);
        }
        for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
            if (evaluation->value[f] != NULL) {
                printf("  %17.6g", is_mean ? evaluation->mean[f] : evaluation->value[f][t]);
            }
        }
        printf("\n");
    }
    if (evaluation->value[V2V_FIGURE_PSNR] != NULL) {
        printf("%s\n", fit_scale ? "each frame was scaled by its least-squares scale"
                                 : "no scale was fitted");
    }
}

static enum v2v_status print_json(const struct v2v_evaluation *evaluation, int fit_scale)
{
    enum v2v_status rc = V2V_OK;
    enum { NAME = 32 };
    struct v2v_json_item items[2 * V2V_FIGURE_COUNT + 2];
    char names[V2V_FIGURE_COUNT][NAME];
    int64_t count = 0;
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            items[count++] = (struct v2v_json_item){
                .name = v2v_figure_names[f], .number = evaluation->mean[f], .count = -1};
        }
    }
    items[count++] =
        (struct v2v_json_item){.name = "frames", .number = (double)evaluation->frames, .count = -1};
    items[count++] = (struct v2v_json_item){.name = "fit_scale", .number = fit_scale, .count = -1};
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            V2V_TRY(v2v_text_format(names[f], NAME, "%s_frames", v2v_figure_names[f]));
            items[count++] = (struct v2v_json_item){
                .name = names[f], .values = evaluation->value[f], .count = evaluation->frames};
        }
    }
    V2V_TRY(v2v_json_print(stdout, items, count));
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    const struct arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_evaluation evaluation = {0};
    struct v2v_evaluation_job job = {.volume = given->volume,
                                     .truth = given->truth,
                                     .psf = given->psf,
                                     .input = given->input,
                                     .slices = given->slices,
                                     .fit_scale = given->fit_scale};
    if ((given->psf == NULL) != (given->input == NULL)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--psf and --input go together"));
    }
    if (given->truth == NULL && given->psf == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE, "--truth FILE, or --psf FILE and --input FILE, is missing"));
    }
    V2V_TRY(v2v_evaluation_run(&evaluation, &job, session));
    if (v2v_step_on_root(session)) {
        if (given->json) {
            rc = print_json(&evaluation, given->fit_scale);
        } else {
            print_table(&evaluation, given->fit_scale);
        }
    }
done:
    v2v_evaluation_fini(&evaluation);
    return rc;
}

const struct v2v_command v2v_command_evaluate = {
    .name = "evaluate",
    .summary = "PSNR and SSIM against a truth, residual of the views",
    .options = options,
    .bytes = sizeof(struct arguments),
    .run = run};
