/** A view against its prediction: by what shift, slope with depth, gain and smooth fields the two
 *  differ, in linear least squares. REFERENCE.md 13. */
#ifndef V2V_METHOD_REGISTRATION_H
#define V2V_METHOD_REGISTRATION_H

#include "v2v3d/base/field.h"
#include "v2v3d/conf/calibration.h"
#include "v2v3d/par/slicing.h"

/** What is fitted: gain and shift always. Fields are to the third degree, fine ones to the last. */
enum {
    V2V_REGISTER_SHIFT = 1,
    V2V_REGISTER_SLOPE = 2,
    V2V_REGISTER_FIELDS = 4,
    V2V_REGISTER_FINE_FIELDS = 8
};

/** Unknowns of a view, as they stand in its equations: gain and its field, displacement along y and
 *  its field, along x and its field; slope along y, x. */
enum {
    V2V_REGISTER_FIELD = 1 + V2V_FIELD_TERMS,
    V2V_REGISTER_GAIN = 0,
    V2V_REGISTER_Y = V2V_REGISTER_FIELD,
    V2V_REGISTER_X = 2 * V2V_REGISTER_FIELD,
    V2V_REGISTER_SLOPES = 3 * V2V_REGISTER_FIELD,
    V2V_REGISTER_UNKNOWNS = V2V_REGISTER_SLOPES + 2
};

enum { V2V_REGISTER_NUMBERS = sizeof(struct v2v_view_calibration) / sizeof(double) };
_Static_assert(sizeof(struct v2v_view_calibration) ==
                   (1 + 2 + 2 + 3 * V2V_FIELD_TERMS) * sizeof(double),
               "a view's calibration is taken for numbers: gain, shift, slope and three fields");

/** Of a view, for these terms. @kind Local. */
int v2v_registration_unknowns(unsigned terms);

/** Squares of what is missed, of the squares of what is there, over pixels that are seen. */
struct v2v_missed {
    double squares, of, seen;
};

/** What a pixel is compared by: its prediction, by what that changes where the view is displaced by
 *  a pixel, or by a pixel times depth, and what it misses. */
enum {
    V2V_REGISTER_BY_GAIN,
    V2V_REGISTER_BY_Y,
    V2V_REGISTER_BY_X,
    V2V_REGISTER_BY_SLOPE_Y,
    V2V_REGISTER_BY_SLOPE_X,
    V2V_REGISTER_MISSED,
    V2V_REGISTER_IMAGES
};
enum {
    V2V_REGISTER_PAIRS = V2V_REGISTER_IMAGES * (V2V_REGISTER_IMAGES + 1) / 2,
    V2V_REGISTER_ORDERS = 2 * V2V_FIELD_DEGREE + 1
};

/** Sums over the pixels: the products of two of these, times P_j(y) P_i(x), Legendre's
 *  polynomials: the elements of the normal equations are sums of these, as P_i P_k is of P_0 ..
 *  P_{i+k}. */
struct v2v_registration {
    double moments[V2V_REGISTER_PAIRS][V2V_REGISTER_ORDERS][V2V_REGISTER_ORDERS];
    struct v2v_missed in_frame, in_square;
};

/** Room for smoothed images. */
struct v2v_registration_images {
    int64_t height, width;
    float *missed, *prediction, *deep, *scratch; /* [y,x] */
    uint8_t *unseen; /* [y,x]: 1 where a pixel, or one that it is a mean of, is blind */
    double *of_row;  /* [y,pairs,orders] */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_registration_images_init(struct v2v_registration_images *images, int64_t height,
                                             int64_t width) V2V_MUST_CHECK;
void v2v_registration_images_fini(struct v2v_registration_images *images);

/** Pixels of a side that are judged: what light from beyond the frame hardly reaches.
 *  @kind Local. */
struct v2v_part v2v_registration_judged(int64_t side);

/** Of pixels that aren't blind. @kind Local, the same bits with any number of threads. */
struct v2v_missed v2v_registration_missed(const float *recorded, const float *prediction,
                                          int64_t width, struct v2v_part rows,
                                          struct v2v_part columns);

/** The equations of a view, of `terms` alone, and what its prediction misses over the frame.
 *  @kind   Local, no allocation, the same bits with any number of threads
 *  @param  deep the prediction of the volume weighted by depth
 *  @param  smoothing pixels: differences are taken of images smoothed by squares of this radius,
 *          across as many, and reach as far */
void v2v_registration_compare(struct v2v_registration *registration,
                              struct v2v_registration_images *images, const float *recorded,
                              const float *prediction, const float *deep, unsigned terms,
                              int smoothing, struct v2v_part rows, struct v2v_part columns);

/** Solve every view's equations for `terms`, and go there, at most as far as `smoothing` shows.
 *  @kind Local. @param registration [views] @return the farthest way of a view, pixels */
double v2v_registration_step(struct v2v_calibration *calibration,
                             const struct v2v_registration *registration, unsigned terms,
                             int smoothing);

/** All numbers of all views [views][V2V_REGISTER_NUMBERS], to mix steps of: gains as logarithms,
 *  and back within the bounds of gains, so that no mixture has one that is not positive.
 *  @kind Local. */
void v2v_registration_to_numbers(double *numbers, const struct v2v_calibration *calibration);
void v2v_registration_from_numbers(struct v2v_calibration *calibration, const double *numbers);

/** Take out what views cannot tell: gain, shift, slope and fields that all views share, and
 *  displacements in proportion to `parallax`, which move and bend the volume in depth.
 *  @kind Local. @param parallax [views][y,x], pixels a slice */
void v2v_registration_fix_modes(struct v2v_calibration *calibration, double (*parallax)[2]);

#endif
