#include "cli/information.h"

#include "cli/steps.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/io/json.h"
#include "v2v3d/method/weights.h"
#include "v2v3d/train/train.h"
#include <inttypes.h>
#include <string.h>

/* ---- arrays ---- */

/* Figures of all arrays whose names begin with the same word, under that word. */
static void describe_groups(struct v2v_report *report, const struct v2v_weights *weights)
{
    const struct v2v_fields *fields = &weights->schema.fields;
    for (int64_t i = 0; i < fields->count;) {
        const char *name = fields->item[i].name;
        const size_t word = strcspn(name, ".");
        char group[V2V_FIELDS_NAME_BYTES];
        struct v2v_figures figures = {0};
        snprintf(group, sizeof group, "%.*s", (int)word, name);
        for (; i < fields->count && strncmp(fields->item[i].name, name, word) == 0 &&
               fields->item[i].name[word] == '.';
             i++) {
            v2v_figures_add(&figures, weights->arena + fields->item[i].offset,
                            fields->item[i].count);
        }
        v2v_report_figures(report, group, &figures);
    }
}

/* "F32 [4,1,3,3], -0.1 to 0.1, .." */
static enum v2v_status describe_array(struct v2v_report *report, const struct v2v_arrays *arrays,
                                      const struct v2v_array *array)
{
    enum v2v_status rc = V2V_OK;
    char text[320];
    struct v2v_figures figures = {0};
    float *values = NULL;
    int used = snprintf(text, sizeof text, "%s [", array->type);
    for (int a = 0; a < array->rank; a++) {
        used += snprintf(text + used, sizeof text - (size_t)used, "%s%" PRId64, a > 0 ? "," : "",
                         array->shape[a]);
    }
    used += snprintf(text + used, sizeof text - (size_t)used, "]");
    V2V_TRY(V2V_ALLOC(values, "info.array", array->count));
    if (v2v_arrays_read(arrays, values, array) == V2V_OK) {
        v2v_figures_add(&figures, values, array->count);
        used += snprintf(text + used, sizeof text - (size_t)used, ", ");
        v2v_report_figures_text(text + used, sizeof text - (size_t)used, &figures);
    } else {
        snprintf(text + used, sizeof text - (size_t)used, ", not read: no finite numbers");
    }
    v2v_report_text(report, array->name, text);
done:
    v2v_mem_free(values);
    return rc;
}

/* Of another program: whatever there is. */
static enum v2v_status list_arrays(struct v2v_report *report, const struct v2v_arrays *arrays,
                                   const char *method)
{
    enum v2v_status rc = V2V_OK;
    int64_t numbers = 0;
    for (int64_t i = 0; i < v2v_arrays_count(arrays); i++) {
        V2V_TRY(describe_array(report, arrays, v2v_arrays_at(arrays, i)));
        numbers += v2v_arrays_at(arrays, i)->count;
    }
    v2v_report_headline(report, "%" PRId64 " arrays of another program, %" PRId64 " numbers, %s%s",
                        v2v_arrays_count(arrays), numbers,
                        method != NULL ? "under names of the network " : "of no network known here",
                        method != NULL ? method : "");
    if (method != NULL) {
        v2v_report_text(report, "network", method);
    }
    v2v_report_number(report, "parameters", (double)numbers, "");
done:
    return rc;
}

/* ---- weights ---- */

static void describe_settings(struct v2v_report *report, const char *settings)
{
    char line[V2V_WEIGHTS_SETTINGS_BYTES];
    while (*settings != '\0') {
        const size_t bytes = strcspn(settings, "\n");
        snprintf(line, sizeof line, "%.*s", (int)bytes, settings);
        char *value = strchr(line, '=');
        if (value != NULL) {
            *value++ = '\0';
            v2v_report_text(report, line, value);
        }
        settings += bytes + (settings[bytes] == '\n');
    }
}

static void describe_weights(struct v2v_report *report, const char *path,
                             const struct v2v_weights *weights)
{
    const struct v2v_weights_info *info = &weights->info;
    int64_t parameters = 0;
    for (int64_t i = 0; i < weights->schema.fields.count; i++) {
        parameters += weights->schema.fields.item[i].count;
    }
    v2v_report_headline(report,
                        "%s of the network %s for %" PRId64 " views (split %s) and %" PRId64
                        " slices, step %" PRId64,
                        v2v_weights_file_has(path, "adam_m") ? "checkpoint" : "weights",
                        info->method, info->views, info->split, info->slices, info->step);
    v2v_report_count(report, "views", info->views);
    v2v_report_count(report, "slices", info->slices);
    v2v_report_count(report, "step", info->step);
    describe_settings(report, info->settings);
    v2v_report_number(report, "parameters", (double)parameters, "");
    if (info->levels.frames > 0) {
        v2v_report_number(report, "trained frames", (double)info->levels.frames, "");
    }
    for (int f = 0; info->levels.frames > 0 && f < V2V_LEVEL_FIGURES; f++) {
        char name[64];
        snprintf(name, sizeof name, "trained %s", v2v_level_name((enum v2v_level)f));
        v2v_report_range(report, name, info->levels.least[f], info->levels.most[f], "");
    }
    if (weights->config != NULL) {
        v2v_report_text(report, "configuration", weights->config);
    }
    describe_groups(report, weights);
}

enum v2v_status v2v_inform_weights(struct v2v_report *report, const char *path, int64_t frame,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_arrays *arrays = NULL;
    struct v2v_weights weights = {0};
    const struct v2v_weights_hints hints = {.config = &session->config};
    (void)frame;
    if (!v2v_step_on_root(session)) {
        return V2V_OK;
    }
    V2V_TRY(v2v_arrays_open(&arrays, path));
    V2V_TRY(v2v_arrays_info(&weights.info, &weights.config, arrays));
    const int is_ours = weights.info.method[0] != '\0';
    v2v_weights_fini(&weights);
    if (is_ours) {
        V2V_TRY(v2v_weights_read(&weights, path, &hints));
        describe_weights(report, path, &weights);
        goto done;
    }
    const char *method = v2v_weights_method(path, &session->config);
    if (method == NULL && !v2v_file_is_safetensors(path)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is no weight file", path));
    }
    V2V_TRY(list_arrays(report, arrays, method));
done:
    v2v_weights_fini(&weights);
    v2v_arrays_close(&arrays);
    return rc;
}

/* ---- run folders ---- */

static enum v2v_status path_in(char path[V2V_PATH_BYTES], const char *folder, const char *name)
{
    return v2v_text_format(path, V2V_PATH_BYTES, "%s/%s", folder, name);
}

/* The last line of the log, and where the loss was least. */
static void describe_losses(struct v2v_report *report, const struct v2v_json_lines *lines)
{
    static const char *const not_losses[] = {"step", "seconds", "communication"};
    const struct v2v_json_member *seconds = v2v_json_lines_find(lines, "seconds");
    const struct v2v_json_member *total = v2v_json_lines_find(lines, "total");
    char name[V2V_JSON_NAME_BYTES + 16];
    for (int64_t i = 0; i < lines->members; i++) {
        int is_loss = 1;
        for (size_t n = 0; n < sizeof not_losses / sizeof *not_losses; n++) {
            is_loss = is_loss && strcmp(lines->member[i].name, not_losses[n]) != 0;
        }
        if (is_loss) {
            snprintf(name, sizeof name, "last %s", lines->member[i].name);
            v2v_report_number(report, name, lines->member[i].last, "");
        }
    }
    if (total != NULL) {
        v2v_report_number(report, "least total", total->least, "");
        v2v_report_number(report, "step of the least total", total->least_at, "");
    }
    if (seconds != NULL) {
        v2v_report_number(report, "time of a step", seconds->sum / (double)lines->lines, "s");
    }
}

/* The training of a demo, which is in its folder; that of others is the folder. */
static enum v2v_status find_run(char run[V2V_PATH_BYTES], int *is_demo, const char *path)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_PATH_BYTES];
    V2V_TRY(path_in(run, path, "run"));
    V2V_TRY(path_in(name, run, V2V_RUN_CONFIG));
    *is_demo = v2v_file_exists(name);
    if (!*is_demo) {
        V2V_TRY(v2v_text_format(run, V2V_PATH_BYTES, "%s", path));
    }
done:
    return rc;
}

enum v2v_status v2v_inform_run(struct v2v_report *report, const char *path, int64_t frame,
                               const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    char name[V2V_PATH_BYTES], run[V2V_PATH_BYTES];
    struct v2v_config config;
    struct v2v_json_lines lines = {0};
    int is_demo = 0;
    if (!v2v_step_on_root(session)) {
        return V2V_OK;
    }
    v2v_config_defaults(&config);
    V2V_TRY(find_run(run, &is_demo, path));
    V2V_TRY(path_in(name, run, V2V_RUN_CONFIG));
    V2V_TRY(v2v_config_load(&config, name));
    V2V_TRY(path_in(name, run, V2V_RUN_METRICS));
    if (v2v_file_exists(name)) {
        V2V_TRY(v2v_json_lines_read(&lines, name));
    }
    const struct v2v_json_member *step = v2v_json_lines_find(&lines, "step");
    v2v_report_number(report, "last step logged", step != NULL ? step->last : 0.0, "");
    describe_losses(report, &lines);
    V2V_TRY(path_in(name, run, V2V_RUN_WEIGHTS));
    if (v2v_file_exists(name)) {
        V2V_TRY(v2v_inform_weights(report, name, frame, session));
    }
    v2v_report_headline(report, "%s, network %s, %g of %" PRId64 " steps logged",
                        is_demo ? "folder of a demo, its training in run/" : "run folder",
                        config.model.method, step != NULL ? step->last : 0.0, config.train.steps);
    v2v_report_count(report, "steps", config.train.steps);
done:
    return rc;
}
