#include "method/anderson.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Steps before that count. */
enum { DEPTH = 3 };

/* Of a difference's squares, what must be left of it beside the later ones. */
static const double least_new = 1e-6;

struct v2v_anderson {
    int64_t count;
    int known;         /* steps before, up to DEPTH + 1 */
    double *x, *f;     /* [DEPTH+1][count]: places and steps g(x) - x, newest first */
    double *df[DEPTH]; /* [count]: orthogonal differences of steps */
    double *dx[DEPTH]; /* [count]: of places plus steps, with the same factors */
    double *memory;    /* of df, dx */
};

enum v2v_status v2v_anderson_create(struct v2v_anderson **anderson, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_anderson *self = NULL;
    *anderson = NULL;
    V2V_TRY(V2V_ALLOC(self, "anderson", 1));
    *self = (struct v2v_anderson){.count = count};
    V2V_TRY(V2V_ALLOC(self->x, "anderson", v2v_mem_product(DEPTH + 1, count, 1)));
    V2V_TRY(V2V_ALLOC(self->f, "anderson", v2v_mem_product(DEPTH + 1, count, 1)));
    V2V_TRY(V2V_ALLOC(self->memory, "anderson", v2v_mem_product(2 * DEPTH, count, 1)));
    for (int k = 0; k < DEPTH; k++) {
        self->df[k] = self->memory + k * count;
        self->dx[k] = self->memory + (DEPTH + k) * count;
    }
    *anderson = self;
    self = NULL;
done:
    v2v_anderson_destroy(&self);
    return rc;
}

void v2v_anderson_destroy(struct v2v_anderson **anderson)
{
    if (*anderson != NULL) {
        v2v_mem_free((*anderson)->memory);
        v2v_mem_free((*anderson)->f);
        v2v_mem_free((*anderson)->x);
        v2v_mem_free(*anderson);
        *anderson = NULL;
    }
}

void v2v_anderson_restart(struct v2v_anderson *anderson)
{
    anderson->known = 0;
}

static void subtract(double *a, double factor, const double *b, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        a[i] -= factor * b[i];
    }
}

/* The newest place and step come first. */
static void remember(struct v2v_anderson *self, const double *x, const double *g)
{
    const int64_t count = self->count;
    memmove(self->x + count, self->x, (size_t)(DEPTH * count) * sizeof *x);
    memmove(self->f + count, self->f, (size_t)(DEPTH * count) * sizeof *x);
    memcpy(self->x, x, (size_t)count * sizeof *x);
    for (int64_t i = 0; i < count; i++) {
        self->f[i] = g[i] - x[i];
    }
    self->known += self->known <= DEPTH;
}

void v2v_anderson_step(struct v2v_anderson *self, double *x, const double *g)
{
    const int64_t count = self->count;
    double *step = self->f + DEPTH * count; /* the oldest, which is not needed any more */
    int used = 0;
    remember(self, x, g);
    memcpy(x, g, (size_t)count * sizeof *x);
    if (self->known < 2) {
        return;
    }
    const int differences = self->known - 1;
    for (int k = 0; k < differences; k++) { /* each made orthogonal to the newer ones */
        double *df = self->df[used], *dx = self->dx[used];
        const double *f = self->f + k * count, *at = self->x + k * count;
        for (int64_t i = 0; i < count; i++) {
            df[i] = f[i] - f[i + count];
            dx[i] = at[i] - at[i + count] + df[i];
        }
        const double whole = v2v_dot(df, df, count);
        for (int j = 0; j < used; j++) {
            const double part = v2v_dot(df, self->df[j], count);
            subtract(df, part, self->df[j], count);
            subtract(dx, part, self->dx[j], count);
        }
        const double left = v2v_dot(df, df, count);
        if (left > least_new * whole) {
            for (int64_t i = 0; i < count; i++) {
                df[i] /= sqrt(left);
                dx[i] /= sqrt(left);
            }
            used++;
        }
    }
    memcpy(step, self->f, (size_t)count * sizeof *step);
    for (int k = 0; k < used; k++) {
        const double part = v2v_dot(step, self->df[k], count);
        subtract(x, part, self->dx[k], count);
    }
}
