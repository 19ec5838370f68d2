/** The TIFF files of a folder, in the order in which people count. */
#ifndef V2V_IO_FOLDER_H
#define V2V_IO_FOLDER_H

#include "v2v3d/io/file.h"

struct v2v_folder {
    char path[V2V_PATH_BYTES];
    char **name; /**< [count], without the folder */
    int64_t count;
};

/** List the files whose names end in .tif or .tiff, but hidden ones; numbers in names are in the
 *  order of their values: view_2 before view_10.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (cannot be listed; none there) | V2V_E_MEMORY;
 *  v2v_folder_fini after both */
enum v2v_status v2v_folder_list(struct v2v_folder *folder, const char *path) V2V_MUST_CHECK;

/** Path of file `i`. @kind Local. @return V2V_OK | V2V_E_INPUT (too long) */
enum v2v_status v2v_folder_path(char path[V2V_PATH_BYTES], const struct v2v_folder *folder,
                                int64_t i) V2V_MUST_CHECK;
void v2v_folder_fini(struct v2v_folder *folder);

/** Of files that are numbered one by one, or in equal steps, the first that isn't there between
 *  those that are. Numbers of which fewer than half are followed by the next one are no numbering.
 *  @kind Local. @param missing its name, without the folder @return bool: there is one */
int v2v_folder_gap(char missing[V2V_PATH_BYTES], const struct v2v_folder *folder);

/** < 0, 0, > 0: `a` before `b`, the same, after. @kind Local. */
int v2v_folder_compare(const char *a, const char *b);

#endif
