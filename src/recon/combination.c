#include "recon/combination.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/conjugate_gradients.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

/* Conjugate gradients of the learned weights: steps at most, and the part of the first gradient at
 * which they end. Few steps regularise: neighbouring slices look alike in the views. */
enum { STEPS = 12 };
#define ENOUGH 1e-6

/* The least squares of the learned weights: views = brightness * A mean + sum of lean[z] * A
 * half[z], where mean and half are half the sum and half the difference of the two volumes. Of the
 * unknowns, the brightness comes first; each is in units of the norm of what it multiplies. */
struct least_squares {
    struct v2v_projector *projector;
    struct v2v_part own;       /* slices of this rank */
    float *mean, *half;        /* [own,y,x]; where the volumes are whole slices, those themselves */
    float *volume;             /* [own,y,x] */
    float *views;              /* [v,view rows,x] */
    double *norm;              /* [unknowns] 0: there is nothing of it */
    double *lean;              /* [unknowns] the solution */
    double *left, *along, *to; /* [unknowns] gradient, direction, and what that is mapped to */
    double *of_mean;           /* [unknowns] products of slices */
};

struct v2v_combination {
    enum v2v_combine kind;
    const struct v2v_grid *grid;
    struct v2v_slicing *slicing;
    int64_t views, slices, rows, height, width;
    float *other; /* [slices,rows,x] of the other rank of a pair; half of the difference */
    struct least_squares fit;
};

static int64_t unknowns_of(const struct v2v_combination *self)
{
    return 1 + self->slices;
}

int64_t v2v_combination_floats(const struct v2v_problem *problem, int ranks)
{
    const struct v2v_psf_file *psf = problem->psf;
    const int64_t pixels = v2v_mem_product(problem->height, problem->width, 1);
    if (problem->config->recon.combine != V2V_COMBINE_LEARNED) {
        return 0;
    }
    /* one of its own, and where ranks hold rows, the two that are fitted */
    const int64_t volumes = ranks > 1 ? 3 : 1;
    return v2v_projector_bytes(psf, problem->height, problem->width, V2V_SPLIT_SLICES, ranks) /
               (int64_t)sizeof(float) +
           (volumes * v2v_parts(psf->slices, ranks) + psf->views) * pixels;
}

/** Collective(shard). The status is this rank's but for the projector's. */
static enum v2v_status prepare_fit(struct v2v_combination *self, const struct v2v_problem *problem)
{
    enum v2v_status rc = V2V_OK;
    struct least_squares *fit = &self->fit;
    V2V_TRY(v2v_projector_create(&fit->projector, problem->psf, self->height, self->width,
                                 V2V_SPLIT_SLICES, self->grid->shard));
    const struct v2v_projector_share share = v2v_projector_share(fit->projector);
    fit->own = share.slices;
    V2V_ASSERT(share.rows.count == self->height);
    const int64_t volume = v2v_mem_product(fit->own.count, self->height, self->width);
    if (self->slicing != NULL) {
        V2V_ASSERT(v2v_slicing_own(self->slicing).first == fit->own.first);
        V2V_TRY(V2V_ALLOC(fit->mean, "recon.combination", volume));
        V2V_TRY(V2V_ALLOC(fit->half, "recon.combination", volume));
    }
    V2V_TRY(V2V_ALLOC(fit->volume, "recon.combination", volume));
    V2V_TRY(V2V_ALLOC(fit->views, "recon.combination",
                      v2v_mem_product(self->views, share.view_rows.count, self->width)));
    double **const vectors[] = {&fit->norm,  &fit->lean, &fit->left,
                                &fit->along, &fit->to,   &fit->of_mean};
    for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
        V2V_TRY(V2V_ALLOC(*vectors[i], "recon.combination", unknowns_of(self)));
    }
done:
    return rc;
}

enum v2v_status v2v_combination_create(struct v2v_combination **combination,
                                       const struct v2v_problem *problem,
                                       const struct v2v_grid *grid, struct v2v_slicing *slicing,
                                       int64_t rows)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_combination *made = NULL;
    *combination = NULL;
    rc = V2V_ALLOC(made, "recon.combination", 1);
    V2V_TRY(v2v_par_agree(grid->shard, rc));
    *made = (struct v2v_combination){.kind = problem->config->recon.combine,
                                     .grid = grid,
                                     .slicing = slicing,
                                     .views = problem->psf->views,
                                     .slices = problem->psf->slices,
                                     .rows = rows,
                                     .height = problem->height,
                                     .width = problem->width};
    if (made->kind == V2V_COMBINE_LEARNED) {
        rc = V2V_ALLOC(made->other, "recon.combination",
                       v2v_mem_product(made->slices, rows, made->width));
        V2V_TRY(v2v_par_agree(grid->shard, rc));
        rc = prepare_fit(made, problem);
        V2V_TRY(v2v_par_agree(grid->shard, rc));
    }
    *combination = made;
    made = NULL;
done:
    v2v_combination_destroy(&made);
    return rc;
}

void v2v_combination_destroy(struct v2v_combination **combination)
{
    struct v2v_combination *old = *combination;
    *combination = NULL;
    if (old == NULL) {
        return;
    }
    struct least_squares *fit = &old->fit;
    if (old->slicing != NULL) {
        v2v_mem_free(fit->mean);
        v2v_mem_free(fit->half);
    }
    void *memory[] = {fit->volume, fit->views, fit->norm,    fit->lean, fit->left,
                      fit->along,  fit->to,    fit->of_mean, old->other};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_projector_destroy(&fit->projector);
    v2v_mem_free(old);
}

static int64_t count_of(const struct v2v_combination *self)
{
    return self->slices * self->rows * self->width;
}

/** Collective(pair): both volumes; the other rank's comes into `room`. */
static void meet(const struct v2v_combination *self, const float **both, float *room,
                 const float *const *volume)
{
    const int own = volume[0] != NULL ? 0 : 1;
    both[0] = volume[0];
    both[1] = volume[1];
    if (self->grid->branch_size == 2) {
        v2v_par_exchange_f32(self->grid->pair, room, volume[own], count_of(self), 1 - own);
        both[1 - own] = room;
    }
}

static void take_larger(const struct v2v_combination *self, float *result, const float **both)
{
    const int64_t count = count_of(self);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        result[i] = fmaxf(both[0][i], both[1][i]);
    }
}

/** Halves are added, so that nothing overflows. */
static void average(const struct v2v_combination *self, float *result, const float **both)
{
    const int64_t count = count_of(self);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        result[i] = 0.0f + 0.5f * both[0][i] + 0.5f * both[1][i]; /* no -0 */
    }
}

/** Collective(shard): inner products of `volume` with the mean and with each slice of the half, in
 *  units of their norms. A slice is one thread's: bits do not depend on how many there are. Those
 *  of rank 0, as steps go by them and ranks may round another way. */
static void inner_products(const struct v2v_combination *self, double *out, const float *volume)
{
    const struct least_squares *fit = &self->fit;
    const int64_t pixels = self->height * self->width;
    memset(out, 0, (size_t)unknowns_of(self) * sizeof *out);
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < fit->own.count; z++) {
        const float *with = volume + z * pixels;
        fit->of_mean[z] = v2v_sum_of_products(fit->mean + z * pixels, with, pixels);
        out[1 + fit->own.first + z] = v2v_sum_of_products(fit->half + z * pixels, with, pixels);
    }
    for (int64_t z = 0; z < fit->own.count; z++) {
        out[0] += fit->of_mean[z];
    }
    v2v_par_sum_f64(self->grid->shard, out, unknowns_of(self));
    for (int64_t k = 0; k < unknowns_of(self); k++) {
        out[k] = fit->norm[k] > 0.0 ? out[k] / fit->norm[k] : 0.0;
    }
    v2v_par_broadcast(self->grid->shard, out, unknowns_of(self) * (int64_t)sizeof *out, 0);
}

/** Local: volume = x[0] * mean + x[1 + z] * half[z]. */
static void combine_slices(const struct v2v_combination *self, const double *x)
{
    const struct least_squares *fit = &self->fit;
    const int64_t pixels = self->height * self->width;
    const double of_mean = fit->norm[0] > 0.0 ? x[0] / fit->norm[0] : 0.0;
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < fit->own.count; z++) {
        const int64_t at = 1 + fit->own.first + z;
        const double of_half = fit->norm[at] > 0.0 ? x[at] / fit->norm[at] : 0.0;
        for (int64_t i = z * pixels; i < (z + 1) * pixels; i++) {
            fit->volume[i] = (float)(of_mean * fit->mean[i] + of_half * fit->half[i]);
        }
    }
}

/** Collective(shard): the normal equations' matrix. @param of a v2v_combination */
static void multiply(void *of, double *product, const double *along)
{
    const struct v2v_combination *self = of;
    const struct least_squares *fit = &self->fit;
    v2v_watchdog_beat("weights of slices");
    combine_slices(self, along);
    v2v_projector_forward(fit->projector, fit->views, fit->volume, NULL, self->views, 1.0f);
    v2v_projector_adjoint(fit->projector, fit->volume, fit->views, NULL, self->views, 1.0f);
    inner_products(self, product, fit->volume);
}

/** Collective(shard): norms, and the gradient at 0. */
static void begin(const struct v2v_combination *self, const float *views)
{
    const struct least_squares *fit = &self->fit;
    const int64_t n = unknowns_of(self), pixels = self->height * self->width;
    memset(fit->norm, 0, (size_t)n * sizeof *fit->norm);
    for (int64_t z = 0; z < fit->own.count; z++) {
        fit->norm[0] += v2v_sum_of_squares(fit->mean + z * pixels, pixels);
        fit->norm[1 + fit->own.first + z] = v2v_sum_of_squares(fit->half + z * pixels, pixels);
    }
    v2v_par_sum_f64(self->grid->shard, fit->norm, n);
    for (int64_t k = 0; k < n; k++) {
        fit->norm[k] = sqrt(fit->norm[k]);
    }
    v2v_projector_cut_views(fit->projector, fit->views, views, self->views);
    v2v_projector_adjoint(fit->projector, fit->volume, fit->views, NULL, self->views, 1.0f);
    inner_products(self, fit->left, fit->volume);
}

/** Collective(shard): lean = the least squares' solution. */
static void solve(struct v2v_combination *self, const float *views)
{
    struct least_squares *fit = &self->fit;
    begin(self, views);
    v2v_conjugate_gradients_solve(&(struct v2v_conjugate_gradients){.count = unknowns_of(self),
                                                                    .steps = STEPS,
                                                                    .enough = ENOUGH * ENOUGH,
                                                                    .way = fit->along,
                                                                    .product = fit->to,
                                                                    .multiply = multiply,
                                                                    .of = self},
                                  fit->lean, fit->left);
}

/** Local: what a slice leans to the first volume: 1 is that alone, -1 the second one. */
static float lean_of(const struct least_squares *fit, int64_t z)
{
    const double brightness = fit->norm[0] > 0.0 ? fit->lean[0] / fit->norm[0] : 0.0;
    const double norm = fit->norm[1 + z];
    if (!(brightness > 0.0) || !(norm > 0.0)) {
        return 0.0f;
    }
    return (float)fmin(fmax(fit->lean[1 + z] / norm / brightness, -1.0), 1.0);
}

/** Collective(shard): each slice's weights are those with which the volume explains the views
 *  best. The ranks of a pair do the same. */
static void weigh(struct v2v_combination *self, float *result, const float **both,
                  const float *views)
{
    struct least_squares *fit = &self->fit;
    const int64_t slice = self->rows * self->width, count = count_of(self);
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i++) {
        const float first = 0.5f * both[0][i], second = 0.5f * both[1][i];
        result[i] = first + second;
        self->other[i] = first - second;
    }
    if (self->slicing != NULL) {
        v2v_slicing_to_slices(self->slicing, fit->mean, result);
        v2v_slicing_to_slices(self->slicing, fit->half, self->other);
    } else {
        fit->mean = result;
        fit->half = self->other;
    }
    solve(self, views);
#pragma omp parallel for schedule(static)
    for (int64_t z = 0; z < self->slices; z++) {
        const float lean = lean_of(fit, z);
        for (int64_t i = z * slice; i < (z + 1) * slice; i++) {
            result[i] += lean * self->other[i];
        }
    }
}

void v2v_combination_run(struct v2v_combination *combination, float *result,
                         const float *const *volume, const float *views)
{
    const int is_learned = combination->kind == V2V_COMBINE_LEARNED;
    const float *both[2];
    meet(combination, both, is_learned ? combination->other : result, volume);
    if (is_learned) {
        weigh(combination, result, both, views);
    } else if (combination->kind == V2V_COMBINE_MAX) {
        take_larger(combination, result, both);
    } else {
        average(combination, result, both);
    }
}
