/* What varies over some pixels is far above the noise of their mean: what a volume misses of it is
 * no noise. */
#include "v2v3d/eval/structure.h"

#include "eval/fourier.h"
#include "v2v3d/base/field.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/comm.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Pixels of a square's side. */
enum { SIDE = 8, LEAST_SQUARES = 4 };

/* Standard deviations of what is noise alone; and so many times as much of what is plain. */
static const double certain = 8.0, plainly = 10.0;

/* Of the others' structure, in the mean: a view that shows less is dark. */
static const double dark = 0.1;

/* Of a view's brightness, beside the others'; and of what is missed of it, what this explains. */
static const double least_odd = 1.05, most_of_it = 0.75;

/* Of a view's structure, less of which away from the border are tails of what lies there. */
static const double least_inside = 1e-3;

/* Of a sum of squares that rounding made negative; NaN stays. */
static double positive(double x)
{
    return x < 0.0 ? 0.0 : x;
}

/* Samples of an image that are far enough from its border. */
static struct v2v_part inside(int64_t side)
{
    const int64_t border = v2v_field_margin(side);
    return (struct v2v_part){border, side - 2 * border};
}

static double mixed_difference(const float *at, int64_t width)
{
    return ((double)at[0] - (double)at[1]) - ((double)at[width] - (double)at[width + 1]);
}

/* Noise of a square, by the light that the projection has there. */
static void add_light(struct v2v_structure *to, const float *recorded, const float *projected,
                      int64_t width)
{
    const double p = v2v_mean_of_square(projected, width, SIDE);
    double yy = 0.0, yp = 0.0, pp = 0.0;
    for (int64_t i = 0; i < SIDE - 1; i++) {
        for (int64_t j = 0; j < SIDE - 1; j++) {
            const double a = mixed_difference(recorded + i * width + j, width);
            const double b = mixed_difference(projected + i * width + j, width);
            yy += a * a;
            yp += a * b;
            pp += b * b;
        }
    }
    const double weight = p * p / ((SIDE - 1) * (SIDE - 1));
    to->light += p * p;
    to->lyy += weight * yy;
    to->lyp += weight * yp;
    to->lpp += weight * pp;
}

/* Sums of products of means, and less the products of their sums. */
static void add_squares(struct v2v_structure *to, const float *recorded, const float *projected,
                        int64_t width, struct v2v_part rows, struct v2v_part columns)
{
    double y = 0.0, p = 0.0;
    for (int64_t i = 0; i < rows.count / SIDE; i++) {
        for (int64_t j = 0; j < columns.count / SIDE; j++) {
            const int64_t at = (rows.first + i * SIDE) * width + columns.first + j * SIDE;
            const double a = v2v_mean_of_square(recorded + at, width, SIDE);
            const double b = v2v_mean_of_square(projected + at, width, SIDE);
            to->yy += a * a;
            to->yp += a * b;
            to->pp += b * b;
            y += a;
            p += b;
            to->squares += 1.0;
        }
    }
    to->yy = positive(to->yy - y * y / to->squares);
    to->yp -= y * p / to->squares;
    to->pp = positive(to->pp - p * p / to->squares);
}

static void add_differences(struct v2v_structure *to, const float *recorded, const float *projected,
                            int64_t width, struct v2v_part rows, struct v2v_part columns)
{
    for (int64_t i = rows.first; i < rows.first + rows.count - 1; i++) {
        for (int64_t j = columns.first; j < columns.first + columns.count - 1; j++) {
            const double a = mixed_difference(recorded + i * width + j, width);
            const double b = mixed_difference(projected + i * width + j, width);
            to->dyy += a * a;
            to->dyp += a * b;
            to->dpp += b * b;
            to->differences += 1.0;
        }
    }
}

int v2v_structure_can_be_seen(int64_t height, int64_t width)
{
    return height / SIDE * (width / SIDE) >= LEAST_SQUARES;
}

static struct v2v_structure structure_of(const float *recorded, const float *projected,
                                         int64_t width, struct v2v_part rows,
                                         struct v2v_part columns)
{
    struct v2v_structure structure = {0};
    if (v2v_structure_can_be_seen(rows.count, columns.count)) {
        add_squares(&structure, recorded, projected, width, rows, columns);
        add_differences(&structure, recorded, projected, width, rows, columns);
    }
    return structure;
}

/* Is a view's structure more than tails of what lies at the border? */
static int has_structure_inside(const float *view, int64_t height, int64_t width)
{
    struct v2v_structure found = {0}, whole = {0};
    add_squares(&found, view, view, width, inside(height), inside(width));
    add_squares(&whole, view, view, width, (struct v2v_part){0, height},
                (struct v2v_part){0, width});
    return found.yy >= least_inside * whole.yy;
}

struct v2v_structure v2v_structure_of(const float *recorded, const float *projected, int64_t height,
                                      int64_t width)
{
    const struct v2v_part rows = inside(height), columns = inside(width);
    struct v2v_structure found = {0};
    if (has_structure_inside(recorded, height, width)) {
        found = structure_of(recorded, projected, width, rows, columns);
    }
    for (int64_t i = 0; found.squares > 0.0 && i < rows.count / SIDE; i++) {
        for (int64_t j = 0; j < columns.count / SIDE; j++) {
            const int64_t at = (rows.first + i * SIDE) * width + columns.first + j * SIDE;
            add_light(&found, recorded + at, projected + at, width);
        }
    }
    return found;
}

void v2v_structure_add(struct v2v_structure *sum, const struct v2v_structure *structure)
{
    sum->yy += structure->yy;
    sum->yp += structure->yp;
    sum->pp += structure->pp;
    sum->dyy += structure->dyy;
    sum->dyp += structure->dyp;
    sum->dpp += structure->dpp;
    sum->squares += structure->squares;
    sum->differences += structure->differences;
    sum->light += structure->light;
    sum->lyy += structure->lyy;
    sum->lyp += structure->lyp;
    sum->lpp += structure->lpp;
}

static double scale_of(const struct v2v_structure *structure)
{
    return structure->pp == 0.0 ? 0.0 : structure->yp / structure->pp;
}

/* Variance of the noise of a square's mean, of what `scale` times the projection leaves. */
static double variance_of(const struct v2v_structure *structure, double scale)
{
    const double left = structure->dyy - scale * (2.0 * structure->dyp - scale * structure->dpp);
    return positive(left) / (4.0 * structure->differences * SIDE * SIDE);
}

/* The same where it counts for brightness: by the light. */
static double variance_in_light(const struct v2v_structure *structure, double scale)
{
    const double left = structure->lyy - scale * (2.0 * structure->lyp - scale * structure->lpp);
    return positive(left) / (4.0 * structure->light * SIDE * SIDE);
}

/* Squares missed, the noise's and what exceeds it. */
static double squares_missed(const struct v2v_structure *structure, double scale)
{
    return structure->yy - scale * (2.0 * structure->yp - scale * structure->pp);
}

/* What the noise's sum over so many squares may exceed its mean by. */
static double doubt_of(double squares, double variance)
{
    return certain * sqrt(2.0 * squares) * variance;
}

double v2v_structure_missed(const struct v2v_structure *structure)
{
    const double scale = scale_of(structure), squares = structure->squares;
    if (!(squares > 0.0) || !isfinite(scale)) {
        return NAN;
    }
    const double variance = variance_of(structure, scale);
    const double doubt = doubt_of(squares, variance);
    const double missed = squares_missed(structure, scale) - squares * variance;
    const double all = structure->yy - squares * variance;
    if (!(all > doubt)) {
        return NAN;
    }
    return missed > doubt ? sqrt(missed / all) : 0.0;
}

/* What there is beyond noise, of what noise may be. */
static double seen(const struct v2v_structure *structure)
{
    const double variance = variance_of(structure, 0.0);
    const double doubt = doubt_of(structure->squares, variance);
    return doubt > 0.0 ? (structure->yy - structure->squares * variance) / doubt
                       : (structure->yy > 0.0 ? INFINITY : 0.0);
}

int v2v_structure_is_seen(const float *views, int64_t count, int64_t height, int64_t width)
{
    const struct v2v_part rows = {0, height}, columns = {0, width};
    struct v2v_structure all = {0};
    int is_seen = 0;
    for (int64_t v = 0; v < count && !is_seen; v++) { /* one is enough, mostly */
        const float *view = views + v * height * width;
        const struct v2v_structure one = structure_of(view, view, width, rows, columns);
        v2v_structure_add(&all, &one);
        is_seen = seen(&all) > 1.0;
    }
    return is_seen;
}

int v2v_structure_lacks_view(const float *views, int64_t count, int64_t height, int64_t width)
{
    const struct v2v_part rows = {0, height}, columns = {0, width};
    double least = INFINITY, sum = 0.0;
    int64_t plain = 0;
#pragma omp parallel for schedule(static) reduction(min : least) reduction(+ : sum, plain)
    for (int64_t v = 0; v < count; v++) {
        const float *view = views + v * height * width;
        const struct v2v_structure one = structure_of(view, view, width, rows, columns);
        const double shown = sqrt(positive(one.yy - one.squares * variance_of(&one, 0.0)));
        least = fmin(least, shown);
        sum += shown;
        plain += seen(&one) > plainly;
    }
    return 2 * plain > count - 1 && least * (double)(count - 1) < dark * (sum - least);
}

double v2v_structure_brightness(const struct v2v_structure *view,
                                const struct v2v_structure *others)
{
    const double scale = scale_of(others), own = positive(scale_of(view));
    const double times = own / scale;
    if (!(view->light > 0.0)) { /* its light isn't known */
        return 1.0;
    }
    const double variance = variance_in_light(view, scale);
    const double missed = squares_missed(view, scale) - view->squares * variance_of(view, scale);
    const double by_brightness = (own - scale) * (own - scale) * view->pp;
    const double least = certain * sqrt(variance_of(others, scale) / others->pp); /* else noise */
    const int is_odd = scale > fmax(least, 0.0) && fmax(times, 1.0 / times) > least_odd &&
                       by_brightness > certain * certain * variance &&
                       by_brightness > most_of_it * missed;
    return is_odd ? times : 1.0;
}

static void cut(float *to, const float *image, int64_t width, struct v2v_part rows,
                struct v2v_part columns)
{
    for (int64_t i = 0; i < rows.count; i++) {
        memcpy(to + i * columns.count, image + (rows.first + i) * width + columns.first,
               (size_t)columns.count * sizeof *to);
    }
}

enum v2v_status v2v_structure_shifts(double *shift, const float *recorded, const float *projected,
                                     int64_t count, int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fourier *fourier = NULL;
    const struct v2v_part rows = inside(height), columns = inside(width);
    const int64_t pixels = rows.count * columns.count;
    float *images = NULL;
    V2V_TRY(V2V_ALLOC(images, "eval.shifts", v2v_mem_product(2, pixels, 1)));
    V2V_TRY(v2v_fourier_create(&fourier, rows.count, columns.count));
    for (int64_t v = 0; v < count; v++) {
        if (!has_structure_inside(recorded + v * height * width, height, width)) {
            shift[2 * v] = shift[2 * v + 1] = NAN;
            continue;
        }
        cut(images, recorded + v * height * width, width, rows, columns);
        cut(images + pixels, projected + v * height * width, width, rows, columns);
        v2v_fourier_shift(fourier, shift + 2 * v, images, images + pixels);
    }
done:
    v2v_fourier_destroy(&fourier);
    v2v_mem_free(images);
    return rc;
}
