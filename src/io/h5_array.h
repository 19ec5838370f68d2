/** A numeric dataset of images, [y,x] behind one or two outer axes, opened to read. */
#ifndef V2V_IO_H5_ARRAY_H
#define V2V_IO_H5_ARRAY_H

#include "io/h5_chunks.h"
#include "v2v3d/base/status.h"
#include <hdf5.h>
#include <stdint.h>

/** What a kind of file calls its dataset and its axes. */
struct v2v_h5_kind {
    const char *dataset; /**< "/views" */
    const char *axes;    /**< "tvyx"; without its first letter for three axes */
    const char *axis[4]; /**< "frame", "view", "y", "x": for messages */
    int may_be_other;    /**< whoever opens it may name another dataset: --dataset */
    int may_be_folder;   /**< of TIFF files */
    int least_rank;      /**< 3: the first axis may be absent (one frame); 4 */
};

struct v2v_h5_array {
    const char *path; /**< borrowed */
    const struct v2v_h5_kind *kind;
    hid_t file, set;
    struct v2v_h5_chunks *chunks;
    int rank;           /**< axes in the file */
    int64_t shape[4];   /**< 1 in front for three axes */
    double type_max;    /**< of an integer type; 1 for floats, and where numbers are packed */
    double zero, scale; /**< a value is zero + scale times what is stored; 0 and 1: as stored */
};

/** Open and check: numbers, three or four axes, none empty, inside this one file, decodable here,
 *  and written at all. A failure leaves nothing open.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (file, dataset, reason) */
enum v2v_status v2v_h5_array_open(struct v2v_h5_array *array, const char *path,
                                  const struct v2v_h5_kind *kind) V2V_MUST_CHECK;

/** Images first .. first+count-1 of outer index t as float32, as they are stored.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (unreadable; NaN or Inf with its place) */
enum v2v_status v2v_h5_array_read(const struct v2v_h5_array *array, float *out, int64_t t,
                                  int64_t first, int64_t count) V2V_MUST_CHECK;

/** Make values of `count` numbers as stored: a file's attributes scale_factor and add_offset.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (a value that float32 does not hold)
 *  @source CF conventions 1.11, 8.1 */
enum v2v_status v2v_h5_array_unpack(const struct v2v_h5_array *array, float *x,
                                    int64_t count) V2V_MUST_CHECK;

/** @kind Local; accepts one that is not open. */
void v2v_h5_array_close(struct v2v_h5_array *array);

#endif
