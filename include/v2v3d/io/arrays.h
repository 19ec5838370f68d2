/** Files of named arrays, whoever wrote them: safetensors, and HDF5 datasets in the group /weights,
 *  else at the root. */
#ifndef V2V3D_IO_ARRAYS_H
#define V2V3D_IO_ARRAYS_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/tensor/fields.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_ARRAY_NAME_BYTES = 192, V2V_ARRAY_TYPE_BYTES = 12, V2V_ARRAY_MOST_AXES = 8 };

struct v2v_array {
    char name[V2V_ARRAY_NAME_BYTES]; /**< printable ASCII */
    char type[V2V_ARRAY_TYPE_BYTES]; /**< as safetensors calls it: "F32", "BF16", "I64" */
    int rank;                        /**< 0: one number */
    int64_t shape[V2V_ARRAY_MOST_AXES];
    int64_t count; /**< elements, may be 0 */
    int64_t place; /**< safetensors: of its bytes in the file */
};

struct v2v_arrays;

/** Open to read: names, types and shapes, all checked against the file. safetensors: the header has
 *  at most 4 MiB, every array the bytes of its shape, the arrays fill the rest of the file without
 *  gap or overlap.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY
 *  @source huggingface/safetensors, README, "Format" */
enum v2v_status v2v_arrays_open(struct v2v_arrays **arrays, const char *path) V2V_MUST_CHECK;
/** @kind Local; accepts NULL. */
void v2v_arrays_close(struct v2v_arrays **arrays);

/** How many, and one of them, 0 .. count-1, lent until they are closed. @kind Local. */
int64_t v2v_arrays_count(const struct v2v_arrays *arrays);
const struct v2v_array *v2v_arrays_at(const struct v2v_arrays *arrays, int64_t index);
/** The array of that name, NULL when there is none. @kind Local. */
const struct v2v_array *v2v_arrays_find(const struct v2v_arrays *arrays, const char *name);

/** Elements along an axis of the array of that name; 0 when there is no such. @kind Local. */
int64_t v2v_arrays_extent(const struct v2v_arrays *arrays, const char *name, int axis);

/** Leave away the first `bytes` of every name, which they all have in common. @kind Local. */
void v2v_arrays_strip(struct v2v_arrays *arrays, int64_t bytes);

/** Does the file hold safetensors, by its first bytes? @kind Local. */
int v2v_file_is_safetensors(const char *path);

/** What a file of this program says beside its arrays; of others, info->method is "".
 *  @kind Local. @param config [*config is NULL: none] the configuration that it carries, to be
 *  given back by v2v_mem_free @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY */
enum v2v_status v2v_arrays_info(struct v2v_weights_info *info, char **config,
                                const struct v2v_arrays *arrays) V2V_MUST_CHECK;

/** The numbers of an array as float32: F64 rounded, F16 and BF16 as they are.
 *  @kind Local. @param out [array->count] @return V2V_OK | V2V_E_INPUT (no floating-point numbers;
 *  NaN or Inf, also by rounding; a checksum that does not hold) | V2V_E_MEMORY */
enum v2v_status v2v_arrays_read(const struct v2v_arrays *arrays, float *out,
                                const struct v2v_array *array) V2V_MUST_CHECK;

/** Write a network's weights as safetensors, float32; what `info` says, and `config` (may be NULL),
 *  are its metadata, with a CRC-32C of every array. Written under a temporary name, fsynced,
 *  renamed. @kind Local (one rank). @return V2V_OK | V2V_E_IO | V2V_E_MEMORY */
enum v2v_status v2v_safetensors_write(const char *path, const struct v2v_weights_info *info,
                                      const struct v2v_fields *fields, const float *arena,
                                      const char *config) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
