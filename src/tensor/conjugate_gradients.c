#include "v2v3d/tensor/conjugate_gradients.h"

#include "v2v3d/tensor/statistics.h"

#include <string.h>

void v2v_conjugate_gradients_solve(const struct v2v_conjugate_gradients *self, double *x,
                                   double *rest)
{
    const int64_t count = self->count;
    double squares = v2v_dot(rest, rest, count);
    const double enough = self->enough * squares;
    memset(x, 0, (size_t)count * sizeof *x);
    memcpy(self->way, rest, (size_t)count * sizeof *rest);
    for (int k = 0; k < self->steps && squares > enough; k++) {
        self->multiply(self->of, self->product, self->way);
        const double curvature = v2v_dot(self->way, self->product, count);
        if (!(curvature > 0.0)) {
            break;
        }
        const double before = squares, step = before / curvature;
        for (int64_t i = 0; i < count; i++) {
            x[i] += step * self->way[i];
            rest[i] -= step * self->product[i];
        }
        squares = v2v_dot(rest, rest, count);
        for (int64_t i = 0; i < count; i++) {
            self->way[i] = rest[i] + squares / before * self->way[i];
        }
    }
}
