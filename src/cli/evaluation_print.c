#include "cli/evaluation.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/conf/kept_views.h"
#include "v2v3d/io/json.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>

const char *const v2v_view_figure_names[V2V_VIEW_FIGURE_COUNT] = {
    "residual",       "residual_sigmas", "flux",   "heldout_residual",
    "heldout_sigmas", "shift_y",         "shift_x"};

enum { CELL = 32 };

/* A figure; of one that isn't known a dash. */
static const char *text_of(char cell[CELL], double figure, int digits)
{
    snprintf(cell, CELL, "%.*g", digits, figure);
    return isnan(figure) ? "-" : cell;
}

/* Figures of the views left out come after the others. */
static int view_figures(const struct v2v_evaluation *evaluation)
{
    return evaluation->views == 0              ? 0
           : evaluation->consistency.views > 0 ? V2V_VIEW_FIGURE_COUNT
                                               : V2V_VIEW_HELDOUT;
}

static void print_views(const struct v2v_evaluation *evaluation)
{
    const int figures = view_figures(evaluation);
    char cell[CELL];
    printf("\n view");
    for (int f = 0; f < figures; f++) {
        printf("  %16s", v2v_view_figure_names[f]);
    }
    printf("\n");
    for (int64_t v = 0; v < evaluation->views; v++) {
        printf("%5" PRId64, v2v_kept_views_number(evaluation->without_views, v));
        for (int f = 0; f < figures; f++) {
            printf("  %16s", text_of(cell, evaluation->of_view[f][v], 4));
        }
        printf("\n");
    }
}

/* Of the views left out. */
static void print_consistency(const struct v2v_evaluation *evaluation)
{
    const struct v2v_consistency *found = &evaluation->consistency;
    char residual[CELL], sigmas[CELL], halves[CELL], pixels[CELL];
    printf("\nslice  disagreement\n");
    for (int64_t z = 0; z < evaluation->slices; z++) {
        printf("%5" PRId64 "  %12s\n", z, text_of(halves, evaluation->disagreement_slices[z], 4));
    }
    printf("\nframe");
    for (int64_t i = 0; i < found->frames; i++) {
        printf(" %" PRId64, found->frame[i]);
    }
    printf(
        ", by total variation%s of some of its views:\n"
        "held-out residual %s, %s of the noise\n"
        "disagreement of the halves %s\n"
        "lateral resolution %s pixels",
        evaluation->is_corrected ? ", corrected by the network," : "",
        text_of(residual, evaluation->heldout, 4), text_of(sigmas, evaluation->heldout_sigmas, 4),
        text_of(halves, evaluation->disagreement, 4), text_of(pixels, evaluation->resolution, 3));
    if (!isnan(evaluation->resolution_um)) {
        printf(", %.4g um", evaluation->resolution_um);
    }
    printf("\n");
}

void v2v_evaluation_print(const struct v2v_evaluation *evaluation, int fit_scale)
{
    char cell[CELL];
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
            const double *value = evaluation->value[f];
            if (value != NULL) {
                printf("  %17s", text_of(cell, is_mean ? evaluation->mean[f] : value[t], 6));
            }
        }
        printf("\n");
    }
    if (evaluation->value[V2V_FIGURE_PSNR] != NULL) {
        printf("%s\n", fit_scale ? "each frame was scaled by its least-squares scale"
                                 : "no scale was fitted");
    }
    if (evaluation->views > 0) {
        print_views(evaluation);
    }
    if (evaluation->consistency.frames > 0) {
        print_consistency(evaluation);
    }
}

enum { NAME = 40 };

/* Items of the JSON object as they are added. */
struct items {
    struct v2v_json_item item[2 * V2V_FIGURE_COUNT + V2V_VIEW_FIGURE_COUNT + 12];
    char name[V2V_FIGURE_COUNT + V2V_VIEW_FIGURE_COUNT][NAME];
    int64_t count, names;
};

static void add(struct items *items, struct v2v_json_item item)
{
    items->item[items->count++] = item;
}

/* An array under NAME_ending. */
static enum v2v_status add_values(struct items *items, const char *name, const char *ending,
                                  const double *values, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    char *full = items->name[items->names++];
    V2V_TRY(v2v_text_format(full, NAME, "%s_%s", name, ending));
    add(items, (struct v2v_json_item){.name = full, .values = values, .count = count});
done:
    return rc;
}

enum v2v_status v2v_evaluation_json(const struct v2v_evaluation *evaluation, int fit_scale)
{
    enum v2v_status rc = V2V_OK;
    struct items items = {0};
    double *numbers = NULL;
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            add(&items, v2v_json_number(v2v_figure_names[f], evaluation->mean[f]));
        }
    }
    if (evaluation->value[V2V_FIGURE_FLUX] == NULL) {
        add(&items, v2v_json_number(v2v_figure_names[V2V_FIGURE_FLUX], NAN));
    }
    add(&items, v2v_json_number("heldout_residual", evaluation->heldout));
    add(&items, v2v_json_number("heldout_sigmas", evaluation->heldout_sigmas));
    add(&items, v2v_json_number("disagreement", evaluation->disagreement));
    add(&items, v2v_json_number("resolution_um", evaluation->resolution_um));
    add(&items, v2v_json_number("resolution_pixels", evaluation->resolution));
    add(&items, v2v_json_number("frames", (double)evaluation->frames));
    add(&items, v2v_json_number("heldout_frames", (double)evaluation->consistency.frames));
    add(&items, v2v_json_number("fit_scale", fit_scale));
    add(&items, (struct v2v_json_item){.name = "warnings", .text = evaluation->warnings});
    for (int f = 0; f < V2V_FIGURE_COUNT; f++) {
        if (evaluation->value[f] != NULL) {
            V2V_TRY(add_values(&items, v2v_figure_names[f], "frames", evaluation->value[f],
                               evaluation->frames));
        }
    }
    if (evaluation->views > 0) {
        V2V_TRY(V2V_ALLOC(numbers, "evaluate.numbers", evaluation->views));
        for (int64_t v = 0; v < evaluation->views; v++) {
            numbers[v] = (double)v2v_kept_views_number(evaluation->without_views, v);
        }
        add(&items, (struct v2v_json_item){
                        .name = "view_numbers", .values = numbers, .count = evaluation->views});
    }
    for (int f = 0; f < view_figures(evaluation); f++) {
        V2V_TRY(add_values(&items, v2v_view_figure_names[f], "views", evaluation->of_view[f],
                           evaluation->views));
    }
    if (evaluation->consistency.frames > 0) {
        add(&items, (struct v2v_json_item){.name = "disagreement_slices",
                                           .values = evaluation->disagreement_slices,
                                           .count = evaluation->slices});
    }
    V2V_TRY(v2v_json_print(stdout, items.item, items.count));
done:
    v2v_mem_free(numbers);
    return rc;
}
