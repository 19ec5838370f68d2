/** Checksums of frames: one number for all datasets of a frame, written beside its mark. */
#ifndef V2V_IO_H5_CHECKSUM_H
#define V2V_IO_H5_CHECKSUM_H

#include "io/h5_array.h"
#include "io/h5_writer.h"

/** The dataset of checksums [t]. */
#define V2V_H5_CHECKSUM "/checksum"

/** Names of a volume file's datasets, by V2V_VOLUME_.... */
extern const char *const v2v_h5_volume_sets[V2V_H5_WRITER_SETS];

/** What rows first .. first+count-1 add to the checksum of their frame, modulo 2^64; row n is
 *  ((set * T + t) * M + m) * Y + y of all rows of the file. Sums over any split of a frame, in any
 *  order, are the same. @kind Local. @param rows [count,width] */
uint64_t v2v_h5_rows_checksum(const float *rows, int64_t first, int64_t count, int64_t width);

/** Numbers of the file's frames: `/done`, `/checksum`. @kind Local.
 *  @param out [frames] of `type`, of memory
 *  @return V2V_OK | V2V_E_INPUT (unreadable, or not one integer a frame) | V2V_E_MEMORY */
enum v2v_status v2v_h5_read_of_frames(void *out, hid_t file, const char *path, const char *name,
                                      hid_t type, int64_t frames) V2V_MUST_CHECK;

/** The datasets that a file's checksums cover, opened to be read. */
struct v2v_h5_summed {
    struct v2v_h5_kind kind[V2V_H5_WRITER_SETS];
    struct v2v_h5_array array[V2V_H5_WRITER_SETS]; /**< without a kind: not there */
    float *image;                                  /**< [y,x] */
};

/** @kind Local. @param path borrowed @param dataset [sets]; NULL for what is not there
 *  @return V2V_OK | V2V_E_INPUT (unreadable, or of other shapes than the first) | V2V_E_MEMORY */
enum v2v_status v2v_h5_summed_open(struct v2v_h5_summed *summed, const char *path,
                                   const char *const *dataset) V2V_MUST_CHECK;

/** The checksum of frame t, as it is read. @kind Local. @return V2V_OK | V2V_E_INPUT */
enum v2v_status v2v_h5_summed_frame(struct v2v_h5_summed *summed, uint64_t *sum,
                                    int64_t t) V2V_MUST_CHECK;

/** @kind Local; accepts a zeroed one. */
void v2v_h5_summed_close(struct v2v_h5_summed *summed);

#endif
