#ifndef V2V3D_BASE_FIELD_H
#define V2V3D_BASE_FIELD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Smooth fields over an image: sums of the products of x and y to the third degree, each from -1
 *  at one edge of the image to 1 at the other. What is constant belongs elsewhere. */
enum { V2V_FIELD_TERMS = 9 };

/** Where pixel i of a side is, -1 .. 1. @kind Local. */
static inline double v2v_field_place(int64_t i, int64_t side)
{
    return side > 1 ? 2.0 * (double)i / (double)(side - 1) - 1.0 : 0.0;
}

/** The terms at a place: x, y, x x, x y, y y, x x x, x x y, x y y, y y y. @kind Local. */
static inline void v2v_field_terms(double terms[V2V_FIELD_TERMS], double y, double x)
{
    terms[0] = x;
    terms[1] = y;
    terms[2] = x * x;
    terms[3] = x * y;
    terms[4] = y * y;
    terms[5] = x * x * x;
    terms[6] = x * x * y;
    terms[7] = x * y * y;
    terms[8] = y * y * y;
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
