/** A folder of TIFF stacks that are all alike, read as one. */
#ifndef V2V_IO_TIFF_FOLDER_H
#define V2V_IO_TIFF_FOLDER_H

#include "io/folder.h"
#include "v2v3d/io/tiff.h"

struct v2v_tiff_folder;

/** Open every file once: all have the pages, size and type of the first, and its channels, slices
 *  and frames. A few stay open. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT (the file that differs, and in what) | V2V_E_MEMORY */
enum v2v_status v2v_tiff_folder_open(struct v2v_tiff_folder **folder,
                                     const char *path) V2V_MUST_CHECK;
int64_t v2v_tiff_folder_files(const struct v2v_tiff_folder *folder);
/** Of each file. @kind Local. */
const struct v2v_tiff_info *v2v_tiff_folder_info(const struct v2v_tiff_folder *folder);

/** Warn of what may not be meant: a number that the names leave out, and pixel sizes of another
 *  file than the first that differ from its own by more than 1 %. @kind Rank-0. */
void v2v_tiff_folder_warn(const struct v2v_tiff_folder *folder);

/** One page of a file as float32. @kind Local.
 *  @return V2V_OK | V2V_E_INPUT (as v2v_tiff_read; the file changed) | V2V_E_MEMORY
 *  @cost a file that is not open any more is opened, and its pages walked through */
enum v2v_status v2v_tiff_folder_read(struct v2v_tiff_folder *folder, float *out, int64_t file,
                                     int64_t page) V2V_MUST_CHECK;
void v2v_tiff_folder_close(struct v2v_tiff_folder **folder);

#endif
