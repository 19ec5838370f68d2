#ifndef V2V3D_BASE_FIELD_H
#define V2V3D_BASE_FIELD_H

#include "v2v3d/base/bounds.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Smooth fields over an image: sums of products P_i(x) P_j(y) of Legendre polynomials, i + j = 1
 *  to 10, by their degree i + j and then by j; x and y go from -1 at one edge of the image to 1 at
 *  the other. What is constant belongs elsewhere. */
#define V2V_FIELD_TERMS_TO(degree) (((degree) + 1) * ((degree) + 2) / 2 - 1)
enum {
    V2V_FIELD_DEGREE = 10,
    V2V_FIELD_COARSE_DEGREE = 3,
    V2V_FIELD_ORDERS = V2V_FIELD_DEGREE + 1,
    V2V_FIELD_TERMS = V2V_FIELD_TERMS_TO(V2V_FIELD_DEGREE),
    V2V_FIELD_COARSE_TERMS = V2V_FIELD_TERMS_TO(V2V_FIELD_COARSE_DEGREE)
};

/** Pixels from the edge in which a field goes on as it is where they begin: fields are fitted to
 *  what lies inside, and polynomials, continued, would leave all bounds. */
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

/** Where a place on a side, in pixels, takes its field from, -1 .. 1. @kind Local. */
static inline double v2v_field_place(double at, int64_t side)
{
    const double margin = (double)v2v_field_margin(side), last = (double)(side - 1);
    const double inside = at < margin ? margin : at > last - margin ? last - margin : at;
    return side > 1 ? 2.0 * inside / last - 1.0 : 0.0;
}

/** P_0 .. P_{count-1} at x. @kind Local. */
static inline void v2v_legendre(double *polynomial, int count, double x)
{
    double before = 0.0, now = 1.0;
    for (int n = 0; n < count; n++) {
        const double next = x * now + (x * now - before) * ((double)n / (double)(n + 1));
        polynomial[n] = now;
        before = now;
        now = next;
    }
}

/** A field along a row: what polynomials of x count there. @kind Local. @param of_y those of y */
static inline void v2v_field_row(double row[V2V_FIELD_ORDERS], const double field[V2V_FIELD_TERMS],
                                 const double of_y[V2V_FIELD_ORDERS])
{
    const double *term = field;
    for (int i = 0; i < V2V_FIELD_ORDERS; i++) {
        row[i] = 0.0;
    }
    for (int degree = 1; degree < V2V_FIELD_ORDERS; degree++) {
        for (int j = 0; j <= degree; j++) {
            row[degree - j] += *term++ * of_y[j];
        }
    }
}

/** The field's value in the row. @kind Local. @param of_x polynomials there */
static inline double v2v_field_value(const double row[V2V_FIELD_ORDERS],
                                     const double of_x[V2V_FIELD_ORDERS])
{
    double sum = 0.0;
    for (int i = 0; i < V2V_FIELD_ORDERS; i++) {
        sum += row[i] * of_x[i];
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
