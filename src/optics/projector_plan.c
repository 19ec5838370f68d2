#include "optics/projector_plan.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include <omp.h>

/* Partial sums that a rank sends in one round, at most, bytes, unless one column has more: it holds
 * as much again of what it receives. */
enum { ROUND = 8 << 20 };

int64_t v2v_kernel_before(int64_t kernel, int64_t size)
{
    return v2v_smaller(v2v_psf_centre(kernel), size - 1);
}

int64_t v2v_kernel_after(int64_t kernel, int64_t size)
{
    return v2v_smaller(kernel - 1 - v2v_psf_centre(kernel), size - 1);
}

/* The smallest transform of one axis. The taps h[e], e = -before .. after, are stored with their
 * centre at index 0 modulo n; the transforms apply the circulant matrix
 * C[i,j] = sum of h[e] over e = i-j modulo n. The operator is C's corner i,j < size, and all is
 * right, for it and for its transpose alike, when that corner holds h[i-j] and nothing else: no
 * e != d with e = d modulo n for any d = -(size-1) .. size-1. The least distances of such pairs are
 * after + size-1 and before + size-1, so n >= size + max(before, after) is enough; one pixel less
 * wraps the outermost tap into the far corner. A linear convolution would take size + K - 1. */
static int64_t transform_size(int64_t size, int64_t kernel)
{
    const int64_t before = v2v_kernel_before(kernel, size), after = v2v_kernel_after(kernel, size);
    return v2v_fft_good_size(size + v2v_larger(before, after));
}

/* Columns that round `round` takes of the owner's `count`. */
static int64_t columns_of_round(const struct v2v_projector_layout *layout, int64_t count,
                                int64_t round)
{
    return v2v_within(count - round * layout->step, 0, layout->step);
}

/* Columns of the spectra here that an owner has. */
static struct v2v_part owned(const struct v2v_projector_layout *layout, int64_t owner)
{
    const int64_t columns = layout->slice_numbers / layout->shape.ny;
    return v2v_par_part(columns, layout->owners, owner);
}

/* Rounds, owners and blocks. */
static void plan_rounds(struct v2v_projector_layout *layout, enum v2v_split split, int ranks)
{
    const int64_t ny = layout->shape.ny;
    const int64_t column = layout->views * ny * (int64_t)sizeof(struct v2v_partial);
    const int is_summed = split == V2V_SPLIT_SLICES && ranks > 1;
    layout->owners = is_summed ? ranks : 1;
    const int64_t most = owned(layout, 0).count;
    layout->step = is_summed ? v2v_within(ROUND / (column * ranks), 1, most) : most;
    layout->rounds = layout->step > 0 ? (most + layout->step - 1) / layout->step : 1;
    layout->slot = is_summed ? layout->step * ny * layout->views : 0;
    layout->blocks = 0;
    for (int64_t owner = 0; owner < layout->owners; owner++) {
        const int64_t columns = owned(layout, owner).count;
        for (int64_t round = 0; round < layout->rounds; round++) {
            layout->blocks += v2v_parts(columns_of_round(layout, columns, round) * ny, V2V_BLOCK);
        }
    }
}

int v2v_projector_plan(struct v2v_projector_layout *layout, const struct v2v_psf_file *psf,
                       int64_t height, int64_t width, enum v2v_beyond beyond, enum v2v_split split,
                       int ranks, int rank)
{
    const int is_periodic = beyond == V2V_BEYOND_PERIODIC;
    if (height > INT32_MAX / 4 || width > INT32_MAX / 4) {
        return 0;
    }
    *layout = (struct v2v_projector_layout){
        .shape = {height, width, is_periodic ? height : transform_size(height, psf->height),
                  is_periodic ? width : transform_size(width, psf->width),
                  v2v_larger(psf->views, psf->slices), split == V2V_SPLIT_SLABS_FFTW3_MPI},
        .views = psf->views,
        .slices =
            split == V2V_SPLIT_SLICES ? v2v_par_part(psf->slices, ranks, rank).count : psf->slices};
    if (v2v_fft_slabs_bytes(&layout->shape, ranks) < 0) {
        return 0;
    }
    const int64_t ny = layout->shape.ny, half = layout->shape.nx / 2 + 1;
    layout->half = half;
    layout->view_numbers = v2v_par_part(half, ranks, rank).count * ny;
    layout->slice_numbers = split == V2V_SPLIT_SLICES ? half * ny : layout->view_numbers;
    layout->slice_stride = v2v_round_up(layout->slice_numbers, 8);
    layout->view_stride = v2v_round_up(layout->view_numbers, 8);
    plan_rounds(layout, split, ranks);
    /* The view's block is a sum in double precision on the way there. */
    layout->scratch = v2v_mem_product(layout->slices + 2, V2V_BLOCK_FLOATS, 1);
    layout->otf = v2v_mem_product(v2v_mem_product(psf->views, layout->slices, layout->blocks),
                                  V2V_BLOCK_FLOATS, 1);
    return layout->scratch >= 0 && layout->otf >= 0 &&
           v2v_mem_product(layout->slices, layout->slice_stride, 16) >= 0 &&
           v2v_mem_product(layout->views, layout->view_stride, 16) >= 0 &&
           v2v_mem_product(layout->owners, layout->slot, 32) >= 0;
}

void v2v_projector_cut(struct v2v_projector *projector)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int64_t ny = layout->shape.ny;
    int64_t blocks = 0, range = 0;
    for (int64_t round = 0; round < layout->rounds; round++) {
        for (int64_t owner = 0; owner < layout->owners; owner++, range++) {
            const struct v2v_part columns = owned(layout, owner);
            const int64_t count = columns_of_round(layout, columns.count, round) * ny;
            const int64_t first = (columns.first + round * layout->step) * ny;
            projector->range[range] = (struct v2v_range){first, count, blocks};
            for (int64_t f = 0; f < count; f += V2V_BLOCK) {
                projector->block[blocks++] = (struct v2v_frequency_block){
                    range, first + f, v2v_smaller(count - f, V2V_BLOCK)};
            }
        }
    }
    projector->range[range] = (struct v2v_range){0, 0, blocks};
}

int64_t v2v_projector_bytes(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                            enum v2v_split split, int ranks)
{
    return v2v_projector_bytes_beyond(psf, height, width, V2V_BEYOND_ZERO, split, ranks);
}

int64_t v2v_projector_bytes_beyond(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                   enum v2v_beyond beyond, enum v2v_split split, int ranks)
{
    struct v2v_projector_layout layout;
    if (!v2v_projector_plan(&layout, psf, height, width, beyond, split, ranks, 0)) {
        return INT64_MAX;
    }
    const int64_t float_bytes = (int64_t)sizeof(float);
    const int64_t spectra = layout.slices * layout.slice_stride + layout.views * layout.view_stride;
    int64_t bytes = (layout.otf + omp_get_max_threads() * layout.scratch) * float_bytes +
                    spectra * (int64_t)sizeof(struct v2v_complex) +
                    2 * layout.owners * layout.slot * (int64_t)sizeof(struct v2v_partial) +
                    layout.blocks * (int64_t)sizeof(struct v2v_frequency_block) +
                    (layout.rounds * layout.owners + 1) * (int64_t)sizeof(struct v2v_range) +
                    ranks * 2 * (int64_t)(sizeof(struct v2v_part) + sizeof(int64_t)) +
                    (int64_t)sizeof(struct v2v_projector) +
                    v2v_fft_slabs_bytes(&layout.shape, ranks);
    if (layout.owners > 1) {
        bytes += v2v_fft_slabs_bytes(&layout.shape, 1);
    }
    return bytes;
}
