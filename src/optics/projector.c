#include "v2v3d/optics/projector.h"
#include "optics/projector_plan.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/par/exchange.h"
#include <string.h>

struct v2v_projector_share v2v_projector_share(const struct v2v_projector *projector)
{
    return projector->share;
}

static float transform_factor(const struct v2v_projector *projector, float scale)
{
    const struct v2v_fft_shape *shape = &projector->layout.shape;
    return (float)((double)scale / (double)(shape->ny * shape->nx));
}

/* The listed views of one call. */
struct views {
    const int32_t *list;
    int64_t count;
};

static int64_t view_at(const struct v2v_projector *projector, const struct views *views, int64_t i)
{
    const int64_t v = views->list == NULL ? i : views->list[i];
    V2V_ASSERT(v >= 0 && v < projector->layout.views);
    return v;
}

/* Rounds that go in one exchange: with few views several fit. */
static struct v2v_part rounds_from(const struct v2v_projector *projector, int64_t first,
                                   int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int64_t fit = count > 0 ? layout->views / count : layout->rounds;
    return (struct v2v_part){first, v2v_smaller(fit, layout->rounds - first)};
}

static struct v2v_part blocks_of(const struct v2v_projector *projector, struct v2v_part rounds)
{
    const int64_t owners = projector->layout.owners;
    const int64_t first = projector->range[rounds.first * owners].block;
    const int64_t end = projector->range[(rounds.first + rounds.count) * owners].block;
    return (struct v2v_part){first, end - first};
}

/* Where the numbers of view i in a range lie in the exchange of `rounds` with rank `other`. */
static int64_t place_of(const struct v2v_projector *projector, struct v2v_part rounds,
                        int64_t range, int64_t other, int64_t i, int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int64_t round = range / layout->owners - rounds.first;
    return other * layout->slot + round * count * layout->step * layout->shape.ny +
           i * projector->range[range].count;
}

/* Numbers of one owner in the exchange of `rounds`. */
static int64_t numbers_of(const struct v2v_projector *projector, struct v2v_part rounds,
                          int64_t owner, int64_t count)
{
    int64_t numbers = 0;
    for (int64_t j = rounds.first; j < rounds.first + rounds.count; j++) {
        numbers += count * projector->range[j * projector->layout.owners + owner].count;
    }
    return numbers;
}

/* Sum over this rank's slices of one block of view i: rounded into the views' spectra, or kept as
 * it is for the rank that sums up. */
static void store(const struct v2v_projector *projector, const double *sum, int64_t b,
                  struct v2v_part rounds, int64_t i, int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct v2v_frequency_block *block = &projector->block[b];
    if (layout->slot == 0) {
        v2v_block_round(projector->view_spectra + i * layout->view_stride + block->first, sum,
                        block->width);
        return;
    }
    const int64_t within = block->first - projector->range[block->range].first;
    struct v2v_partial *to =
        projector->sent +
        place_of(projector, rounds, block->range, block->range % layout->owners, i, count) + within;
    for (int64_t f = 0; f < block->width; f++) {
        to[f] = (struct v2v_partial){sum[f], sum[V2V_BLOCK + f]};
    }
}

/* The blocks of `rounds` of all listed views. */
static void project(struct v2v_projector *projector, const struct views *views,
                    struct v2v_part rounds)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct v2v_part blocks = blocks_of(projector, rounds);
    const int64_t slices = layout->slices;
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t b = blocks.first; b < blocks.first + blocks.count; b++) {
        const struct v2v_frequency_block *block = &projector->block[b];
        double *sum = (double *)(void *)v2v_projector_scratch(projector);
        float *slice = v2v_projector_scratch(projector) + 2 * V2V_BLOCK_FLOATS;
        v2v_block_split(slice, projector->slice_spectra + block->first, layout->slice_stride,
                        slices, block->width);
        for (int64_t i = 0; i < views->count; i++) {
            const float *otf = v2v_projector_otf(projector, b, view_at(projector, views, i));
            v2v_block_project(sum, otf, slice, slices);
            store(projector, sum, b, rounds, i, views->count);
        }
    }
}

/* This rank's numbers of the views: what the ranks sent, summed in their order and rounded. */
static void sum_up(struct v2v_projector *projector, struct v2v_part rounds, int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int rank = v2v_comm_rank(projector->comm), size = v2v_comm_size(projector->comm);
    const int64_t mine = projector->columns.first * layout->shape.ny;
#pragma omp parallel for schedule(static) collapse(2) num_threads(projector->threads)
    for (int64_t i = 0; i < count; i++) {
        for (int64_t j = rounds.first; j < rounds.first + rounds.count; j++) {
            const int64_t at = j * layout->owners + rank;
            const struct v2v_range *range = &projector->range[at];
            struct v2v_complex *to =
                projector->view_spectra + i * layout->view_stride + range->first - mine;
            const struct v2v_partial *from =
                projector->received + place_of(projector, rounds, at, 0, i, count);
            for (int64_t f = 0; f < range->count; f++) {
                struct v2v_partial sum = {0.0, 0.0};
                for (int r = 0; r < size; r++) {
                    sum.re += from[r * layout->slot + f].re;
                    sum.im += from[r * layout->slot + f].im;
                }
                to[f] = (struct v2v_complex){(float)sum.re, (float)sum.im};
            }
        }
    }
}

/* Partial sums to the ranks that own their columns. */
static void exchange_sums(struct v2v_projector *projector, struct v2v_part rounds, int64_t count)
{
    const int rank = v2v_comm_rank(projector->comm), size = v2v_comm_size(projector->comm);
    const int64_t slot = projector->layout.slot;
    for (int r = 0; r < size; r++) {
        projector->to[r] = (struct v2v_part){r * slot, numbers_of(projector, rounds, r, count)};
        projector->from[r] =
            (struct v2v_part){r * slot, numbers_of(projector, rounds, rank, count)};
    }
    v2v_par_alltoall(projector->comm, projector->received, projector->from, projector->sent,
                     projector->to, sizeof *projector->sent);
}

void v2v_projector_forward(struct v2v_projector *projector, float *views, const float *volume,
                           const int32_t *list, int64_t count, float scale)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct views wanted = {list, count};

    V2V_ASSERT(count >= 0 && count <= layout->views);
    v2v_fft_slabs_forward(v2v_projector_slice_fft(projector), projector->slice_spectra,
                          layout->slice_stride, volume, layout->slices);
    for (int64_t j = 0; j < layout->rounds;) {
        const struct v2v_part rounds = rounds_from(projector, j, count);
        project(projector, &wanted, rounds);
        if (layout->slot > 0) {
            exchange_sums(projector, rounds, count);
            sum_up(projector, rounds, count);
        }
        j += rounds.count;
    }
    v2v_fft_slabs_inverse(projector->together, views, transform_factor(projector, scale),
                          projector->view_spectra, layout->view_stride, count);
}

/* All ranks get the views' spectra of `rounds`, each from the rank that owns the columns. */
static void share_views(struct v2v_projector *projector, struct v2v_part rounds, int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int rank = v2v_comm_rank(projector->comm), size = v2v_comm_size(projector->comm);
    const int64_t mine = projector->columns.first * layout->shape.ny;
    struct v2v_complex *all = (struct v2v_complex *)(void *)projector->received;
    int64_t *offsets = projector->counts + size;
    for (int r = 0; r < size; r++) {
        projector->counts[r] = 2 * numbers_of(projector, rounds, r, count);
        offsets[r] = 2 * r * layout->slot;
    }
    for (int64_t j = rounds.first; j < rounds.first + rounds.count; j++) {
        const int64_t at = j * layout->owners + rank;
        const struct v2v_range *range = &projector->range[at];
        for (int64_t i = 0; i < count; i++) {
            memcpy(all + place_of(projector, rounds, at, rank, i, count),
                   projector->view_spectra + i * layout->view_stride + range->first - mine,
                   (size_t)range->count * sizeof *all);
        }
    }
    v2v_par_allgather_f32(projector->comm, &all->re, &all->re + offsets[rank], projector->counts,
                          offsets);
}

/* Where view i's numbers of a block are. */
static const struct v2v_complex *fetch(const struct v2v_projector *projector, int64_t b,
                                       struct v2v_part rounds, int64_t i, int64_t count)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct v2v_frequency_block *block = &projector->block[b];
    if (layout->slot == 0) {
        return projector->view_spectra + i * layout->view_stride + block->first;
    }
    const int64_t within = block->first - projector->range[block->range].first;
    const struct v2v_complex *all = (const struct v2v_complex *)(const void *)projector->received;
    return all + within +
           place_of(projector, rounds, block->range, block->range % layout->owners, i, count);
}

static void project_adjoint(struct v2v_projector *projector, const struct views *views,
                            struct v2v_part rounds)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct v2v_part blocks = blocks_of(projector, rounds);
    const int64_t slices = layout->slices;
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t b = blocks.first; b < blocks.first + blocks.count; b++) {
        const struct v2v_frequency_block *block = &projector->block[b];
        float *view = v2v_projector_scratch(projector);
        float *slice = view + 2 * V2V_BLOCK_FLOATS;
        memset(slice, 0, (size_t)(slices * V2V_BLOCK_FLOATS) * sizeof *slice);
        for (int64_t i = 0; i < views->count; i++) {
            const float *otf = v2v_projector_otf(projector, b, view_at(projector, views, i));
            v2v_block_split(view, fetch(projector, b, rounds, i, views->count), 0, 1, block->width);
            v2v_block_project_adjoint(slice, otf, view, slices);
        }
        v2v_block_merge(projector->slice_spectra + block->first, slice, layout->slice_stride,
                        slices, block->width);
    }
}

void v2v_projector_adjoint(struct v2v_projector *projector, float *volume, const float *views,
                           const int32_t *list, int64_t count, float scale)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const struct views wanted = {list, count};

    V2V_ASSERT(count >= 0 && count <= layout->views);
    v2v_fft_slabs_forward(projector->together, projector->view_spectra, layout->view_stride, views,
                          count);
    for (int64_t j = 0; j < layout->rounds;) {
        const struct v2v_part rounds = rounds_from(projector, j, count);
        if (layout->slot > 0) {
            share_views(projector, rounds, count);
        }
        project_adjoint(projector, &wanted, rounds);
        j += rounds.count;
    }
    v2v_fft_slabs_inverse(v2v_projector_slice_fft(projector), volume,
                          transform_factor(projector, scale), projector->slice_spectra,
                          layout->slice_stride, layout->slices);
}
