#ifndef V2V3D_IO_WEIGHTS_FILE_H
#define V2V3D_IO_WEIGHTS_FILE_H

#include "v2v3d/base/status.h"
#include "v2v3d/io/level.h"
#include "v2v3d/tensor/fields.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Settings: a text of V2V_CONFIG_TEXT_BYTES and as much for all others. */
enum { V2V_WEIGHTS_WORD_BYTES = 32, V2V_WEIGHTS_SETTINGS_BYTES = 4096 };

/** Groups of arrays, one for every field each; files that can be trained on have more than the
 *  first. */
enum v2v_weights_group {
    V2V_WEIGHTS,      /**< "weights": those that are the result */
    V2V_WEIGHTS_M,    /**< "adam_m": Adam's means */
    V2V_WEIGHTS_V,    /**< "adam_v": .. and mean squares */
    V2V_WEIGHTS_LAST, /**< "last": of the last step, where the result is their running mean */
    V2V_WEIGHTS_GROUPS
};

/** What a weight file says beside its arrays. */
struct v2v_weights_info {
    char method[V2V_WEIGHTS_WORD_BYTES];       /**< the network's; "v2v" where absent */
    char settings[V2V_WEIGHTS_SETTINGS_BYTES]; /**< lines "section.key=value": the method's, which
                                                    shapes and function depend on */
    char split[V2V_WEIGHTS_WORD_BYTES];        /**< which views which volume sees, "even-odd" */
    int64_t views, slices;
    int64_t step;    /**< training step, 0 for fresh weights */
    int64_t seconds; /**< of training until then; older files say nothing: 0 */
    int64_t psf_sum; /**< v2v_psf_file_sum of the PSFs, as the network used them; 0: not known */
    struct v2v_level_range levels; /**< of what it was trained on; older files say nothing */
};

/** Are PSFs of this v2v_psf_file_sum those that the weights were made for, as far as is known?
 *  @kind Local. */
int v2v_weights_suit(const struct v2v_weights_info *info, int64_t psf_sum);

/** Read the attributes only. Of files without `method` the settings are what the attributes width,
 *  features and volume_scale say. @kind Local. @return V2V_OK | V2V_E_INPUT (of another kind of
 *  file: what it is, and what makes weights) */
enum v2v_status v2v_weights_file_info(struct v2v_weights_info *info,
                                      const char *path) V2V_MUST_CHECK;

/** Is it an HDF5 file with that group? @kind Local. */
int v2v_weights_file_has(const char *path, const char *group);

/** Read `/GROUP/NAME` of every field into its place of the arena; every field must be there with
 * its shape, finite and with a matching checksum when the file has one; others are ignored.
 *  @kind Local. @param group its name
 *  @return V2V_OK | V2V_E_INPUT (names file, field, reason) */
enum v2v_status v2v_weights_file_read(float *arena, const char *path, const char *group,
                                      const struct v2v_fields *fields) V2V_MUST_CHECK;

/** Write the groups that are not NULL; `history` and `config` (may be NULL) are stored as text.
 *  Every setting also is an attribute by its key, for people and other programs. CRC-32C
 *  of every array in its attr `crc32c`.
 *  Written under a temporary name, fsynced, renamed.
 *  @kind Local (one rank). @return V2V_OK | V2V_E_IO | V2V_E_INPUT (a name or setting too long) */
enum v2v_status v2v_weights_file_write(const char *path, const struct v2v_weights_info *info,
                                       const struct v2v_fields *fields,
                                       const float *const group[V2V_WEIGHTS_GROUPS],
                                       const char *history, const char *config) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
