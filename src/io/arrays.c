#include "io/arrays_internal.h"
#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

/* Networks have hundreds. */
enum { MOST_ARRAYS = 65536 };

enum v2v_status v2v_arrays_room(struct v2v_arrays *self, int64_t count)
{
    if (count > MOST_ARRAYS) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %lld arrays, more than %d", self->path, (long long)count,
                        MOST_ARRAYS);
    }
    return V2V_ALLOC(self->item, "io.arrays", count);
}

static int is_printable(const char *name)
{
    for (; *name != '\0'; name++) {
        if (*name <= ' ' || *name > '~') {
            return 0;
        }
    }
    return 1;
}

enum v2v_status v2v_array_set(struct v2v_array *array, const char *path, const char *name, int rank,
                              const int64_t *shape)
{
    const size_t length = strlen(name);
    if (length == 0 || length >= sizeof array->name || !is_printable(name)) {
        return V2V_FAIL(V2V_E_INPUT,
                        "%s: an array's name of %zu bytes is not of 1 to %zu printable characters",
                        path, length, sizeof array->name - 1);
    }
    memcpy(array->name, name, length + 1);
    if (rank > V2V_ARRAY_MOST_AXES) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s: has %d axes, more than %d", path, name, rank,
                        V2V_ARRAY_MOST_AXES);
    }
    array->rank = rank;
    array->count = 1;
    for (int i = 0; i < rank; i++) {
        array->shape[i] = shape[i];
        array->count = v2v_mem_product(array->count, shape[i], 1);
    }
    /* Of 8 bytes each. */
    if (array->count < 0 || array->count > INT64_MAX / 8) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s: its shape has no valid size", path, name);
    }
    return V2V_OK;
}

int v2v_file_is_safetensors(const char *path)
{
    static const char tiff[][4] = {"II*", "MM\0*", "II+", "MM\0+"};
    char start[9] = {0};
    FILE *file = fopen(path, "re");
    int is_tiff = 0;
    const size_t got = file != NULL ? fread(start, 1, sizeof start, file) : 0;
    if (file != NULL) {
        fclose(file);
    }
    for (size_t i = 0; i < sizeof tiff / sizeof *tiff; i++) {
        is_tiff = is_tiff || memcmp(start, tiff[i], sizeof tiff[i]) == 0;
    }
    return got == sizeof start && start[8] == '{' && !is_tiff; /* the header's first letter */
}

enum v2v_status v2v_arrays_open(struct v2v_arrays **arrays, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_arrays *self = NULL;
    *arrays = NULL;
    V2V_TRY(v2v_file_check_input(path));
    V2V_TRY(V2V_ALLOC(self, "io.arrays", 1));
    self->file = H5I_INVALID_HID;
    V2V_TRY(v2v_text_format(self->path, sizeof self->path, "%s", path));
    V2V_TRY(v2v_file_remember(&self->state, path));
    rc = v2v_file_is_safetensors(path) ? v2v_arrays_list_safetensors(self)
                                       : v2v_arrays_list_h5(self);
    V2V_TRY(v2v_file_unchanged(rc, &self->state, path));
    *arrays = self;
    return V2V_OK;
done:
    v2v_arrays_close(&self);
    return rc;
}

void v2v_arrays_close(struct v2v_arrays **arrays)
{
    struct v2v_arrays *self = *arrays;
    if (self != NULL) {
        if (self->stream != NULL) {
            fclose(self->stream);
        }
        json_decref(self->metadata);
        v2v_h5_close(&self->file);
        v2v_mem_free(self->item);
        v2v_mem_free(self);
        *arrays = NULL;
    }
}

int64_t v2v_arrays_count(const struct v2v_arrays *arrays)
{
    return arrays->count;
}

const struct v2v_array *v2v_arrays_at(const struct v2v_arrays *arrays, int64_t index)
{
    V2V_ASSERT(index >= 0 && index < arrays->count);
    return &arrays->item[index];
}

const struct v2v_array *v2v_arrays_find(const struct v2v_arrays *arrays, const char *name)
{
    for (int64_t i = 0; i < arrays->count; i++) {
        if (strcmp(arrays->item[i].name, name) == 0) {
            return &arrays->item[i];
        }
    }
    return NULL;
}

int64_t v2v_arrays_extent(const struct v2v_arrays *arrays, const char *name, int axis)
{
    const struct v2v_array *array = v2v_arrays_find(arrays, name);
    return array != NULL && axis < array->rank ? array->shape[axis] : 0;
}

void v2v_arrays_strip(struct v2v_arrays *arrays, int64_t bytes)
{
    V2V_ASSERT(arrays->count > 0);
    const size_t held = strlen(arrays->prefix);
    memcpy(arrays->prefix + held, arrays->item[0].name, (size_t)bytes);
    for (int64_t i = 0; i < arrays->count; i++) {
        char *name = arrays->item[i].name;
        memmove(name, name + bytes, strlen(name + bytes) + 1);
    }
}

enum v2v_status v2v_array_check_finite(const float *values, int64_t count, const char *path,
                                       const char *name)
{
    const int64_t bad = v2v_first_not_finite(values, count);
    return bad < 0 ? V2V_OK
                   : V2V_FAIL(V2V_E_INPUT, "%s: %s: element %lld is NaN or Inf", path, name,
                              (long long)bad);
}

enum v2v_status v2v_array_check_sum(const float *values, int64_t count, int64_t stored,
                                    const char *path, const char *name)
{
    const int64_t sum = v2v_file_crc32c(0, values, count * (int64_t)sizeof *values);
    return sum == stored
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT, "%s: %s: is damaged: its CRC-32C is %08llx, not %08llx",
                          path, name, (unsigned long long)sum, (unsigned long long)stored);
}

enum v2v_status v2v_arrays_read(const struct v2v_arrays *arrays, float *out,
                                const struct v2v_array *array)
{
    enum v2v_status rc = V2V_OK;
    char name[2 * V2V_ARRAY_NAME_BYTES];
    V2V_TRY(v2v_text_format(name, sizeof name, "%s%s", arrays->prefix, array->name));
    if (array->type[0] != 'F' && array->type[0] != 'B') { /* F32, BF16, .. */
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is of type %s: no floating-point numbers",
                         arrays->path, name, array->type));
    }
    rc = arrays->stream != NULL ? v2v_arrays_read_safetensors(arrays, out, name, array)
                                : v2v_arrays_read_h5(arrays, out, name, array);
    V2V_TRY(v2v_file_unchanged(rc, &arrays->state, arrays->path));
    V2V_TRY(v2v_array_check_finite(out, array->count, arrays->path, name));
done:
    return rc;
}
