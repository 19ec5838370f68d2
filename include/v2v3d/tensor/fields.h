/** Named arrays in one arena.
 *
 *  Purpose: parameters, gradients and Adam moments live in one arena each, with the same table of
 *  names and shapes: one all-reduce, one norm, one write; the table is the schema of weight files.
 *  Invariants: fields lie in the order in which they were added, each start is a multiple of 16
 *  floats, padding is zero and stays zero.
 *
 *  Example (compiled by tests/unit/tensor):
 *
 *      struct v2v_fields fields = {0};
 *      int64_t weight = 0, bias = 0;
 *      V2V_TRY(v2v_fields_add(&fields, &weight, "conv.weight", 4, (int64_t[]){8, 4, 3, 3}));
 *      V2V_TRY(v2v_fields_add(&fields, &bias, "conv.bias", 1, (int64_t[]){8}));
 *      V2V_TRY(V2V_ALLOC(arena, "weights", fields.total));
 *      float *w = arena + fields.item[weight].offset;
 *  done:
 *      v2v_fields_fini(&fields);
 */
#ifndef V2V3D_TENSOR_FIELDS_H
#define V2V3D_TENSOR_FIELDS_H
#include "v2v3d/base/status.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define V2V_FIELDS_NAME_BYTES 64
#define V2V_FIELDS_MAX_RANK 4

struct v2v_fields_item {
    char name[V2V_FIELDS_NAME_BYTES];
    int rank;
    int64_t shape[V2V_FIELDS_MAX_RANK];
    int64_t count;    /**< elements */
    int64_t offset;   /**< floats from the start of the arena */
    int starts_small; /**< bool: of a network's last layer; initialisers may make it small */
};

struct v2v_fields {
    struct v2v_fields_item *item;
    int64_t count;
    int64_t capacity;
    int64_t total; /**< floats of an arena that holds all fields, padding included */
};

/** Append a field; *index (may be NULL) is its place in the table.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL (name too long, known, size
 * overflow) */
enum v2v_status v2v_fields_add(struct v2v_fields *fields, int64_t *index, const char *name,
                               int rank, const int64_t *shape) V2V_MUST_CHECK;

/** The field of that name, NULL when there is none. @kind Local. */
const struct v2v_fields_item *v2v_fields_find(const struct v2v_fields *fields, const char *name);

/** @kind Local. Accepts a zeroed table. */
void v2v_fields_fini(struct v2v_fields *fields);

#ifdef __cplusplus
}
#endif

#endif
