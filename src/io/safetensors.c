#include "io/arrays_internal.h"
#include "io/file_internal.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>

/* A length of 8 bytes, a header of JSON, the arrays' bytes; all little-endian, row-major. Networks
 * of a thousand arrays have headers of 100 KB; what jansson makes of 4 MiB is 100 MB at most. */
enum { LENGTH_BYTES = 8, MOST_HEADER = 4 << 20, ALIGN_BYTES = 8 };

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "float32 is read as it lies in the file");

#define METADATA "__metadata__"

/* ---- types ---- */

static float of_f16(const unsigned char *bytes)
{
    const int word = bytes[0] | bytes[1] << 8;
    const int exponent = word >> 10 & 31, mantissa = word & 1023;
    const float size = exponent == 31  ? (mantissa == 0 ? INFINITY : NAN)
                       : exponent == 0 ? ldexpf((float)mantissa, -24)
                                       : ldexpf((float)(mantissa + 1024), exponent - 25);
    return word >> 15 != 0 ? -size : size;
}

static float of_bf16(const unsigned char *bytes)
{
    const uint32_t word = (uint32_t)bytes[0] << 16 | (uint32_t)bytes[1] << 24;
    float value;
    memcpy(&value, &word, sizeof value);
    return value;
}

static float of_f32(const unsigned char *bytes)
{
    float value;
    memcpy(&value, bytes, sizeof value);
    return value;
}

static float of_f64(const unsigned char *bytes)
{
    double value;
    memcpy(&value, bytes, sizeof value);
    return (float)value;
}

static const struct type {
    const char *name;
    int bytes;
    float (*value)(const unsigned char *bytes); /* NULL: none that is read */
} types[] = {{"F32", 4, of_f32}, {"F16", 2, of_f16},   {"BF16", 2, of_bf16}, {"F64", 8, of_f64},
             {"I64", 8, NULL},   {"U64", 8, NULL},     {"I32", 4, NULL},     {"U32", 4, NULL},
             {"I16", 2, NULL},   {"U16", 2, NULL},     {"I8", 1, NULL},      {"U8", 1, NULL},
             {"BOOL", 1, NULL},  {"F8_E5M2", 1, NULL}, {"F8_E4M3", 1, NULL}};

static const struct type *type_of(const char *name)
{
    for (size_t i = 0; name != NULL && i < sizeof types / sizeof *types; i++) {
        if (strcmp(types[i].name, name) == 0) {
            return &types[i];
        }
    }
    return NULL;
}

/* ---- the header ---- */

static enum v2v_status read_header(struct v2v_arrays *self, json_t **header, int64_t *header_bytes)
{
    enum v2v_status rc = V2V_OK;
    unsigned char length[LENGTH_BYTES] = {0};
    uint64_t bytes = 0;
    char *text = NULL;
    json_error_t error;
    const uint64_t rest = (uint64_t)self->state.bytes - LENGTH_BYTES;
    self->stream = fopen(self->path, "re");
    if (self->stream == NULL || fread(length, 1, sizeof length, self->stream) != sizeof length) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: can't be read", self->path));
    }
    for (int i = LENGTH_BYTES - 1; i >= 0; i--) {
        bytes = bytes << 8 | length[i];
    }
    if (bytes > MOST_HEADER || bytes > rest) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: its header has %llu bytes, more than %s", self->path,
                         (unsigned long long)bytes,
                         bytes > MOST_HEADER ? "the 4 MiB that are read" : "the file"));
    }
    V2V_TRY(V2V_ALLOC(text, "io.safetensors_header", (int64_t)bytes + 1));
    if (fread(text, 1, bytes, self->stream) != bytes) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: can't be read", self->path));
    }
    *header = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, &error);
    if (!json_is_object(*header)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: its header is no object of JSON: byte %d, %s",
                         self->path, *header == NULL ? error.position : 0,
                         *header != NULL ? "of another kind"
                         : json_error_code(&error) == json_error_duplicate_key
                             ? "a name that was there before"
                             : "not valid"));
    }
    *header_bytes = (int64_t)bytes;
done:
    v2v_mem_free(text);
    return rc;
}

/* Whole numbers, none negative. @return how many; -1 where they are not that, or too many */
static int numbers_of(int64_t *values, int most, const json_t *array)
{
    const size_t count = json_array_size(array);
    if (!json_is_array(array) || count > (size_t)most) {
        return -1;
    }
    for (size_t i = 0; i < count; i++) {
        const json_t *item = json_array_get(array, i);
        values[i] = json_integer_value(item);
        if (!json_is_integer(item) || values[i] < 0) {
            return -1;
        }
    }
    return (int)count;
}

/* `first` is where the arrays' bytes begin in the file. */
static enum v2v_status take_array(struct v2v_arrays *self, const char *name, const json_t *entry,
                                  int64_t first)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_array *array = &self->item[self->count];
    int64_t shape[V2V_ARRAY_MOST_AXES], ends[2] = {0, 0};
    const struct type *type = type_of(json_string_value(json_object_get(entry, "dtype")));
    const int rank = numbers_of(shape, V2V_ARRAY_MOST_AXES, json_object_get(entry, "shape"));
    const int found = numbers_of(ends, 2, json_object_get(entry, "data_offsets"));
    const int64_t room = self->state.bytes - first;
    V2V_TRY(v2v_array_set(array, self->path, name, rank >= 0 ? rank : 0, shape));
    if (type == NULL || rank < 0 || found != 2) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: its %s is not valid", self->path, name,
                         type == NULL ? "dtype"
                         : rank < 0   ? "shape"
                                      : "data_offsets"));
    }
    if (ends[0] > ends[1] || ends[1] > room) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: lies at bytes %lld to %lld of %lld", self->path,
                         name, (long long)ends[0], (long long)ends[1], (long long)room));
    }
    if (ends[1] - ends[0] != array->count * type->bytes) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: has %lld bytes, its shape %lld of type %s",
                         self->path, name, (long long)(ends[1] - ends[0]),
                         (long long)(array->count * type->bytes), type->name));
    }
    V2V_TRY(v2v_text_format(array->type, sizeof array->type, "%s", type->name));
    array->place = first + ends[0];
    self->count++;
done:
    return rc;
}

static int by_place(const void *a, const void *b)
{
    const struct v2v_array *one = a, *other = b;
    const int64_t most =
        one->place != other->place ? one->place - other->place : one->count - other->count;
    return most < 0 ? -1 : most > 0;
}

/* No byte of the file belongs to two arrays, or to none. Sorts them by place. */
static enum v2v_status check_places(struct v2v_arrays *self, int64_t first)
{
    int64_t end = first;
    qsort(self->item, (size_t)self->count, sizeof *self->item, by_place);
    for (int64_t i = 0; i < self->count; i++) {
        const struct v2v_array *array = &self->item[i];
        if (array->place != end) {
            return V2V_FAIL(V2V_E_INPUT, "%s: %s: %s", self->path, array->name,
                            array->place < end ? "lies over another array"
                                               : "a gap lies before it");
        }
        end += array->count * type_of(array->type)->bytes;
    }
    return end == self->state.bytes
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT, "%s: %lld bytes at its end are of no array", self->path,
                          (long long)(self->state.bytes - end));
}

enum v2v_status v2v_arrays_list_safetensors(struct v2v_arrays *self)
{
    enum v2v_status rc = V2V_OK;
    json_t *header = NULL, *entry = NULL;
    const char *name = NULL;
    int64_t header_bytes = 0;
    V2V_TRY(read_header(self, &header, &header_bytes));
    const int64_t first = LENGTH_BYTES + header_bytes;
    V2V_TRY(v2v_arrays_room(self, (int64_t)json_object_size(header)));
    json_object_foreach(header, name, entry)
    {
        if (strcmp(name, METADATA) == 0) {
            self->metadata = json_incref(entry);
        } else {
            V2V_TRY(take_array(self, name, entry, first));
        }
    }
    V2V_TRY(check_places(self, first));
done:
    json_decref(header);
    return rc;
}

/* ---- numbers ---- */

const char *v2v_arrays_text(const struct v2v_arrays *self, const char *name)
{
    return json_string_value(json_object_get(self->metadata, name));
}

static enum v2v_status check_sum(const struct v2v_arrays *self, const float *values,
                                 const char *name, const struct v2v_array *array)
{
    enum v2v_status rc = V2V_OK;
    char what[V2V_PATH_BYTES + 2 * V2V_ARRAY_NAME_BYTES + 16];
    int64_t stored = 0;
    V2V_TRY(v2v_text_format(what, sizeof what, "%s: crc32c.%s", self->path, name));
    const char *text = v2v_arrays_text(self, what + strlen(self->path) + 2);
    if (text != NULL) {
        V2V_TRY(v2v_text_to_i64(&stored, text, 0, UINT32_MAX, what, V2V_E_INPUT));
        V2V_TRY(v2v_array_check_sum(values, array->count, stored, self->path, name));
    }
done:
    return rc;
}

enum v2v_status v2v_arrays_read_safetensors(const struct v2v_arrays *self, float *out,
                                            const char *name, const struct v2v_array *array)
{
    enum v2v_status rc = V2V_OK;
    enum { BLOCK = 4096 };
    unsigned char block[BLOCK * sizeof(double)];
    const struct type *type = type_of(array->type);
    if (type->value == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is of type %s, not F32, F16, BF16 or F64",
                         self->path, name, array->type));
    }
    const size_t bytes = (size_t)type->bytes;
    int broken = fseeko(self->stream, (off_t)array->place, SEEK_SET) != 0;
    for (int64_t at = 0; at < array->count && !broken; at += BLOCK) {
        const int64_t count = array->count - at < BLOCK ? array->count - at : BLOCK;
        broken = fread(block, bytes, (size_t)count, self->stream) != (size_t)count;
        for (int64_t i = 0; i < count && !broken; i++) {
            out[at + i] = type->value(block + (size_t)i * bytes);
        }
    }
    if (broken) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: can't be read", self->path, name));
    }
    V2V_TRY(check_sum(self, out, name, array));
done:
    return rc;
}

/* ---- writing ---- */

static json_t *entry_of(const struct v2v_fields_item *field, int64_t first)
{
    json_t *shape = json_array();
    for (int i = 0; i < field->rank; i++) {
        if (json_array_append_new(shape, json_integer(field->shape[i])) != 0) {
            json_decref(shape);
            return NULL;
        }
    }
    return json_pack("{s:s, s:o, s:[I,I]}", "dtype", "F32", "shape", shape, "data_offsets",
                     (json_int_t)first,
                     (json_int_t)(first + field->count * (int64_t)sizeof(float)));
}

static int set_sum(json_t *metadata, const struct v2v_fields_item *field, const float *arena)
{
    char key[V2V_FIELDS_NAME_BYTES + 16], text[16];
    const int64_t bytes = field->count * (int64_t)sizeof *arena;
    snprintf(key, sizeof key, "crc32c.%s", field->name);
    snprintf(text, sizeof text, "%lu",
             (unsigned long)v2v_file_crc32c(0, arena + field->offset, bytes));
    return json_object_set_new(metadata, key, json_string(text)) == 0;
}

/* The header's text, padded so that the arrays lie at multiples of 8 bytes. */
static enum v2v_status make_header(char **text, const struct v2v_weights_info *info,
                                   const struct v2v_fields *fields, const float *arena,
                                   const char *config)
{
    enum v2v_status rc = V2V_OK;
    const size_t flags = JSON_COMPACT | JSON_PRESERVE_ORDER;
    json_t *header = json_object(), *metadata = json_object();
    int64_t first = 0;
    int fine = json_object_set(header, METADATA, metadata) == 0;
    V2V_TRY(v2v_weights_to_metadata(metadata, info));
    if (config != NULL) {
        fine = fine && json_object_set_new(metadata, "config", json_string(config)) == 0;
    }
    for (int64_t i = 0; i < fields->count && fine; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        fine = set_sum(metadata, field, arena) &&
               json_object_set_new(header, field->name, entry_of(field, first)) == 0;
        first += field->count * (int64_t)sizeof *arena;
    }
    const size_t length = fine ? json_dumpb(header, NULL, 0, flags) : 0;
    const size_t padded = (length + ALIGN_BYTES - 1) / ALIGN_BYTES * ALIGN_BYTES;
    if (length == 0) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "the header of a safetensors file: out of memory"));
    }
    V2V_TRY(V2V_ALLOC(*text, "io.safetensors_header", (int64_t)padded + 1));
    memset(*text, ' ', padded);
    const size_t put = json_dumpb(header, *text, length, flags);
    V2V_ASSERT(put == length);
done:
    json_decref(metadata);
    json_decref(header);
    return rc;
}

static int write_all(FILE *out, const char *header, const struct v2v_fields *fields,
                     const float *arena)
{
    unsigned char length[LENGTH_BYTES];
    const size_t bytes = strlen(header);
    for (int i = 0; i < LENGTH_BYTES; i++) {
        length[i] = (unsigned char)((uint64_t)bytes >> 8 * i);
    }
    int fine = fwrite(length, 1, sizeof length, out) == sizeof length &&
               fwrite(header, 1, bytes, out) == bytes;
    for (int64_t i = 0; i < fields->count && fine; i++) {
        const struct v2v_fields_item *field = &fields->item[i];
        const size_t count = (size_t)field->count;
        fine = fwrite(arena + field->offset, sizeof *arena, count, out) == count;
    }
    return fine;
}

enum v2v_status v2v_safetensors_write(const char *path, const struct v2v_weights_info *info,
                                      const struct v2v_fields *fields, const float *arena,
                                      const char *config)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    char *header = NULL;
    FILE *out = NULL;
    V2V_TRY(make_header(&header, info, fields, arena, config));
    V2V_TRY(v2v_file_begin(&out, temporary, path));
    if (!write_all(out, header, fields, arena)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno)));
    }
done:
    v2v_mem_free(header);
    return v2v_file_close_and_commit(rc, out, temporary, path);
}
