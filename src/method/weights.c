#include "v2v3d/method/weights.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/method/networks.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* Sizes that no file is trusted beyond. */
enum { MOST_VIEWS = 4096, MOST_SLICES = 65536 };

/* Of names that the network of this configuration gives its parameters, those in the file. Names
 * don't depend on sizes; two views and one slice are enough for any network. */
static enum v2v_status count_names(int64_t *count, const char *method,
                                   const struct v2v_config *config, const struct v2v_arrays *arrays)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_schema schema = {0};
    const struct v2v_network_spec spec = {
        .config = config, .views = 2, .slices = 1, .outputs = V2V_NETWORK_ALL};
    *count = 0;
    V2V_TRY(v2v_network_schema(&schema, method, &spec));
    for (int64_t i = 0; i < schema.fields.count; i++) {
        *count += v2v_arrays_find(arrays, schema.fields.item[i].name) != NULL;
    }
done:
    v2v_schema_fini(&schema);
    return rc;
}

/* NULL: no network has any of the names. */
static enum v2v_status find_method(const struct v2v_network_ops **found,
                                   const struct v2v_config *config, const struct v2v_arrays *arrays)
{
    enum v2v_status rc = V2V_OK;
    int64_t most = 0, count = 0;
    *found = NULL;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        const struct v2v_network_ops *ops = v2v_network_at(i);
        V2V_TRY(count_names(&count, ops->name, config, arrays));
        if (count > most) {
            most = count;
            *found = ops;
        }
    }
done:
    return rc;
}

/* Bytes up to and with the first point, which all names have in common; 0: they don't. */
static int64_t common_word(const struct v2v_arrays *arrays)
{
    const char *first = v2v_arrays_count(arrays) > 0 ? v2v_arrays_at(arrays, 0)->name : "";
    const char *point = strchr(first, '.');
    const size_t bytes = point != NULL ? (size_t)(point - first) + 1 : 0;
    for (int64_t i = 0; i < v2v_arrays_count(arrays); i++) {
        const char *name = v2v_arrays_at(arrays, i)->name;
        if (strncmp(name, first, bytes) != 0 || name[bytes] == '\0') {
            return 0;
        }
    }
    return (int64_t)bytes;
}

/* The method, after whatever prefix hides it was left away. */
static enum v2v_status find_below_prefix(const struct v2v_network_ops **ops,
                                         const struct v2v_config *config, struct v2v_arrays *arrays)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(find_method(ops, config, arrays));
    for (int64_t bytes = common_word(arrays); *ops == NULL && bytes > 0;
         bytes = common_word(arrays)) {
        v2v_arrays_strip(arrays, bytes);
        V2V_TRY(find_method(ops, config, arrays));
    }
done:
    return rc;
}

/* Of a file that says nothing: the method by names, the rest by shapes and hints. */
static enum v2v_status recognise(struct v2v_weights_info *info, struct v2v_arrays *arrays,
                                 const char *path, const struct v2v_weights_hints *hints)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    struct v2v_config config = *hints->config;
    struct v2v_network_sizes sizes = {0};
    V2V_TRY(find_below_prefix(&ops, &config, arrays));
    if (ops == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: none of its %" PRId64 " arrays is of a network known here", path,
                         v2v_arrays_count(arrays)));
    }
    if (ops->sizes_of != NULL) {
        ops->sizes_of(&sizes, arrays);
    }
    for (int i = 0; i < V2V_NETWORK_MOST_SIZES && sizes.setting[i].key != NULL; i++) {
        char line[96];
        if (sizes.setting[i].value > 0) {
            V2V_TRY(v2v_text_format(line, sizeof line, "%s=%" PRId64, sizes.setting[i].key,
                                    sizes.setting[i].value));
            V2V_TRY(v2v_config_set(&config, line));
        }
    }
    const int64_t views = hints->views > 0 ? hints->views : sizes.views;
    const int64_t slices = sizes.slices > 0 ? sizes.slices : hints->slices;
    if (views <= 0 || slices <= 0) {
        V2V_TRY(V2V_FAIL(
            V2V_E_USAGE, "%s: the shapes of the network '%s' do not tell its %s: give %s", path,
            ops->name, views <= 0 ? "views" : "slices", views <= 0 ? "--views" : "--slices"));
    }
    V2V_TRY(v2v_text_format(config.model.method, sizeof config.model.method, "%s", ops->name));
    V2V_TRY(v2v_network_describe(info, &config, views, slices, 0));
done:
    return rc;
}

static void print_shape(char *text, size_t bytes, int rank, const int64_t *shape)
{
    size_t used = 0;
    text[0] = '\0';
    for (int i = 0; i < rank && used < bytes; i++) {
        used +=
            (size_t)snprintf(text + used, bytes - used, "%s%" PRId64, i > 0 ? "," : "", shape[i]);
    }
}

static int same_shape(const struct v2v_array *array, const struct v2v_fields_item *field)
{
    return array->rank == field->rank &&
           memcmp(array->shape, field->shape, (size_t)field->rank * sizeof *field->shape) == 0;
}

/* Before any memory is taken for numbers: every array of the network and no other. */
static enum v2v_status check_arrays(const struct v2v_fields *fields,
                                    const struct v2v_arrays *arrays, const char *path,
                                    const struct v2v_weights_info *info)
{
    char needed[96], there[192];
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        const struct v2v_array *array = v2v_arrays_find(arrays, field->name);
        print_shape(needed, sizeof needed, field->rank, field->shape);
        if (array == NULL) {
            return V2V_FAIL(V2V_E_INPUT, "%s: %s: is missing; the network '%s' needs it, [%s]",
                            path, field->name, info->method, needed);
        }
        print_shape(there, sizeof there, array->rank, array->shape);
        if (!same_shape(array, field)) {
            return V2V_FAIL(V2V_E_INPUT,
                            "%s: %s: is [%s], not [%s], which '%s' of %" PRId64
                            " views and %" PRId64 " slices needs",
                            path, field->name, there, needed, info->method, info->views,
                            info->slices);
        }
    }
    for (int64_t i = 0; i < v2v_arrays_count(arrays); i++) {
        const struct v2v_array *array = v2v_arrays_at(arrays, i);
        print_shape(there, sizeof there, array->rank, array->shape);
        if (v2v_fields_find(fields, array->name) == NULL) {
            return V2V_FAIL(V2V_E_INPUT, "%s: %s: [%s] is no array of the network '%s'", path,
                            array->name, there, info->method);
        }
    }
    return V2V_OK;
}

static enum v2v_status read_arrays(struct v2v_weights *weights, const struct v2v_arrays *arrays)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_fields *fields = &weights->schema.fields;
    V2V_TRY(V2V_ALLOC(weights->arena, "weights.arrays", fields->total));
    for (int64_t i = 0; i < fields->count; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        V2V_TRY(v2v_arrays_read(arrays, weights->arena + field->offset,
                                v2v_arrays_find(arrays, field->name)));
    }
done:
    return rc;
}

const char *v2v_weights_method(const char *path, const struct v2v_config *config)
{
    struct v2v_arrays *arrays = NULL;
    const struct v2v_network_ops *ops = NULL;
    const int is_read = v2v_arrays_open(&arrays, path) == V2V_OK &&
                        find_below_prefix(&ops, config, arrays) == V2V_OK;
    v2v_arrays_close(&arrays);
    return is_read && ops != NULL ? ops->name : NULL;
}

enum v2v_status v2v_weights_read(struct v2v_weights *weights, const char *path,
                                 const struct v2v_weights_hints *hints)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_arrays *arrays = NULL;
    struct v2v_config config = *hints->config;
    *weights = (struct v2v_weights){0};
    V2V_TRY(v2v_arrays_open(&arrays, path));
    V2V_TRY(v2v_arrays_info(&weights->info, &weights->config, arrays));
    weights->is_ours = weights->info.method[0] != '\0';
    if (!weights->is_ours) {
        V2V_TRY(recognise(&weights->info, arrays, path, hints));
    }
    if (weights->info.views > MOST_VIEWS || weights->info.slices > MOST_SLICES) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: is said to be of %" PRId64 " views and %" PRId64 " slices", path,
                         weights->info.views, weights->info.slices));
    }
    V2V_TRY(v2v_network_adopt(&config, &weights->info, path));
    const struct v2v_network_spec spec = {.config = &config,
                                          .views = weights->info.views,
                                          .slices = weights->info.slices,
                                          .outputs = V2V_NETWORK_ALL};
    V2V_TRY(v2v_network_schema(&weights->schema, weights->info.method, &spec));
    V2V_TRY(check_arrays(&weights->schema.fields, arrays, path, &weights->info));
    V2V_TRY(read_arrays(weights, arrays));
done:
    v2v_arrays_close(&arrays);
    return rc;
}

enum v2v_status v2v_weights_write(const struct v2v_weights *weights, const char *path,
                                  int is_safetensors)
{
    if (is_safetensors) {
        return v2v_safetensors_write(path, &weights->info, &weights->schema.fields, weights->arena,
                                     weights->config);
    }
    return v2v_weights_file_write(path, &weights->info, &weights->schema.fields,
                                  (const float *const[V2V_WEIGHTS_GROUPS]){weights->arena}, NULL,
                                  weights->config);
}

void v2v_weights_fini(struct v2v_weights *weights)
{
    v2v_schema_fini(&weights->schema);
    v2v_mem_free(weights->arena);
    v2v_mem_free(weights->config);
    *weights = (struct v2v_weights){0};
}
