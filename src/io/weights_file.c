#include "v2v3d/io/weights_file.h"
#include "io/arrays_internal.h"
#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/text.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* "/adam_m/" and a field's name. */
#define PLACE_BYTES (V2V_FIELDS_NAME_BYTES + 32)

/* ---- reading ---- */

/* As PyTorch's own files are, by its first bytes. */
static int is_zip(const char *path)
{
    char first[4] = "";
    FILE *file = fopen(path, "rbe");
    const size_t got = file != NULL ? fread(first, 1, sizeof first, file) : 0;
    if (file != NULL) {
        fclose(file);
    }
    return got == sizeof first && memcmp(first, "PK\3\4", sizeof first) == 0;
}

/* What is no HDF5 file, and where the weights are, or how they are made of it. */
static enum v2v_status check_kind(const char *path)
{
    enum v2v_status rc = V2V_OK;
    char inside[V2V_PATH_BYTES];
    if (v2v_file_is_folder(path) &&
        v2v_text_format(inside, sizeof inside, "%s/weights.h5", path) == V2V_OK &&
        v2v_file_exists(inside)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is a folder; its weights are %s", path, inside));
    }
    V2V_TRY(v2v_file_check_input(path));
    if (v2v_file_is_hdf5(path) || H5Fis_hdf5(path) > 0) {
        goto done;
    }
    if (v2v_file_is_safetensors(path)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: is safetensors, not HDF5 as weights are: v2v3d convert --input %s -o "
                         "weights.h5 makes them of it",
                         path, path));
    }
    V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is %s", path,
                     is_zip(path) ? "a zip file, as PyTorch's own are: configs/README.md has how "
                                    "to make safetensors of it, and v2v3d convert weights of these"
                                  : "not an HDF5 file, as weights are: v2v3d train and weights "
                                    "init make them, and convert of safetensors"));
done:
    return rc;
}

/* An attribute that all weight files have is missing. */
static enum v2v_status refuse_other(hid_t file, const char *path, const char *attribute)
{
    char names[V2V_H5_LIST_BYTES];
    v2v_h5_list(names, sizeof names, file);
    return V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is missing: not a weight file; it %s; %s", path,
                    attribute, names,
                    v2v_h5_has(file, "weights")
                        ? "v2v3d convert makes one of another program's arrays"
                        : "v2v3d train and weights init make weight files");
}

static enum v2v_status check_version(hid_t file, const char *path)
{
    int64_t version = V2V_WEIGHTS_VERSION;
    int found = 0;
    const enum v2v_status rc = v2v_h5_get_integer(&version, &found, file, path, V2V_WEIGHTS_FORMAT);
    if (rc == V2V_OK && version > V2V_WEIGHTS_VERSION) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: format %lld was written by a newer program (this reads %d)", path,
                        (long long)version, V2V_WEIGHTS_VERSION);
    }
    return rc;
}

/* Files that name no method are of the one that was first; its settings were attributes alone. */
static enum v2v_status read_first_settings(struct v2v_weights_info *info, hid_t file,
                                           const char *path)
{
    enum v2v_status rc = V2V_OK;
    int64_t width = 0, features = 0;
    double volume_scale = 1.0;
    int found_width = 0, found_features = 0, found = 0;
    V2V_TRY(v2v_h5_get_integer(&width, &found_width, file, path, "width"));
    V2V_TRY(v2v_h5_get_integer(&features, &found_features, file, path, "features"));
    if (!found_width || !found_features) {
        V2V_TRY(refuse_other(file, path, found_width ? "features" : "width"));
    }
    V2V_TRY(v2v_h5_get_numbers(&volume_scale, &found, file, path, "volume_scale", 1));
    V2V_TRY(v2v_text_format(info->settings, sizeof info->settings,
                            "model.width=%lld\nmodel.features=%lld\nmodel.volume_scale=%.17g\n",
                            (long long)width, (long long)features, volume_scale));
    V2V_TRY(v2v_text_format(info->method, sizeof info->method, "v2v"));
done:
    return rc;
}

const struct v2v_weights_word v2v_weights_words[V2V_WEIGHTS_WORDS] = {
    {"method", offsetof(struct v2v_weights_info, method), V2V_WEIGHTS_WORD_BYTES},
    {"settings", offsetof(struct v2v_weights_info, settings), V2V_WEIGHTS_SETTINGS_BYTES},
    {"split", offsetof(struct v2v_weights_info, split), V2V_WEIGHTS_WORD_BYTES}};

const struct v2v_weights_count v2v_weights_counts[V2V_WEIGHTS_COUNTS] = {
    {"views", offsetof(struct v2v_weights_info, views), 1, 0},
    {"slices", offsetof(struct v2v_weights_info, slices), 1, 0},
    {"step", offsetof(struct v2v_weights_info, step), 0, 1},
    {"seconds", offsetof(struct v2v_weights_info, seconds), 0, 1},
    {"psf_crc32c", offsetof(struct v2v_weights_info, psf_sum), 0, 1}};

int v2v_weights_suit(const struct v2v_weights_info *info, int64_t psf_sum)
{
    return info->psf_sum == 0 || psf_sum == 0 || info->psf_sum == psf_sum;
}

const char *const v2v_weights_level_names[V2V_LEVEL_FIGURES] = {
    "trained_mean", "trained_peak", "trained_noise", "trained_noise_over_mean"};

/* A file that lacks one of them says nothing. */
static enum v2v_status read_levels(struct v2v_level_range *levels, hid_t file, const char *path)
{
    enum v2v_status rc = V2V_OK;
    int64_t frames = 0;
    int found = 0, all = 0;
    V2V_TRY(v2v_h5_get_integer(&frames, &all, file, path, V2V_WEIGHTS_FRAMES));
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        double ends[2];
        V2V_TRY(v2v_h5_get_numbers(ends, &found, file, path, v2v_weights_level_names[f], 2));
        if (found) {
            levels->least[f] = ends[0];
            levels->most[f] = ends[1];
        }
        all = all && found;
    }
    levels->frames = all ? frames : 0;
done:
    return rc;
}

static enum v2v_status write_levels(const struct v2v_level_range *levels, hid_t file,
                                    const char *path)
{
    enum v2v_status rc = V2V_OK;
    if (levels->frames == 0) {
        return V2V_OK;
    }
    V2V_TRY(v2v_h5_set_integer(file, path, V2V_WEIGHTS_FRAMES, levels->frames));
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        const double ends[] = {levels->least[f], levels->most[f]};
        V2V_TRY(v2v_h5_set_numbers(file, path, v2v_weights_level_names[f], ends, 2));
    }
done:
    return rc;
}

static enum v2v_status read_info(struct v2v_weights_info *info, hid_t file, const char *path)
{
    enum v2v_status rc = V2V_OK;
    int found = 0;
    *info = (struct v2v_weights_info){0};
    V2V_TRY(check_version(file, path));
    for (int i = 0; i < V2V_WEIGHTS_COUNTS; i++) {
        const struct v2v_weights_count *count = &v2v_weights_counts[i];
        int64_t *value = (int64_t *)((char *)info + count->at);
        V2V_TRY(v2v_h5_get_integer(value, &found, file, path, count->name));
        if (!found && !count->may_lack) {
            V2V_TRY(refuse_other(file, path, count->name));
        }
        if (found && *value < count->least) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is too small", path, count->name));
        }
    }
    for (int i = 0; i < V2V_WEIGHTS_WORDS; i++) {
        const struct v2v_weights_word *word = &v2v_weights_words[i];
        V2V_TRY(
            v2v_h5_get_text((char *)info + word->at, word->bytes, &found, file, path, word->name));
    }
    if (info->split[0] == '\0') {
        V2V_TRY(v2v_text_format(info->split, sizeof info->split, "even-odd"));
    }
    if (info->method[0] == '\0') {
        V2V_TRY(read_first_settings(info, file, path));
    }
    V2V_TRY(read_levels(&info->levels, file, path));
done:
    return rc;
}

/* Open a field's dataset: numbers in the field's shape. */
static enum v2v_status open_field(hid_t *set, hid_t file, const char *path, const char *place,
                                  const struct v2v_fields_item *field)
{
    enum v2v_status rc = V2V_OK;
    hsize_t extent[H5S_MAX_RANK] = {0};
    hid_t space = H5I_INVALID_HID, type = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_open_dataset(set, file, path, place));
    space = H5Dget_space(*set);
    type = H5Dget_type(*set);
    int same = H5Tget_class(type) == H5T_FLOAT &&
               H5Sget_simple_extent_dims(space, extent, NULL) == field->rank;
    for (int i = 0; same && i < field->rank; i++) {
        same = extent[i] == (hsize_t)field->shape[i];
    }
    if (!same) {
        char shape[96] = "";
        for (int i = 0, at = 0; i < field->rank; i++) {
            at += snprintf(shape + at, sizeof shape - (size_t)at, "%s%lld", i > 0 ? "," : "",
                           (long long)field->shape[i]);
        }
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is not float [%s], which this network needs", path,
                         place, shape));
    }
done:
    v2v_h5_close(&type);
    v2v_h5_close(&space);
    return rc;
}

static enum v2v_status check_values(const float *values, int64_t count, hid_t set, const char *path,
                                    const char *place)
{
    enum v2v_status rc = V2V_OK;
    int64_t stored = 0;
    int found = 0;
    V2V_TRY(v2v_h5_get_integer(&stored, &found, set, path, "crc32c"));
    if (found) {
        V2V_TRY(v2v_array_check_sum(values, count, stored, path, place));
    }
    V2V_TRY(v2v_array_check_finite(values, count, path, place));
done:
    return rc;
}

static enum v2v_status read_fields(float *arena, hid_t file, const char *path, const char *group,
                                   const struct v2v_fields *fields)
{
    enum v2v_status rc = V2V_OK;
    hid_t set = H5I_INVALID_HID;
    char place[PLACE_BYTES];
    V2V_TRY(v2v_text_format(place, sizeof place, "/%s", group));
    if (H5Lexists(file, place, H5P_DEFAULT) <= 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: has no group %s", path, place));
    }
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        V2V_TRY(v2v_text_format(place, sizeof place, "/%s/%s", group, field->name));
        V2V_TRY(open_field(&set, file, path, place, field));
        float *values = arena + field->offset;
        V2V_TRY(v2v_h5_read_all(values, set, H5T_NATIVE_FLOAT, path, place));
        V2V_TRY(check_values(values, field->count, set, path, place));
        v2v_h5_close(&set);
    }
done:
    v2v_h5_close(&set);
    return rc;
}

enum v2v_status v2v_weights_file_info(struct v2v_weights_info *info, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_file_state state;
    hid_t file = H5I_INVALID_HID;
    V2V_TRY(check_kind(path));
    V2V_TRY(v2v_h5_guard_input(&state, path));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(v2v_file_unchanged(read_info(info, file, path), &state, path));
done:
    v2v_h5_close(&file);
    return rc;
}

int v2v_weights_file_has(const char *path, const char *group)
{
    hid_t file = H5I_INVALID_HID;
    const int has = v2v_h5_guard(path) == V2V_OK && v2v_h5_open(&file, path) == V2V_OK &&
                    H5Lexists(file, group, H5P_DEFAULT) > 0;
    v2v_h5_close(&file);
    return has;
}

enum v2v_status v2v_weights_file_read(float *arena, const char *path, const char *group,
                                      const struct v2v_fields *fields)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_file_state state;
    hid_t file = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_guard_input(&state, path));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(check_version(file, path));
    V2V_TRY(v2v_file_unchanged(read_fields(arena, file, path, group, fields), &state, path));
done:
    v2v_h5_close(&file);
    return rc;
}

/* ---- writing ---- */

/* One line "section.key=value" of the settings as an attribute `key`. */
static enum v2v_status write_setting(hid_t file, const char *path, const char *line, size_t bytes)
{
    enum v2v_status rc = V2V_OK;
    char text[V2V_WEIGHTS_SETTINGS_BYTES];
    V2V_TRY(v2v_text_format(text, sizeof text, "%.*s", (int)bytes, line));
    char *name = strchr(text, '.'), *value = strchr(text, '='), *end = NULL;
    if (name == NULL || value == NULL || value < name) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "'%s' is not section.key=value", text));
    }
    *value++ = '\0';
    double number = strtod(value, &end);
    if (end == value || *end != '\0') {
        V2V_TRY(v2v_h5_set_text(file, path, name + 1, value));
    } else if (number == floor(number) && fabs(number) < 1e15) {
        V2V_TRY(v2v_h5_set_integer(file, path, name + 1, (int64_t)number));
    } else {
        V2V_TRY(v2v_h5_set_numbers(file, path, name + 1, &number, 1));
    }
done:
    return rc;
}

static enum v2v_status write_info(const struct v2v_weights_info *info, hid_t file, const char *path)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_h5_set_integer(file, path, V2V_WEIGHTS_FORMAT, V2V_WEIGHTS_VERSION));
    for (int i = 0; i < V2V_WEIGHTS_COUNTS; i++) {
        const int64_t *value = (const int64_t *)((const char *)info + v2v_weights_counts[i].at);
        V2V_TRY(v2v_h5_set_integer(file, path, v2v_weights_counts[i].name, *value));
    }
    for (int i = 0; i < V2V_WEIGHTS_WORDS; i++) {
        V2V_TRY(v2v_h5_set_text(file, path, v2v_weights_words[i].name,
                                (const char *)info + v2v_weights_words[i].at));
    }
    for (const char *line = info->settings; *line != '\0';) {
        size_t bytes = strcspn(line, "\n");
        V2V_TRY(write_setting(file, path, line, bytes));
        line += bytes + (line[bytes] == '\n');
    }
    V2V_TRY(write_levels(&info->levels, file, path));
done:
    return rc;
}

static enum v2v_status write_field(hid_t group, const char *path,
                                   const struct v2v_fields_item *field, const float *values)
{
    enum v2v_status rc = V2V_FAULT_POINT("h5.write");
    hsize_t extent[V2V_FIELDS_MAX_RANK] = {0};
    for (int i = 0; i < field->rank; i++) {
        extent[i] = (hsize_t)field->shape[i];
    }
    hid_t space = H5Screate_simple(field->rank, extent, NULL);
    hid_t set = H5I_INVALID_HID;
    V2V_TRY(rc);
    set = H5Dcreate2(group, field->name, H5T_IEEE_F32LE, space, H5P_DEFAULT, H5P_DEFAULT,
                     H5P_DEFAULT);
    if (set < 0 || H5Dwrite(set, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, field->name, "can't be written"));
    }
    const int64_t bytes = field->count * (int64_t)sizeof *values;
    V2V_TRY(v2v_h5_set_integer(set, path, "crc32c", v2v_file_crc32c(0, values, bytes)));
done:
    rc = v2v_h5_close_written(rc, &set, path, field->name);
    v2v_h5_close(&space);
    return rc;
}

static enum v2v_status write_group(hid_t file, const char *path, const char *name,
                                   const struct v2v_fields *fields, const float *arena)
{
    enum v2v_status rc = V2V_OK;
    hid_t group = H5Gcreate2(file, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (group < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, name, "can't be created"));
    }
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        V2V_TRY(write_field(group, path, field, arena + field->offset));
    }
done:
    v2v_h5_close(&group);
    return rc;
}

enum v2v_status v2v_weights_file_write(const char *path, const struct v2v_weights_info *info,
                                       const struct v2v_fields *fields,
                                       const float *const group[V2V_WEIGHTS_GROUPS],
                                       const char *history, const char *config)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    hid_t file = H5I_INVALID_HID;
    static const char *const names[V2V_WEIGHTS_GROUPS] = {"weights", "adam_m", "adam_v", "last"};
    const struct {
        const char *name, *text;
    } texts[] = {{"history", history}, {"config", config}};
    V2V_TRY(v2v_h5_begin(&file, temporary, path));
    V2V_TRY(write_info(info, file, path));
    for (int i = 0; i < V2V_WEIGHTS_GROUPS; i++) {
        if (group[i] != NULL) {
            V2V_TRY(write_group(file, path, names[i], fields, group[i]));
        }
    }
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        if (texts[i].text != NULL) {
            V2V_TRY(v2v_h5_put_text(file, path, texts[i].name, texts[i].text));
        }
    }
done:
    return v2v_h5_end(rc, &file, temporary, path);
}
