#include "v2v3d/tensor/fields.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <string.h>

enum { ALIGN_FLOATS = 16, FIRST_CAPACITY = 64 };

/** Twice the room in the table. */
static enum v2v_status grow(struct v2v_fields *fields)
{
    struct v2v_fields_item *larger = NULL;
    int64_t capacity = fields->capacity > 0 ? 2 * fields->capacity : FIRST_CAPACITY;
    if (V2V_ALLOC(larger, "tensor.fields", capacity) != V2V_OK) {
        return V2V_E_MEMORY;
    }
    if (fields->count > 0) {
        memcpy(larger, fields->item, (size_t)fields->count * sizeof *larger);
    }
    v2v_mem_free(fields->item);
    fields->item = larger;
    fields->capacity = capacity;
    return V2V_OK;
}

/** Elements of a shape; -1 when an extent is not positive or the product leaves int64_t. */
static int64_t shape_count(int rank, const int64_t *shape)
{
    int64_t count = 1;
    for (int axis = 0; axis < rank; axis++) {
        count = shape[axis] > 0 ? v2v_mem_product(count, shape[axis], 1) : -1;
        if (count < 0) {
            return -1;
        }
    }
    return count;
}

enum v2v_status v2v_fields_add(struct v2v_fields *fields, int64_t *index, const char *name,
                               int rank, const int64_t *shape)
{
    enum v2v_status rc = V2V_OK;
    size_t length = strlen(name);
    if (length == 0 || length >= V2V_FIELDS_NAME_BYTES) {
        return V2V_FAIL(V2V_E_INTERNAL, "field '%s': the name has no 1 to %d bytes", name,
                        V2V_FIELDS_NAME_BYTES - 1);
    }
    if (v2v_fields_find(fields, name) != NULL) {
        return V2V_FAIL(V2V_E_INTERNAL, "field '%s' is in the table already", name);
    }
    int64_t count = rank >= 1 && rank <= V2V_FIELDS_MAX_RANK ? shape_count(rank, shape) : -1;
    if (count < 0 || count > INT64_MAX - fields->total - (ALIGN_FLOATS - 1)) {
        return V2V_FAIL(V2V_E_INTERNAL, "field '%s': its shape of %d axes has no valid size", name,
                        rank);
    }
    if (fields->count == fields->capacity) {
        V2V_TRY(grow(fields));
    }
    struct v2v_fields_item *field = &fields->item[fields->count];
    *field = (struct v2v_fields_item){.rank = rank, .count = count, .offset = fields->total};
    memcpy(field->name, name, length + 1);
    memcpy(field->shape, shape, (size_t)rank * sizeof *shape);
    if (index != NULL) {
        *index = fields->count;
    }
    fields->count++;
    fields->total += v2v_round_up(count, ALIGN_FLOATS);
done:
    return rc;
}

const struct v2v_fields_item *v2v_fields_find(const struct v2v_fields *fields, const char *name)
{
    for (int64_t i = 0; i < fields->count; i++) {
        if (strcmp(fields->item[i].name, name) == 0) {
            return &fields->item[i];
        }
    }
    return NULL;
}

void v2v_fields_fini(struct v2v_fields *fields)
{
    v2v_mem_free(fields->item);
    *fields = (struct v2v_fields){0};
}
