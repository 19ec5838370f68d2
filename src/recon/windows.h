/** Parts of a frame around the tiles that changed, each to be reconstructed by itself. */
#ifndef RECON_WINDOWS_H
#define RECON_WINDOWS_H

#include "v2v3d/par/grid.h"
#include <stdint.h>

enum { V2V_WINDOWS_MOST = 16 };

/** Rows and columns of the torus, the frame at its origin: those before 0 are the torus' last. */
struct v2v_core_window {
    struct v2v_part rows, columns;           /**< what it reconstructs .. */
    struct v2v_part core_rows, core_columns; /**< .. and what of it, in the frame, it gives */
};

/** The frame, its tiles, and what a window takes around its core. */
struct v2v_windows_plan {
    int64_t height, width;             /**< of the frame, pixels */
    int64_t torus_height, torus_width; /**< of what a reconstruction of it computes */
    int64_t tile;                      /**< pixels of a tile's side */
    int64_t halo;                      /**< pixels around changed tiles that the core takes in .. */
    int64_t margin;                    /**< .. and those around the core that the window does, */
    int64_t least;                     /**< whose sides are this long at least */
};

/** Windows that together give all the tiles marked: the box about them, cut in two, and again, as
 *  long as the windows' pixels get fewer. Sides begin at even places and are of good sizes for
 *  transforms, or the whole torus'.
 *  @kind  Local, no allocation @param windows [V2V_WINDOWS_MOST] out
 *  @param changed [tile rows, tile columns] bool @return how many */
int64_t v2v_windows_cover(struct v2v_core_window *windows, const uint8_t *changed,
                          const struct v2v_windows_plan *plan);

/** Those of a window's rows (columns) that are in a frame of so many, counted from the window's
 *  first. @kind Local. */
struct v2v_part v2v_windows_in_frame(const struct v2v_part *part, int64_t whole);

/** What of [count,torus] planes is in a window. @kind Local. @param out [count,rows,columns] */
void v2v_windows_cut(float *out, const float *planes, int64_t count,
                     const struct v2v_core_window *window, const struct v2v_windows_plan *plan);

/** Pixels that windows compute, of those that the whole frame does. @kind Local. */
double v2v_windows_part(const struct v2v_core_window *windows, int64_t count,
                        const struct v2v_windows_plan *plan);

#endif
