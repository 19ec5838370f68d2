/** What the two kinds of files of named arrays share. */
#ifndef V2V_IO_ARRAYS_INTERNAL_H
#define V2V_IO_ARRAYS_INTERNAL_H

#include "v2v3d/io/arrays.h"
#include "v2v3d/io/file.h"
#include <hdf5.h>
#include <jansson.h>
#include <stddef.h>
#include <stdio.h>

/** The newest form of what a weight file says; an attribute of HDF5, or a key of the metadata, as
 *  all below. */
#define V2V_WEIGHTS_FORMAT "format_version"
enum { V2V_WEIGHTS_VERSION = 1, V2V_WEIGHTS_WORDS = 3, V2V_WEIGHTS_COUNTS = 5 };

/** Texts and whole numbers of struct v2v_weights_info: their names and where they lie in it. */
struct v2v_weights_word {
    const char *name;
    size_t at, bytes;
};
struct v2v_weights_count {
    const char *name;
    size_t at;
    int64_t least;
    int may_lack; /**< older files do: 0 then */
};
extern const struct v2v_weights_word v2v_weights_words[V2V_WEIGHTS_WORDS];
extern const struct v2v_weights_count v2v_weights_counts[V2V_WEIGHTS_COUNTS];

/** Those of struct v2v_level_range; its figures are two numbers each. */
#define V2V_WEIGHTS_FRAMES "trained_frames"
extern const char *const v2v_weights_level_names[V2V_LEVEL_FIGURES];

struct v2v_arrays {
    char path[V2V_PATH_BYTES];
    struct v2v_file_state state;
    struct v2v_array *item;
    int64_t count;
    char prefix[V2V_ARRAY_NAME_BYTES]; /* what was left away of all names */
    FILE *stream;                      /* safetensors */
    json_t *metadata;                  /* NULL: none */
    hid_t file;                        /* HDF5 */
    const char *group;                 /* "/weights/" or "/" */
};

/** Take memory for `count` arrays, zeroed. @kind Local. @return V2V_OK | V2V_E_INPUT (too many) |
 *  V2V_E_MEMORY */
enum v2v_status v2v_arrays_room(struct v2v_arrays *self, int64_t count) V2V_MUST_CHECK;

/** Name, rank, shape and with them the count of an array. @kind Local. @return V2V_OK | V2V_E_INPUT
 *  (a name too long or not printable, too many axes, a size overflow) */
enum v2v_status v2v_array_set(struct v2v_array *array, const char *path, const char *name, int rank,
                              const int64_t *shape) V2V_MUST_CHECK;

/** The parts of v2v_arrays_open and _read that differ. @kind Local. */
enum v2v_status v2v_arrays_list_h5(struct v2v_arrays *self) V2V_MUST_CHECK;
enum v2v_status v2v_arrays_list_safetensors(struct v2v_arrays *self) V2V_MUST_CHECK;
enum v2v_status v2v_arrays_read_h5(const struct v2v_arrays *self, float *out, const char *name,
                                   const struct v2v_array *array) V2V_MUST_CHECK;
enum v2v_status v2v_arrays_read_safetensors(const struct v2v_arrays *self, float *out,
                                            const char *name,
                                            const struct v2v_array *array) V2V_MUST_CHECK;

/** Text of the safetensors metadata, NULL when it is not there. @kind Local. */
const char *v2v_arrays_text(const struct v2v_arrays *self, const char *name);

/** What a weight file says, out of the metadata and as metadata. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT; V2V_E_MEMORY */
enum v2v_status v2v_weights_from_metadata(struct v2v_weights_info *info,
                                          const struct v2v_arrays *self) V2V_MUST_CHECK;
enum v2v_status v2v_weights_to_metadata(json_t *metadata,
                                        const struct v2v_weights_info *info) V2V_MUST_CHECK;

/** Fail where a number of an array that was read is NaN or Inf. @kind Local. */
enum v2v_status v2v_array_check_finite(const float *values, int64_t count, const char *path,
                                       const char *name) V2V_MUST_CHECK;

/** Fail where a checksum that was stored with values as float32 is not theirs. @kind Local. */
enum v2v_status v2v_array_check_sum(const float *values, int64_t count, int64_t stored,
                                    const char *path, const char *name) V2V_MUST_CHECK;

#endif
