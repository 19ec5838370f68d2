#include "twin_tv.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Over-relaxation; the part of the noise below which differences are weighted by their squares;
 * iterations from one look beyond the frame to the next. */
static const double relax = 1.7, smooth_below = 0.03;
enum { EXTEND_EVERY = 2, AXES = 3, PACE_LOOK = 10 };

/* Of the Laplacian of x in the operator. */
static const double bend = 0.7;

/* On the torus, [z,y,x] each. */
struct planes {
    int64_t slices, height, width, voxels;
    double *volume, *next, *gradient, *extrapolated, *positive, *curved, *dual[AXES];
};

static int64_t neighbour(const struct planes *p, int64_t i, int64_t dz, int64_t dy, int64_t dx)
{
    const int64_t x = (i % p->width + dx + p->width) % p->width;
    const int64_t y = (i / p->width % p->height + dy + p->height) % p->height;
    const int64_t z = i / (p->width * p->height) + dz;
    return z < 0 || z >= p->slices ? -1 : (z * p->height + y) * p->width + x;
}

/* (1 2 1; 2 -12 2; 1 2 1) / 4. */
static double laplacian(const struct planes *p, const double *x, int64_t i)
{
    static const double weights[3] = {1.0, 2.0, 1.0};
    double sum = -4.0 * x[i];
    for (int64_t dy = -1; dy <= 1; dy++) {
        for (int64_t dx = -1; dx <= 1; dx++) {
            sum += 0.25 * weights[dy + 1] * weights[dx + 1] * x[neighbour(p, i, 0, dy, dx)];
        }
    }
    return sum;
}

static void move_duals(struct planes *p, const struct twin_tv *settings,
                       const struct twin_pace *pace)
{
    const double sigma = pace->step;
    const double shrink = 1.0 / (1.0 + sigma * smooth_below / settings->weight);
    const double bound = settings->weight * settings->curvature / bend;
    const double shrink_curved = 1.0 / (1.0 + sigma * bend * smooth_below / bound);
    const double *e = p->extrapolated;
    for (int64_t i = 0; i < p->voxels; i++) {
        const int64_t behind = neighbour(p, i, 1, 0, 0);
        const double d[AXES] = {e[neighbour(p, i, 0, 0, 1)] - e[i],
                                e[neighbour(p, i, 0, 1, 0)] - e[i],
                                behind < 0 ? 0.0 : settings->depth * (e[behind] - e[i])};
        double moved[AXES], squares = 0.0;
        for (int a = 0; a < AXES; a++) {
            moved[a] = shrink * (p->dual[a][i] + sigma * d[a]);
            squares += moved[a] * moved[a];
        }
        const double factor = fmin(1.0, settings->weight / sqrt(squares));
        for (int a = 0; a < AXES; a++) {
            p->dual[a][i] +=
                relax * (squares > 0.0 ? moved[a] * factor - p->dual[a][i] : -p->dual[a][i]);
        }
        const double curved = shrink_curved * (p->curved[i] + sigma * bend * laplacian(p, e, i));
        p->curved[i] += relax * (fmax(-bound, fmin(bound, curved)) - p->curved[i]);
        const double positive = p->positive[i] + sigma * pace->plain * e[i];
        p->positive[i] += relax * (fmin(settings->sparse / pace->plain, positive) - p->positive[i]);
    }
}

/* The adjoint of the differences, of the duals, at a voxel. */
static double pull(const struct planes *p, const struct twin_tv *settings,
                   const struct twin_pace *pace, int64_t i)
{
    const int64_t before = neighbour(p, i, -1, 0, 0), behind = neighbour(p, i, 1, 0, 0);
    const double above_z = before < 0 ? 0.0 : p->dual[2][before];
    const double own_z = behind < 0 ? 0.0 : p->dual[2][i];
    return p->dual[0][neighbour(p, i, 0, 0, -1)] - p->dual[0][i] +
           p->dual[1][neighbour(p, i, 0, -1, 0)] - p->dual[1][i] +
           settings->depth * (above_z - own_z) + bend * laplacian(p, p->curved, i) +
           pace->plain * p->positive[i];
}

struct twin_penalty twin_tv_penalty(const struct twin_tv *settings, const struct twin_pace *pace)
{
    const double step = pace->step;
    return (struct twin_penalty){.constant = step * pace->plain * pace->plain,
                                 .differences = step,
                                 .depth = step * settings->depth * settings->depth,
                                 .curvature = step * bend * bend};
}

static double length_of(const double *x, int64_t count)
{
    double squares = 0.0;
    for (int64_t i = 0; i < count; i++) {
        squares += x[i] * x[i];
    }
    return sqrt(squares);
}

/* @return |x'| */
static double iterate(struct planes *p, struct twin_data_step *step, const struct twin_tv *settings,
                      const struct twin_pace *pace, int64_t iteration)
{
    const struct twin_penalty penalty = twin_tv_penalty(settings, pace);
    memcpy(p->next, p->volume, (size_t)p->voxels * sizeof *p->next);
    for (int64_t i = 0; i < p->voxels; i++) {
        p->gradient[i] = pull(p, settings, pace, i);
    }
    twin_data_step_run(step, p->next, p->gradient, &penalty);
    if (iteration % EXTEND_EVERY == 0) {
        twin_data_step_extend(step, p->next);
    }
    for (int64_t i = 0; i < p->voxels; i++) {
        p->extrapolated[i] = 2.0 * p->next[i] - p->volume[i];
        p->volume[i] += relax * (p->next[i] - p->volume[i]);
    }
    move_duals(p, settings, pace);
    return length_of(p->next, p->voxels);
}

/* Would the light fill more than half of the voxels, if each had the same? */
static int is_filled(const struct planes *p)
{
    const double length = length_of(p->next, p->voxels);
    double light = 0.0;
    for (int64_t i = 0; i < p->voxels; i++) {
        light += p->volume[i];
    }
    return light * light > 0.5 * length * length * (double)p->voxels;
}

double twin_tv_run(double *volume, struct twin_data_step *step, const struct twin_tv *settings)
{
    enum { ARRAYS = 6 + AXES };
    double longest = 0.0;
    struct planes p = {
        .slices = step->slices, .height = step->torus_height, .width = step->torus_width};
    p.voxels = p.slices * p.height * p.width;
    double *memory = calloc((size_t)(ARRAYS * p.voxels), sizeof *memory);
    if (memory == NULL) {
        abort();
    }
    p.volume = memory;
    p.next = memory + p.voxels;
    p.extrapolated = memory + 2 * p.voxels;
    p.positive = memory + 3 * p.voxels;
    for (int a = 0; a < AXES; a++) {
        p.dual[a] = memory + (4 + a) * p.voxels;
    }
    p.curved = memory + (4 + AXES) * p.voxels;
    p.gradient = memory + (5 + AXES) * p.voxels;
    const struct twin_pace *pace = &settings->pace, *filled = &settings->pace_if_filled;
    for (int64_t i = 1; i <= settings->iterations; i++) {
        longest = fmax(longest, iterate(&p, step, settings, pace, i));
        if (i == PACE_LOOK && is_filled(&p)) {
            for (int64_t k = 0; k < p.voxels; k++) {
                p.positive[k] *= pace->plain / filled->plain; /* the same pull */
            }
            pace = filled;
        }
    }
    for (int64_t i = 0; i < p.slices * step->height * step->width; i++) {
        const int64_t row = i / step->width;
        const int64_t at = (row / step->height * p.height + row % step->height) * p.width;
        volume[i] = fmax(0.0, p.volume[at + i % step->width]);
    }
    free(memory);
    return longest / length_of(volume, p.slices * step->height * step->width);
}
