#ifndef V2V_METHOD_SQUARE_H
#define V2V_METHOD_SQUARE_H

#include "v2v3d/method/estimator.h"

/** Part of an image. */
struct v2v_square {
    struct v2v_part rows, columns;
};

/** The square of `side` pixels (fewer where there are fewer) within rows and columns of an image
 *  that varies most, of places 16 pixels apart; the first of equals. Blind samples don't count.
 *  @kind Local.
 *  @param image [y,width] */
struct v2v_square v2v_square_find(const float *image, int64_t width, struct v2v_part rows,
                                  struct v2v_part columns, int64_t side);

/** Images [count,height,width] cut to a square of theirs. @kind Local.
 *  @param to [count,square] out */
void v2v_square_cut(const struct v2v_square *square, float *to, const float *images, int64_t count,
                    int64_t height, int64_t width);

/** The views of a frame in the square of it where the first of them varies most that isn't all
 *  blind. */
struct v2v_square_views {
    int64_t height, width;          /**< of the square */
    struct v2v_square judged;       /**< of it: where views that are left out are judged */
    float *views;                   /**< [v,height,width] */
    float *frames;                  /**< likewise, of .. */
    struct v2v_averaging averaging; /**< .. theirs; frames NULL: they are of one frame */
};

/** Judged is what lies V2V_FIELD_MARGIN pixels from the square's edges, where the light beyond them
 *  is not seen; a third of that, where what lies inside holds little of the views' light: the dark
 *  would speak for as smooth a volume as there is.
 *  @kind Local. @param views [v,y,x] of the problem's whole frame @param averaging theirs, or NULL
 *  @param side of the square, pixels @return V2V_OK | V2V_E_MEMORY; _fini after both */
enum v2v_status v2v_square_views_init(struct v2v_square_views *square,
                                      const struct v2v_problem *problem, const float *views,
                                      const struct v2v_averaging *averaging,
                                      int64_t side) V2V_MUST_CHECK;
void v2v_square_views_fini(struct v2v_square_views *square);

/** Of its views; NULL: there is none. @kind Local. */
const struct v2v_averaging *v2v_square_averaging(const struct v2v_square_views *square);

#endif
