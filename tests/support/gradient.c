#include "gradient.h"

#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { STEPS = 5, TEXT = 512 };

static char fault[TEXT];

struct run {
    const struct test_function *f;
    int64_t total;                               /* elements of all arguments */
    float *x;                                    /* as given */
    double *direction, *gradient;                /* [total] */
    double *here, *ahead[STEPS], *behind[STEPS]; /* F(x), F(x +- h d) */
    double *cotangent;
};

/* One direction: <c, F(x +- h d) - F(x)> beside <g, +-h d> for every h. */
struct look {
    const char *name;
    int64_t element; /* -1: all */
    int must_see;    /* bool */
    double up[STEPS], down[STEPS], slope_up[STEPS], slope_down[STEPS];
    double noise[STEPS]; /* that round-off leaves in such a difference of the two */
};

static double dot(const double *a, const double *b, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

static double distance(const double *a, const double *b, int64_t count)
{
    double sum = 0.0;
    for (int64_t i = 0; i < count; i++) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return sqrt(sum);
}

static double step_of(const struct run *run, int k)
{
    return ldexp(run->f->step, -k);
}

/* Set the arguments to x + h d as float32 has it. Returns <g, the step that this is>. */
static double move(const struct run *run, double h)
{
    double slope = 0.0;
    int64_t at = 0;
    for (int64_t a = 0; a < run->f->arguments; a++) {
        const struct test_argument *argument = &run->f->argument[a];
        for (int64_t i = 0; i < argument->count; i++, at++) {
            const double x = (double)run->x[at];
            argument->x[i] = (float)(x + h * run->direction[at]);
            slope += run->gradient[at] * ((double)argument->x[i] - x);
        }
    }
    return slope;
}

static void evaluate(const struct run *run, double *out, double h)
{
    (void)move(run, h);
    run->f->forward(run->f->self, out);
}

/* gradient = J(x)^T cotangent */
static void pull_back(const struct run *run)
{
    int64_t at = 0;
    (void)move(run, 0.0);
    run->f->backward(run->f->self, run->cotangent);
    for (int64_t a = 0; a < run->f->arguments; a++) {
        for (int64_t i = 0; i < run->f->argument[a].count; i++) {
            run->gradient[at++] = (double)run->f->argument[a].gradient[i];
        }
    }
}

static void measure(const struct run *run, struct look *look)
{
    const struct test_function *f = run->f;
    const int64_t n = f->outs;
    const double *c = run->cotangent, at_x = dot(c, run->here, n), size = sqrt(dot(c, c, n));
    const double forward = 2.0 * f->rounding * sqrt(dot(run->here, run->here, n));
    for (int k = 0; k < STEPS; k++) {
        look->up[k] = dot(c, run->ahead[k], n) - at_x;
        look->down[k] = dot(c, run->behind[k], n) - at_x;
        look->slope_up[k] = move(run, step_of(run, k));
        look->slope_down[k] = move(run, -step_of(run, k));
        double change = distance(run->ahead[k], run->behind[k], n) / 2.0;
        look->noise[k] = size * (forward + f->backward_rounding * change);
    }
}

static const char *say(const struct run *run, const struct look *look, const char *what, int k,
                       double is, double allowed)
{
    snprintf(fault, sizeof fault, "%s, %s[%lld], h = %g: %s %.4g, allowed %.4g", run->f->name,
             look->name, (long long)look->element, step_of(run, k), what, is, allowed);
    return fault;
}

/* Halving h divides what F has beside its slope by 4, with some of third order; by 2 where the
 * slope is wrong, that is by 16 instead of 256 in all. */
static const char *judge_remainder(const struct run *run, const struct look *look)
{
    double most = INFINITY;
    for (int k = 0; k < STEPS; k++) {
        const double remainder = fabs(look->up[k] - look->slope_up[k]);
        const double bound = 2.0 * most + look->noise[k];
        if (remainder > bound) {
            return say(run, look, "remainder of the slope", k, remainder, bound);
        }
        most = (k == 0 ? remainder : fmax(most, remainder)) / 4.0;
    }
    return NULL;
}

/* The second difference, in units of slope. */
static double bend_of(const struct run *run, const struct look *look, int k)
{
    return fabs(look->up[k] + look->down[k] - look->slope_up[k] - look->slope_down[k]) /
           (2.0 * step_of(run, k));
}

/* What kinks leave in a central difference. Those of a convex F no more than the bend. Where both
 * signs add up, the bend is one sample of what is as large: those at h and 2 h count, twice each.
 */
static double kinks_of(const struct run *run, const struct look *look, int k)
{
    const double bend = bend_of(run, look, k);
    return run->f->kinks == TEST_SMOOTH   ? 0.0
           : run->f->kinks == TEST_CONVEX ? bend
                                          : 2.0 * (bend + bend_of(run, look, k - 1));
}

/* Central difference - slope. */
static double error_of(const struct run *run, const struct look *look, int k)
{
    return (look->up[k] - look->down[k] - look->slope_up[k] + look->slope_down[k]) /
           (2.0 * step_of(run, k));
}

/* Differences err by what they change from 2 h to h, kinks, round-off. A sample of kinks may happen
 * to be small: of those, one h may be off and two have to see. */
static const char *judge_difference(const struct run *run, const struct look *look)
{
    const int both_signs = run->f->kinks == TEST_KINKS;
    double most = 0.0, allowed = INFINITY, least = INFINITY, second = INFINITY, slope = 0.0;
    int misses = 0, at = 0;
    for (int k = 1; k < STEPS; k++) {
        const double h = step_of(run, k), error = error_of(run, look, k);
        const double bound =
            fabs(error - error_of(run, look, k - 1)) + kinks_of(run, look, k) + look->noise[k] / h;
        if (!(fabs(error) <= bound)) {
            misses++;
            at = k;
            most = fabs(error);
            allowed = bound;
        }
        second = fmin(second, fmax(least, bound));
        least = fmin(least, bound);
        slope = fmax(slope, fabs(look->up[k] - look->down[k]) / (2.0 * h));
    }
    if (misses > both_signs) {
        return say(run, look, "slope off by", at, most, allowed);
    }
    const double unseen = both_signs ? second : least;
    if (look->must_see && !(unseen <= run->f->sees * slope)) {
        return say(run, look, "error that would not be seen", 0, unseen, run->f->sees * slope);
    }
    return NULL;
}

/* Lengthen the direction so that a step of h changes F by about this part of h of its norm. */
static void calibrate(struct run *run, double part)
{
    const double norm = sqrt(dot(run->here, run->here, run->f->outs));
    evaluate(run, run->ahead[0], run->f->step);
    const double change = distance(run->ahead[0], run->here, run->f->outs);
    for (int64_t i = 0; i < run->total; i++) {
        run->direction[i] *= fmin(part * run->f->step * norm / change, 64.0);
    }
}

static const char *judge(struct run *run, const char *name, int64_t element, int must_see)
{
    const int64_t n = run->f->outs;
    struct look look = {.name = name, .element = element};
    const char *wrong = NULL;
    calibrate(run, element < 0 ? 1.0 : 0.125);
    for (int k = 0; k < STEPS; k++) {
        evaluate(run, run->ahead[k], step_of(run, k));
        evaluate(run, run->behind[k], -step_of(run, k));
    }
    for (int aligned = run->f->kinks != TEST_SMOOTH; aligned < 2 && wrong == NULL; aligned++) {
        for (int64_t i = 0; i < n; i++) {
            run->cotangent[i] = aligned ? run->ahead[2][i] - run->behind[2][i]
                                        : v2v_random_normal(1, 0, (uint64_t)i);
        }
        look.must_see = must_see && aligned;
        pull_back(run);
        measure(run, &look);
        wrong = run->f->kinks ? NULL : judge_remainder(run, &look);
        wrong = wrong != NULL ? wrong : judge_difference(run, &look);
    }
    return wrong;
}

/* d = random numbers as large as the argument's; of a sum, with the signs of its gradient, so that
 * nothing cancels. */
static void draw(const struct run *run, int64_t first, int64_t count)
{
    double square = 0.0;
    for (int64_t i = first; i < first + count; i++) {
        square += (double)run->x[i] * (double)run->x[i];
    }
    for (int64_t i = first; i < first + count; i++) {
        const double d =
            sqrt(square / (double)count) * v2v_random_normal(2, (uint64_t)first, (uint64_t)i);
        const int follows = run->f->outs == 1 && run->gradient[i] != 0.0;
        run->direction[i] = follows ? copysign(d, run->gradient[i]) : d;
    }
}

/* The element of the largest gradient, and then any. */
static int64_t choose(const double *gradient, int64_t count, int64_t which)
{
    int64_t at = v2v_random_below(3, (uint64_t)which, (uint64_t)count, count);
    for (int64_t i = 0; i < count && which == 0; i++) {
        at = fabs(gradient[i]) > fabs(gradient[at]) ? i : at;
    }
    return at;
}

static const char *judge_argument(struct run *run, const struct test_argument *argument,
                                  int64_t first)
{
    const size_t bytes = (size_t)run->total * sizeof *run->direction;
    memset(run->direction, 0, bytes);
    draw(run, first, argument->count);
    const char *wrong = judge(run, argument->name, -1, 1);
    for (int64_t e = 0; e < run->f->elements && e < argument->count && wrong == NULL; e++) {
        const int every = run->f->elements >= argument->count;
        const int64_t i = every ? e : choose(run->gradient + first, argument->count, e);
        memset(run->direction, 0, bytes);
        draw(run, first, argument->count);
        const double length = run->direction[first + i];
        memset(run->direction, 0, bytes);
        run->direction[first + i] = length;
        wrong = judge(run, argument->name, i, every || e == 0);
    }
    return wrong;
}

static const char *judge_all(struct run *run)
{
    int64_t first = 0;
    for (int64_t a = 0; a < run->f->arguments; first += run->f->argument[a++].count) {
        draw(run, first, run->f->argument[a].count);
    }
    const char *wrong = judge(run, "all", -1, 1);
    first = 0;
    for (int64_t a = 0; a < run->f->arguments && wrong == NULL; a++) {
        wrong = judge_argument(run, &run->f->argument[a], first);
        first += run->f->argument[a].count;
    }
    return wrong;
}

static void begin(struct run *run, const struct test_function *f)
{
    float *x;
    double *results;
    *run = (struct run){.f = f};
    for (int64_t a = 0; a < f->arguments; a++) {
        run->total += f->argument[a].count;
    }
    assert_ok(V2V_ALLOC(run->x, "test", run->total));
    assert_ok(V2V_ALLOC(run->direction, "test", 2 * run->total));
    assert_ok(V2V_ALLOC(results, "test", (2 * STEPS + 2) * f->outs));
    run->gradient = run->direction + run->total;
    run->here = results;
    run->cotangent = results + f->outs;
    for (int k = 0; k < STEPS; k++) {
        run->ahead[k] = results + (2 + 2 * k) * f->outs;
        run->behind[k] = run->ahead[k] + f->outs;
    }
    x = run->x;
    for (int64_t a = 0; a < f->arguments; a++) {
        memcpy(x, f->argument[a].x, (size_t)f->argument[a].count * sizeof *x);
        x += f->argument[a].count;
    }
    evaluate(run, run->here, 0.0);
    for (int64_t i = 0; i < f->outs; i++) {
        run->cotangent[i] = run->here[i];
    }
    pull_back(run);
}

const char *test_gradient_fault(const struct test_function *function)
{
    struct run run;
    begin(&run, function);
    const char *wrong = judge_all(&run);
    memset(run.direction, 0, (size_t)run.total * sizeof *run.direction);
    (void)move(&run, 0.0);
    v2v_mem_free(run.here);
    v2v_mem_free(run.direction);
    v2v_mem_free(run.x);
    return wrong;
}

void test_gradient(const struct test_function *function)
{
    const char *wrong = test_gradient_fault(function);
    if (wrong != NULL) {
        fail_msg("%s", wrong);
    }
}
