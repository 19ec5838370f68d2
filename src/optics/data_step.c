#include "v2v3d/optics/data_step.h"
#include "optics/hermitian.h"
#include "optics/projector_plan.h"
#include "optics/spectrum_block.h"
#include "optics/torus_views.h"
#include "optics/tridiagonal.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include "v2v3d/optics/psf.h"
#include <math.h>
#include <omp.h>
#include <string.h>

struct v2v_data_step {
    struct v2v_projector *projector; /* on the torus */
    const struct v2v_comm *comm;     /* borrowed */
    int64_t views, slices;
    struct v2v_torus_views seen;

    struct v2v_penalty penalty; /* of the factors; all 0: none yet */
    float *pivots;              /* [block,z,V2V_BLOCK]: one over those of P */
    float *factor;              /* [block,pair,2,V2V_BLOCK] of the inverses, upper triangles */
    float *volume;              /* [block,z,2,V2V_BLOCK]: spectra of the x that advance moves */
    float *change;              /* [block,2,V2V_BLOCK]: squares of what it moved by, and of x' */
    float relax;                /* of the advance under way */
    float unit;                 /* of its squares: as bright as the views, a pixel */
    double filled;              /* v2v_data_step_filled of the last change */
    float *spectra;             /* [block,v,2,V2V_BLOCK]: of y */
    float *scratch;             /* [thread,scratch_of] */
    double *entries;            /* [thread,entries_of] */
    double *squares;            /* [v, square]: of v2v_data_step_coarse */
    double *sums;               /* [torus height] or [2,column]: squares of a row of all views, or
                                   of a column of all slices' spectra; then x's sum */
};

static double pixels_of(const struct v2v_data_step *step)
{
    return (double)step->seen.torus.height * (double)step->seen.torus.width;
}

/* Numbers of each array. */
struct sizes {
    int64_t pivots, factor, volume, change, spectra, scratch, entries, sums, squares;
};

static int64_t pivots_of_block(int64_t slices)
{
    return slices * V2V_BLOCK;
}

/* What a thread inverts a block with: pivots of P, A times its root, and room of the inverse. */
static int64_t entries_of(int64_t views, int64_t slices)
{
    return pivots_of_block(slices) + views * slices * V2V_BLOCK_FLOATS +
           v2v_hermitian_scratch(views);
}

/* What a thread works in: two numbers a view, and one a slice, of a frequency. */
static int64_t scratch_of(int64_t views, int64_t slices)
{
    return (2 * views + slices) * V2V_BLOCK_FLOATS;
}

static struct sizes sizes_of(int64_t views, int64_t slices, int64_t blocks,
                             const struct v2v_torus *torus)
{
    return (struct sizes){
        .pivots = v2v_mem_product(blocks, pivots_of_block(slices), 1),
        .volume = v2v_mem_product(blocks, slices, V2V_BLOCK_FLOATS),
        .change = v2v_mem_product(blocks, V2V_BLOCK_FLOATS, 1),
        .squares = v2v_mem_product(views, torus->height / V2V_DATA_STEP_SQUARE,
                                   torus->width / V2V_DATA_STEP_SQUARE),
        .sums = v2v_larger(torus->height, 2 * (torus->width / 2 + 1) + 1),
        .factor = v2v_mem_product(blocks, v2v_hermitian_pairs(views), V2V_BLOCK_FLOATS),
        .spectra = v2v_mem_product(blocks, views, V2V_BLOCK_FLOATS),
        .scratch = v2v_mem_product(omp_get_max_threads(), scratch_of(views, slices), 1),
        .entries = v2v_mem_product(omp_get_max_threads(), entries_of(views, slices), 1)};
}

int64_t v2v_data_step_bytes(const struct v2v_psf_file *psf, const struct v2v_torus *torus,
                            enum v2v_split split, int ranks)
{
    struct v2v_projector_layout layout;
    struct v2v_torus own = *torus;
    if (!v2v_projector_plan(&layout, psf, torus->height, torus->width, V2V_BEYOND_PERIODIC, split,
                            ranks, 0)) {
        return INT64_MAX;
    }
    own.rows = v2v_par_part(torus->height, ranks, 0);
    const struct sizes sizes = sizes_of(psf->views, psf->slices, layout.blocks, &own);
    const struct v2v_torus_views seen = {.views = psf->views, .torus = own};
    return v2v_mem_bytes(sizes.pivots + sizes.factor + sizes.volume + sizes.change +
                             2 * v2v_torus_views_samples(&seen) + sizes.spectra + sizes.scratch +
                             2 * (sizes.entries + sizes.sums + sizes.squares),
                         v2v_projector_bytes_beyond(psf, torus->height, torus->width,
                                                    V2V_BEYOND_PERIODIC, split, ranks));
}

static enum v2v_status take_memory(struct v2v_data_step *step, const struct v2v_torus *torus,
                                   int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    const struct sizes sizes =
        sizes_of(step->views, step->slices, step->projector->layout.blocks, torus);
    V2V_TRY(v2v_torus_views_init(&step->seen, step->views, height, width, torus));
    V2V_TRY(V2V_ALLOC(step->pivots, "data_step.factor", sizes.pivots));
    V2V_TRY(V2V_ALLOC(step->factor, "data_step.factor", sizes.factor));
    V2V_TRY(V2V_ALLOC(step->volume, "data_step.volume", sizes.volume));
    V2V_TRY(V2V_ALLOC(step->change, "data_step.volume", sizes.change));
    V2V_TRY(V2V_ALLOC(step->spectra, "data_step.views", sizes.spectra));
    V2V_TRY(V2V_ALLOC(step->scratch, "data_step.block", sizes.scratch));
    V2V_TRY(V2V_ALLOC(step->entries, "data_step.factor", sizes.entries));
    V2V_TRY(V2V_ALLOC(step->sums, "data_step.views", sizes.sums));
    V2V_TRY(V2V_ALLOC(step->squares, "data_step.views", sizes.squares));
done:
    return rc;
}

enum v2v_status v2v_data_step_create(struct v2v_data_step **step, const struct v2v_psf_file *psf,
                                     int64_t height, int64_t width, const struct v2v_torus *torus,
                                     enum v2v_split split, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_data_step *made = NULL;
    struct v2v_torus own = *torus;
    V2V_ASSERT(split == V2V_SPLIT_SLABS || split == V2V_SPLIT_SLABS_FFTW3_MPI);
    V2V_ASSERT(torus->height >= height && torus->width >= width);
    *step = NULL;
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(made, "data_step", 1)));
    *made = (struct v2v_data_step){.comm = comm, .views = psf->views, .slices = psf->slices};
    V2V_TRY(v2v_projector_create_beyond(&made->projector, psf, torus->height, torus->width,
                                        V2V_BEYOND_PERIODIC, split, comm));
    own.rows = v2v_projector_share(made->projector).rows;
    V2V_TRY(v2v_par_agree(comm, take_memory(made, &own, height, width)));
    made->unit = (float)(v2v_psf_light(psf) / pixels_of(made));
    *step = made;
    made = NULL;
done:
    v2v_data_step_destroy(&made);
    return rc;
}

void v2v_data_step_destroy(struct v2v_data_step **step)
{
    struct v2v_data_step *old = *step;
    *step = NULL;
    if (old != NULL) {
        v2v_projector_destroy(&old->projector);
        v2v_mem_free(old->pivots);
        v2v_mem_free(old->factor);
        v2v_mem_free(old->volume);
        v2v_mem_free(old->change);
        v2v_torus_views_fini(&old->seen);
        v2v_mem_free(old->spectra);
        v2v_mem_free(old->scratch);
        v2v_mem_free(old->entries);
        v2v_mem_free(old->sums);
        v2v_mem_free(old->squares);
        v2v_mem_free(old);
    }
}

struct v2v_torus v2v_data_step_torus(const struct v2v_data_step *step)
{
    return step->seen.torus;
}

static float *factor_of(const struct v2v_data_step *step, int64_t block)
{
    return step->factor + block * v2v_hermitian_pairs(step->views) * V2V_BLOCK_FLOATS;
}

static float *pivots_of(const struct v2v_data_step *step, int64_t block)
{
    return step->pivots + block * pivots_of_block(step->slices);
}

static float *spectra_of(const struct v2v_data_step *step, int64_t block)
{
    return step->spectra + block * step->views * V2V_BLOCK_FLOATS;
}

/* Of number `at` of a spectrum here. */
static double penalty_at(const struct v2v_data_step *step, const struct v2v_penalty *penalty,
                         int64_t at)
{
    const struct v2v_fft_shape *shape = &step->projector->layout.shape;
    const int64_t kx = step->projector->columns.first + at / shape->ny, ky = at % shape->ny;
    const double turn = 2.0 * V2V_PI;
    const double along_x = 2.0 - 2.0 * cos(turn * (double)kx / (double)shape->nx);
    const double along_y = 2.0 - 2.0 * cos(turn * (double)ky / (double)shape->ny);
    const double laplacian = (4.0 - along_x) * (4.0 - along_y) / 4.0 - 4.0;
    return penalty->constant + penalty->differences * (along_x + along_y) +
           penalty->curvature * laplacian * laplacian;
}

/* Numbers beyond the last one count as it. */
static void invert_block(struct v2v_data_step *step, int64_t b)
{
    const struct v2v_frequency_block *block = &step->projector->block[b];
    const int64_t views = step->views, slices = step->slices;
    double *pivots = step->entries + omp_get_thread_num() * entries_of(views, slices);
    double *root = pivots + pivots_of_block(slices);
    double *scratch = root + views * slices * V2V_BLOCK_FLOATS, penalties[V2V_BLOCK];
    for (int64_t f = 0; f < V2V_BLOCK; f++) {
        const int64_t at = block->first + v2v_smaller(f, block->width - 1);
        penalties[f] = penalty_at(step, &step->penalty, at);
    }
    v2v_tridiagonal_factor(pivots, penalties, step->penalty.depth, slices);
    for (int64_t i = 0; i < pivots_of_block(slices); i++) {
        pivots_of(step, b)[i] = (float)pivots[i];
    }
    for (int64_t v = 0; v < views; v++) {
        v2v_tridiagonal_root(root + v * slices * V2V_BLOCK_FLOATS,
                             v2v_projector_otf(step->projector, b, v), pivots, step->penalty.depth,
                             slices);
    }
    v2v_hermitian_inverse(factor_of(step, b), scratch, root, views, slices);
}

void v2v_data_step_factor(struct v2v_data_step *step, const struct v2v_penalty *penalty)
{
    const struct v2v_penalty *old = &step->penalty;
    V2V_ASSERT(penalty->constant > 0.0 && penalty->differences >= 0.0 && penalty->depth >= 0.0 &&
               penalty->curvature >= 0.0);
    if (old->constant == penalty->constant && old->differences == penalty->differences &&
        old->depth == penalty->depth && old->curvature == penalty->curvature) {
        return;
    }
    step->penalty = *penalty;
#pragma omp parallel for schedule(dynamic) num_threads(step->projector->threads)
    for (int64_t b = 0; b < step->projector->layout.blocks; b++) {
        invert_block(step, b);
    }
}

/* The spectra of y, in blocks. Collective(comm). */
static void transform_views(struct v2v_data_step *step)
{
    const struct v2v_projector *projector = step->projector;
    const struct v2v_projector_layout *layout = &projector->layout;
    v2v_fft_slabs_forward(projector->together, projector->view_spectra, layout->view_stride,
                          step->seen.recorded, step->views);
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t b = 0; b < layout->blocks; b++) {
        const struct v2v_frequency_block *block = &projector->block[b];
        v2v_block_split(spectra_of(step, b), projector->view_spectra + block->first,
                        layout->view_stride, step->views, block->width);
    }
}

void v2v_data_step_begin(struct v2v_data_step *step, const float *views, double scale)
{
    v2v_torus_views_take(&step->seen, views, scale);
    transform_views(step);
}

void v2v_data_step_begin_torus(struct v2v_data_step *step, const float *views)
{
    v2v_torus_views_take_whole(&step->seen, views);
    transform_views(step);
}

void v2v_data_step_gather(struct v2v_data_step *step, float *whole, const float *rows,
                          int64_t count)
{
    v2v_projector_gather_views(step->projector, whole, rows, count);
}

void v2v_data_step_know(struct v2v_data_step *step, const struct v2v_part *rows,
                        const struct v2v_part *columns)
{
    step->seen.known_rows = *rows;
    step->seen.known_columns = *columns;
}

void v2v_data_step_surround(struct v2v_data_step *step, const float *volume, const float *seen,
                            const float *frame, const float *highest)
{
    v2v_data_step_project(step, step->seen.missed, volume);
    v2v_torus_views_surround(&step->seen, seen, frame, highest);
    transform_views(step);
}

void v2v_data_step_project(struct v2v_data_step *step, float *views, const float *volume)
{
    v2v_projector_forward(step->projector, views, volume, NULL, step->views, 1.0f);
}

static float *volume_of(const struct v2v_data_step *step, int64_t block)
{
    return step->volume + block * step->slices * V2V_BLOCK_FLOATS;
}

/* P^-1 of the slices of one block. */
static void divide(const struct v2v_data_step *step, int64_t b, float *slice)
{
    v2v_tridiagonal_solve(slice, pivots_of(step, b), (float)step->penalty.depth, step->slices);
}

/* v -> x of the slices of one block; y - A x goes where the views' spectra belong. */
static void solve_block(struct v2v_data_step *step, int64_t b, float *slice)
{
    const struct v2v_projector *projector = step->projector;
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct v2v_frequency_block *block = &projector->block[b];
    const float *recorded = spectra_of(step, b), *otf = v2v_projector_otf(projector, b, 0);
    const int64_t of_view = step->slices * V2V_BLOCK_FLOATS;
    float *rest = step->scratch + omp_get_thread_num() * scratch_of(step->views, step->slices);
    float *solved = rest + step->views * V2V_BLOCK_FLOATS;
    float *moved = solved + step->views * V2V_BLOCK_FLOATS;
    for (int64_t v = 0; v < step->views; v++) {
        v2v_block_rest(rest + v * V2V_BLOCK_FLOATS, recorded + v * V2V_BLOCK_FLOATS,
                       otf + v * of_view, slice, step->slices);
    }
    v2v_hermitian_multiply(solved, factor_of(step, b), rest, step->views);
    memset(moved, 0, (size_t)of_view * sizeof *moved);
    for (int64_t v = 0; v < step->views; v++) {
        v2v_block_project_adjoint(moved, otf + v * of_view, solved + v * V2V_BLOCK_FLOATS,
                                  step->slices);
    }
    divide(step, b, moved);
    v2v_block_add(slice, moved, step->slices);
    v2v_block_merge(projector->view_spectra + block->first, solved, layout->view_stride,
                    step->views, block->width);
}

static void advance_block(struct v2v_data_step *step, int64_t b, float *slice)
{
    divide(step, b, slice);
    v2v_block_descend(slice, volume_of(step, b), step->slices);
    solve_block(step, b, slice);
    v2v_block_move(step->change + b * V2V_BLOCK_FLOATS, slice, volume_of(step, b), step->relax,
                   step->unit, step->slices);
}

enum v2v_status v2v_data_step_take_weights(struct v2v_data_step *step)
{
    return v2v_torus_views_take_weights(&step->seen);
}

void v2v_data_step_weigh(struct v2v_data_step *step, double gain, double floor)
{
    v2v_torus_views_weigh(&step->seen, gain, floor);
}

void v2v_data_step_average(struct v2v_data_step *step, const float *frames, double unit)
{
    v2v_torus_views_average(&step->seen, frames, unit);
}

static void restore(const struct v2v_data_step *step, float *volume)
{
    const struct v2v_projector *projector = step->projector;
    v2v_fft_slabs_inverse(projector->together, volume, (float)(1.0 / pixels_of(step)),
                          projector->slice_spectra, projector->layout.slice_stride, step->slices);
}

/* What `change` makes of the spectra of `volume`, block by block of all slices. */
static void change_spectra(struct v2v_data_step *step, float *volume,
                           void (*change)(struct v2v_data_step *step, int64_t b, float *slice))
{
    const struct v2v_projector *projector = step->projector;
    const struct v2v_projector_layout *layout = &projector->layout;
    V2V_ASSERT(step->penalty.constant > 0.0);
    v2v_fft_slabs_forward(projector->together, projector->slice_spectra, layout->slice_stride,
                          volume, step->slices);
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t b = 0; b < layout->blocks; b++) {
        const struct v2v_frequency_block *block = &projector->block[b];
        struct v2v_complex *spectra = projector->slice_spectra + block->first;
        float *slice = v2v_projector_scratch(projector) + 2 * V2V_BLOCK_FLOATS;
        v2v_block_split(slice, spectra, layout->slice_stride, step->slices, block->width);
        change(step, b, slice);
        v2v_block_merge(spectra, slice, layout->slice_stride, step->slices, block->width);
    }
    restore(step, volume);
}

void v2v_data_step_run(struct v2v_data_step *step, float *volume)
{
    change_spectra(step, volume, solve_block);
}

void v2v_data_step_advance(struct v2v_data_step *step, float *volume, float relax)
{
    step->relax = relax;
    change_spectra(step, volume, advance_block);
}

void v2v_data_step_clear(struct v2v_data_step *step)
{
    const int64_t floats = step->slices * V2V_BLOCK_FLOATS;
#pragma omp parallel for schedule(static) num_threads(step->projector->threads)
    for (int64_t b = 0; b < step->projector->layout.blocks; b++) {
        memset(volume_of(step, b), 0, (size_t)floats * sizeof(float));
    }
}

void v2v_data_step_volume(struct v2v_data_step *step, float *volume)
{
    const struct v2v_projector *projector = step->projector;
    const struct v2v_projector_layout *layout = &projector->layout;
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t b = 0; b < layout->blocks; b++) {
        const struct v2v_frequency_block *block = &projector->block[b];
        v2v_block_merge(projector->slice_spectra + block->first, volume_of(step, b),
                        layout->slice_stride, step->slices, block->width);
    }
    restore(step, volume);
}

/* Squares of a column of half a spectrum: what isn't there mirrors what is. */
static void sum_column(const struct v2v_data_step *step, int64_t column)
{
    const struct v2v_fft_shape *shape = &step->projector->layout.shape;
    const int64_t kx = step->projector->columns.first + column;
    const double weight = kx == 0 || 2 * kx == shape->nx ? 1.0 : 2.0;
    double change = 0.0, whole = 0.0;
    for (int64_t at = column * shape->ny; at < (column + 1) * shape->ny; at++) {
        const float *squares = step->change + at / V2V_BLOCK * V2V_BLOCK_FLOATS + at % V2V_BLOCK;
        change += (double)squares[0];
        whole += (double)squares[V2V_BLOCK];
    }
    step->sums[2 * kx] = weight * change;
    step->sums[2 * kx + 1] = weight * whole;
}

/* The sum of x, of the rank that has its frequency, in units of the squares; 0 of others. */
static double light_of(const struct v2v_data_step *step)
{
    const struct v2v_part *columns = &step->projector->columns;
    const int64_t slices = columns->first == 0 && columns->count > 0 ? step->slices : 0;
    double light = 0.0;
    for (int64_t z = 0; z < slices; z++) {
        light += (double)volume_of(step, 0)[z * V2V_BLOCK_FLOATS];
    }
    return (double)step->unit * light;
}

double v2v_data_step_change(struct v2v_data_step *step)
{
    const int64_t half = step->projector->layout.half;
    double change = 0.0, whole = 0.0;
    memset(step->sums, 0, (size_t)(2 * half) * sizeof *step->sums);
    step->sums[2 * half] = light_of(step);
#pragma omp parallel for schedule(static) num_threads(step->projector->threads)
    for (int64_t k = 0; k < step->projector->columns.count; k++) {
        sum_column(step, k);
    }
    v2v_par_sum_f64(step->comm, step->sums, 2 * half + 1);
    for (int64_t k = 0; k < half; k++) { /* one order for any number of ranks */
        change += step->sums[2 * k];
        whole += step->sums[2 * k + 1];
    }
    const double light = step->sums[2 * half];
    step->filled = whole > 0.0 ? light * light / (whole * (double)step->slices) : 1.0;
    return whole == 0.0 ? 0.0 : sqrt(change / whole);
}

double v2v_data_step_filled(const struct v2v_data_step *step)
{
    return step->filled;
}

double v2v_data_step_extend(struct v2v_data_step *step)
{
    struct v2v_projector *projector = step->projector;
    const int64_t height = step->seen.torus.height;
    const double factor = 1.0 / pixels_of(step);
    double squares = 0.0;
    v2v_fft_slabs_inverse(projector->together, step->seen.missed, (float)factor,
                          projector->view_spectra, projector->layout.view_stride, step->views);
    memset(step->sums, 0, (size_t)height * sizeof *step->sums);
    v2v_torus_views_extend(&step->seen, step->sums);
    transform_views(step);
    v2v_par_sum_f64(step->comm, step->sums, height);
    for (int64_t y = 0; y < height; y++) { /* one order for any number of ranks */
        squares += step->sums[y];
    }
    return squares;
}

int64_t v2v_data_step_known(const struct v2v_data_step *step)
{
    return v2v_torus_views_known(&step->seen);
}

/* Sums over what a rank has of each square; then over ranks, since squares lie across them. */
double v2v_data_step_coarse(struct v2v_data_step *step)
{
    const int64_t count = v2v_torus_views_squares(&step->seen);
    double squares = 0.0;
    int64_t seen = 0;
    v2v_torus_views_coarse(&step->seen, step->squares);
    v2v_par_sum_f64(step->comm, step->squares, count);
    for (int64_t i = 0; i < count; i++) {
        if (!isnan(step->squares[i])) {
            squares += step->squares[i] * step->squares[i];
            seen++;
        }
    }
    return seen > 0 ? sqrt(squares / (double)seen) / V2V_DATA_STEP_SQUARE : 0.0;
}
