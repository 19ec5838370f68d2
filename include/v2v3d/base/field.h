#ifndef V2V3D_BASE_FIELD_H
#define V2V3D_BASE_FIELD_H

#include "v2v3d/base/bounds.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Smooth fields over an image: sums of the products of x and y to the fifth degree, each from -1
 *  at one edge of the image to 1 at the other; those to the third come first. What is constant
 *  belongs elsewhere. */
#define V2V_FIELD_TERMS_TO(degree) (((degree) + 1) * ((degree) + 2) / 2 - 1)
enum {
    V2V_FIELD_DEGREE = 5,
    V2V_FIELD_TERMS = V2V_FIELD_TERMS_TO(V2V_FIELD_DEGREE),
    V2V_FIELD_COARSE_TERMS = V2V_FIELD_TERMS_TO(3)
};

/** Pixels from the edge in which a field goes on as it is where they begin: fields are fitted to
 *  what lies inside, and their powers, continued, would leave all bounds. */
enum { V2V_FIELD_MARGIN = 24 };

/** Of a side: fewer where it is short. @kind Local. */
static inline int64_t v2v_field_margin(int64_t side)
{
    return v2v_smaller(V2V_FIELD_MARGIN, (side - 1) / 4);
}

/** Where item i of a line is, -1 .. 1. @kind Local. */
static inline double v2v_line_place(int64_t i, int64_t count)
{
    return count > 1 ? 2.0 * (double)i / (double)(count - 1) - 1.0 : 0.0;
}

/** Where pixel i of a side takes its field from, -1 .. 1: within the margins. @kind Local. */
static inline double v2v_field_place(int64_t i, int64_t side)
{
    const int64_t margin = v2v_field_margin(side);
    return v2v_line_place(v2v_within(i, margin, side - 1 - margin), side);
}

/** The terms at a place: x, y, x x, x y, y y, x x x, x x y, x y y, y y y and so on. @kind Local. */
static inline void v2v_field_terms(double terms[V2V_FIELD_TERMS], double y, double x)
{
    terms[0] = x;
    terms[1] = y;
    for (int degree = 2, from = 0; degree <= V2V_FIELD_DEGREE; from += degree, degree++) {
        double *const to = terms + from + degree;
        for (int i = 0; i < degree; i++) {
            to[i] = x * terms[from + i];
        }
        to[degree] = y * terms[from + degree - 1];
    }
}

/** A field's value there. @kind Local. */
static inline double v2v_field_value(const double field[V2V_FIELD_TERMS],
                                     const double terms[V2V_FIELD_TERMS])
{
    double sum = 0.0;
    for (int k = 0; k < V2V_FIELD_TERMS; k++) {
        sum += field[k] * terms[k];
    }
    return sum;
}

/** Is it 0 everywhere? @kind Local. */
static inline int v2v_field_is_zero(const double field[V2V_FIELD_TERMS])
{
    for (int k = 0; k < V2V_FIELD_TERMS; k++) {
        if (field[k] != 0.0) {
            return 0;
        }
    }
    return 1;
}

#ifdef __cplusplus
}
#endif

#endif
