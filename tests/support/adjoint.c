#include "adjoint.h"

#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { DENSE = 2, PROBES = 6, TEXT = 512 };

/* A test that would not notice an error of this part of the product, and what either side may be
 * rounded by, tests nothing. */
#define SEES 0.01

static char fault[TEXT];

struct vectors {
    float *x, *y, *ax, *aty;
};

/* Of a, which was computed, with b, which was given. */
enum { PRODUCT, MODULI, SQUARES, A_SQUARE, B_SQUARE, B_MODULI, SUMS };
struct product {
    double sum[SUMS], a_most;
};

static struct product multiply(const float *a, const float *b, int64_t count,
                               const struct v2v_comm *comm)
{
    struct product p = {0};
    for (int64_t i = 0; i < count; i++) {
        const double ai = (double)a[i], bi = (double)b[i];
        p.sum[PRODUCT] += ai * bi;
        p.sum[MODULI] += fabs(ai * bi);
        p.sum[SQUARES] += ai * bi * ai * bi;
        p.sum[A_SQUARE] += ai * ai;
        p.sum[B_SQUARE] += bi * bi;
        p.sum[B_MODULI] += fabs(bi);
        p.a_most = fmax(p.a_most, fabs(ai));
    }
    if (comm != NULL) {
        v2v_par_sum_f64(comm, p.sum, SUMS);
        v2v_par_max_f64(comm, &p.a_most, 1);
    }
    return p;
}

/* Errors of a are a part of its norm, be it the Euclidean one or the maximum (Hoelder); and of each
 * number by itself, of which six standard deviations add up. */
static double bound_of(const struct test_linear *l, const struct product *p)
{
    const double *sum = p->sum;
    return l->rounding * fmin(sqrt(sum[A_SQUARE] * sum[B_SQUARE]), p->a_most * sum[B_MODULI]) +
           l->image_unit * fmin(sum[MODULI], 6.0 * sqrt(sum[SQUARES]));
}

/* `aligned`: y lies along A x or x along A^T y, so that no sum cancels. */
static const char *judge(const struct test_linear *l, const struct vectors *v, const char *what,
                         int aligned)
{
    l->forward(l->self, v->ax, v->x);
    l->adjoint(l->self, v->aty, v->y);
    const struct product there = multiply(v->ax, v->y, l->outs, l->comm);
    const struct product back = multiply(v->aty, v->x, l->ins, l->comm);
    const double left = there.sum[PRODUCT], right = back.sum[PRODUCT];
    const double bound = bound_of(l, &there) + bound_of(l, &back);
    if (!(fabs(left - right) <= bound)) {
        snprintf(fault, sizeof fault, "%s, %s: <A x, y> = %.9g, <x, A'y> = %.9g, allowed %.3g",
                 l->name, what, left, right, bound);
        return fault;
    }
    if (aligned && !(bound <= (SEES + 2.0 * l->image_unit) * fabs(left))) {
        snprintf(fault, sizeof fault, "%s, %s: %.3g allowed of %.9g would hide an error", l->name,
                 what, bound, left);
        return fault;
    }
    return NULL;
}

static uint64_t stream(const struct test_linear *l, int which)
{
    int rank = l->comm != NULL ? v2v_comm_rank(l->comm) : 0;
    return (uint64_t)(16 * rank + which);
}

static void draw(const struct test_linear *l, float *x, int64_t count, int which)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(v2v_random_below(4, stream(l, which), (uint64_t)i, 255) - 127) / 128.0f;
    }
}

/* to = from in 8 bits, of each element once, twice or half */
static void along(const struct test_linear *l, float *to, const float *from, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        int exponent;
        float bits = rintf(ldexpf(frexpf(from[i], &exponent), 8));
        int octave = (int)v2v_random_below(4, stream(l, 8), (uint64_t)i, 3) - 1;
        to[i] = ldexpf(bits, exponent - 8 + octave);
    }
}

/* One 1, on the ranks in turn. */
static void probe(const struct test_linear *l, float *x, int64_t count, int which)
{
    memset(x, 0, (size_t)count * sizeof *x);
    int ranks = l->comm != NULL ? v2v_comm_size(l->comm) : 1;
    int rank = l->comm != NULL ? v2v_comm_rank(l->comm) : 0;
    if (count > 0 && which % ranks == rank) {
        x[v2v_random_below(4, stream(l, 9), (uint64_t)which, count)] = 1.0f;
    }
}

static const char *judge_all(const struct test_linear *l, const struct vectors *v)
{
    const char *wrong = NULL;
    for (int i = 0; i < DENSE && wrong == NULL; i++) {
        draw(l, v->x, l->ins, i);
        draw(l, v->y, l->outs, 2 + i);
        wrong = judge(l, v, "drawn", 0);
        along(l, v->y, v->ax, l->outs);
        wrong = wrong != NULL ? wrong : judge(l, v, "y along A x", 1);
    }
    for (int i = 0; i < PROBES && wrong == NULL; i++) {
        probe(l, v->x, l->ins, i);
        l->forward(l->self, v->ax, v->x);
        along(l, v->y, v->ax, l->outs);
        wrong = judge(l, v, "a column of A", 1);
    }
    for (int i = 0; i < PROBES && wrong == NULL; i++) {
        probe(l, v->y, l->outs, i);
        l->adjoint(l->self, v->aty, v->y);
        along(l, v->x, v->aty, l->ins);
        wrong = judge(l, v, "a row of A", 1);
    }
    return wrong;
}

const char *test_adjoint_fault(const struct test_linear *l)
{
    struct vectors v;
    float *memory;
    assert_ok(V2V_ALLOC(memory, "test", 2 * (l->ins + l->outs) + 1));
    v.x = memory;
    v.aty = v.x + l->ins;
    v.y = v.aty + l->ins;
    v.ax = v.y + l->outs;
    const char *wrong = judge_all(l, &v);
    v2v_mem_free(memory);
    return wrong;
}

void test_adjoint(const struct test_linear *linear)
{
    const char *wrong = test_adjoint_fault(linear);
    if (wrong != NULL) {
        fail_msg("%s", wrong);
    }
}
