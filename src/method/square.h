#ifndef V2V_METHOD_SQUARE_H
#define V2V_METHOD_SQUARE_H

#include "v2v3d/method/estimator.h"

/** Part of an image. */
struct v2v_square {
    struct v2v_part rows, columns;
};

/** The square of `side` pixels (fewer where there are fewer) within rows and columns of an image
 *  that varies most, of places 16 pixels apart; the first of equals. @kind Local.
 *  @param image [y,width] */
struct v2v_square v2v_square_find(const float *image, int64_t width, struct v2v_part rows,
                                  struct v2v_part columns, int64_t side);

/** Likewise, anywhere in the image. @kind Local. @param image [height,width] */
struct v2v_square v2v_square_of_image(const float *image, int64_t height, int64_t width,
                                      int64_t side);

/** Images [count,height,width] cut to a square of theirs. @kind Local.
 *  @param to [count,square] out */
void v2v_square_cut(const struct v2v_square *square, float *to, const float *images, int64_t count,
                    int64_t height, int64_t width);

/** The averaging of a frame's views cut likewise, where there is one.
 *  @kind Local. @param part out, with the frames [v,square] @param frames out: those, to be freed;
 *  NULL: there is none @param averaging of the problem's whole frame; may be NULL
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_square_cut_averaging(const struct v2v_square *square,
                                         struct v2v_averaging *part, float **frames,
                                         const struct v2v_averaging *averaging,
                                         const struct v2v_problem *problem) V2V_MUST_CHECK;

#endif
