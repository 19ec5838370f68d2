#include "io/arrays_internal.h"
#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <string.h>

/* "/weights/" and an array's name. */
#define PLACE_BYTES (2 * V2V_ARRAY_NAME_BYTES + 16)

/* Configurations are some KB. */
enum { MOST_TEXT = 1 << 20 };

/* "F32", "I64": as far as it is a number in one of the sizes that have a name. */
static enum v2v_status set_type(struct v2v_array *array, hid_t type)
{
    const H5T_class_t class = H5Tget_class(type);
    const char *kind = class == H5T_FLOAT ? "F" : class == H5T_INTEGER ? "I" : ""; /* or U */
    return kind[0] != '\0' ? v2v_text_format(array->type, sizeof array->type, "%s%zu", kind,
                                             8 * H5Tget_size(type))
                           : v2v_text_format(array->type, sizeof array->type, "no number");
}

static enum v2v_status look_at(struct v2v_arrays *self, struct v2v_array *array, const char *name)
{
    enum v2v_status rc = V2V_OK;
    char place[PLACE_BYTES];
    hsize_t extent[H5S_MAX_RANK] = {0};
    int64_t shape[H5S_MAX_RANK] = {0};
    struct v2v_h5_chunks *chunks = NULL;
    hid_t set = H5I_INVALID_HID, space = H5I_INVALID_HID, type = H5I_INVALID_HID;
    V2V_TRY(v2v_text_format(place, sizeof place, "%s%s", self->group, name));
    V2V_TRY(v2v_h5_open_dataset(&set, self->file, self->path, place));
    space = H5Dget_space(set);
    type = H5Dget_type(set);
    V2V_TRY(set_type(array, type));
    if (array->type[0] == 'F') { /* is it all there? */
        V2V_TRY(v2v_h5_chunks_create(&chunks, set, self->path, place));
    }
    const int rank = H5Sget_simple_extent_dims(space, extent, NULL);
    if (rank < 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: has no shape", self->path, place));
    }
    for (int i = 0; i < rank; i++) {
        shape[i] = extent[i] <= (hsize_t)INT64_MAX ? (int64_t)extent[i] : -1;
    }
    V2V_TRY(v2v_array_set(array, self->path, name, rank, shape));
done:
    v2v_h5_chunks_destroy(&chunks);
    v2v_h5_close(&type);
    v2v_h5_close(&space);
    v2v_h5_close(&set);
    return rc;
}

enum v2v_status v2v_arrays_list_h5(struct v2v_arrays *self)
{
    enum v2v_status rc = V2V_OK;
    H5G_info_t group = {0};
    V2V_TRY(v2v_h5_guard(self->path));
    V2V_TRY(v2v_h5_open(&self->file, self->path));
    self->group = H5Lexists(self->file, "/weights", H5P_DEFAULT) > 0 ? "/weights/" : "/";
    if (H5Gget_info_by_name(self->file, self->group, &group, H5P_DEFAULT) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, self->path, self->group, "can't be opened as a group"));
    }
    V2V_TRY(v2v_arrays_room(self, (int64_t)group.nlinks));
    for (hsize_t i = 0; i < group.nlinks; i++) {
        char name[V2V_ARRAY_NAME_BYTES];
        const ssize_t length = H5Lget_name_by_idx(self->file, self->group, H5_INDEX_NAME,
                                                  H5_ITER_INC, i, name, sizeof name, H5P_DEFAULT);
        if (length < 0 || length >= (ssize_t)sizeof name) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: link %lld has no name of 1 to %zu characters",
                             self->path, self->group, (long long)i, sizeof name - 1));
        }
        V2V_TRY(look_at(self, &self->item[self->count++], name));
    }
done:
    return rc;
}

enum v2v_status v2v_arrays_read_h5(const struct v2v_arrays *self, float *out, const char *name,
                                   const struct v2v_array *array)
{
    enum v2v_status rc = V2V_OK;
    char place[PLACE_BYTES];
    int64_t stored = 0;
    int found = 0;
    hid_t set = H5I_INVALID_HID;
    V2V_TRY(v2v_text_format(place, sizeof place, "%s%s", self->group, name));
    V2V_TRY(v2v_h5_open_dataset(&set, self->file, self->path, place));
    V2V_TRY(v2v_h5_read_all(out, set, H5T_NATIVE_FLOAT, self->path, place));
    V2V_TRY(v2v_h5_get_integer(&stored, &found, set, self->path, "crc32c"));
    if (found) {
        V2V_TRY(v2v_array_check_sum(out, array->count, stored, self->path, place));
    }
done:
    v2v_h5_close(&set);
    return rc;
}

/* A text as v2v_h5_put_text writes it; others are none of this program's. */
static enum v2v_status read_text(char **text, const struct v2v_arrays *self, const char *name)
{
    enum v2v_status rc = V2V_OK;
    hid_t set = H5I_INVALID_HID, type = H5I_INVALID_HID, space = H5I_INVALID_HID;
    if (H5Lexists(self->file, name, H5P_DEFAULT) <= 0) {
        return V2V_OK;
    }
    V2V_TRY(v2v_h5_open_dataset(&set, self->file, self->path, name));
    type = H5Dget_type(set);
    space = H5Dget_space(set);
    const size_t bytes = H5Tget_size(type);
    if (H5Tget_class(type) == H5T_STRING && H5Tis_variable_str(type) == 0 && bytes <= MOST_TEXT &&
        H5Sget_simple_extent_npoints(space) == 1 && H5Dget_storage_size(set) == bytes) {
        V2V_TRY(V2V_ALLOC(*text, "io.text", (int64_t)bytes + 1));
        if (H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, *text) < 0) {
            V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, self->path, name, "can't be read"));
        }
    }
done:
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    v2v_h5_close(&set);
    return rc;
}

static enum v2v_status copy_text(char **copy, const char *text)
{
    const int64_t bytes = (int64_t)strlen(text) + 1;
    if (V2V_ALLOC(*copy, "io.text", bytes) != V2V_OK) {
        return V2V_E_MEMORY;
    }
    memcpy(*copy, text, (size_t)bytes);
    return V2V_OK;
}

enum v2v_status v2v_arrays_info(struct v2v_weights_info *info, char **config,
                                const struct v2v_arrays *arrays)
{
    enum v2v_status rc = V2V_OK;
    *config = NULL;
    *info = (struct v2v_weights_info){0};
    if (arrays->stream != NULL) {
        const char *text = v2v_arrays_text(arrays, "config");
        V2V_TRY(v2v_weights_from_metadata(info, arrays));
        V2V_TRY(text != NULL ? copy_text(config, text) : V2V_OK);
    } else if (H5Aexists(arrays->file, "views") > 0) {
        V2V_TRY(v2v_weights_file_info(info, arrays->path));
        V2V_TRY(read_text(config, arrays, "config"));
    }
done:
    return rc;
}
