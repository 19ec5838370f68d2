/** A recording or volume to read, whatever the file type: a TIFF stack or an HDF5 dataset, seen as
 *  pages in one row. */
#ifndef V2V_IO_STACK_H
#define V2V_IO_STACK_H

#include "io/h5_array.h"
#include "io/tiff_folder.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/par/comm.h"

/** What a TIFF says of its pages, once a channel is chosen; the product is their number. One alone
 *  above 1 says little: programs call a row of pages slices, or frames. */
struct v2v_stack_axes {
    int64_t channels, slices, frames;
};

struct v2v_stack {
    char path[V2V_PATH_BYTES];
    struct v2v_file_state state; /**< before it was opened; every read fails once it differs */
    const struct v2v_h5_kind *kind;
    struct v2v_h5_kind
        named; /**< with the dataset that the settings name; then `kind` points here */
    char dataset[V2V_CONFIG_TEXT_BYTES + 1];
    struct v2v_h5_array array;
    int is_tiff;                    /**< a file or a folder of them */
    struct v2v_tiff *tiff;          /**< a file */
    struct v2v_tiff_folder *folder; /**< or a folder, whose files hold .. */
    int64_t files, pages_of_file;   /**< .. so many pages each (of the channel) */
    int by_view;                    /**< they are views: a frame has a page of each */
    int64_t frames, images;         /**< HDF5: [frames, images, y, x]; TIFF: 1 and its pages */
    int64_t pages;                  /**< frames * images */
    int64_t height, width;
    double type_max;            /**< of an integer type, 1 of other values */
    struct v2v_stack_axes axes; /**< of an HDF5 file 1, images, frames */
    int is_own; /**< a TIFF file of this program: frames alone are frames of one slice or view */
    double pixel_size_um, slice_spacing_um, frame_interval_s; /**< as a TIFF states them; or 0 */
    int64_t first_of_file, step_of_file; /**< TIFF: page p is that one of the file, plus p steps */
};

/** Recordings `/views`, volumes `/volume` and PSF sets `/psf`. */
extern const struct v2v_h5_kind v2v_h5_views;
extern const struct v2v_h5_kind v2v_h5_volume;
extern const struct v2v_h5_kind v2v_h5_psf;

/** Open on every rank; an HDF5 file only after a look from a child of rank 0. A folder's
 *  pages come frame by frame (settings->layout; settings->views decides). Settings may name a
 *  dataset, or a channel whose pages the stack then is; *stack stays where it is.
 *  @kind Collective(comm). @return V2V_OK | V2V_E_INPUT (also: no such channel) | V2V_E_MEMORY;
 *  agreed */
enum v2v_status v2v_stack_open(struct v2v_stack *stack, const char *path,
                               const struct v2v_h5_kind *kind,
                               const struct v2v_input_settings *settings,
                               const struct v2v_comm *comm) V2V_MUST_CHECK;

/** Of a folder's files, whose axes the stack has: which hold views and which frames; its axes
 *  become those of the row. @kind Local. @return V2V_OK | V2V_E_INPUT (neither, or both) */
enum v2v_status v2v_stack_lay_out_folder(struct v2v_stack *stack,
                                         const struct v2v_input_settings *settings) V2V_MUST_CHECK;

/** Pages page .. page+count-1 as float32. @kind Local. @return V2V_OK | V2V_E_INPUT (unreadable, or
 *  the file changed since it was opened) */
enum v2v_status v2v_stack_read(struct v2v_stack *stack, float *out, int64_t page,
                               int64_t count) V2V_MUST_CHECK;

/** A length or time that the user tells goes before the file's; 0: it is not told. @kind Local. */
static inline void v2v_stack_told(double *value, double told)
{
    *value = told > 0.0 ? told : *value;
}

/** @kind Local; accepts a zeroed one. */
void v2v_stack_fini(struct v2v_stack *stack);

#endif
