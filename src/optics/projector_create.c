#include "optics/projector_plan.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf.h"
#include <omp.h>
#include <string.h>

/* rows[before+1+after,nx] = the kernel's taps that are used, their columns wrapped around index 0;
 * zero elsewhere. */
static void wrap_columns(const struct v2v_projector *projector, float *rows, const float *kernel,
                         const struct v2v_psf_file *psf)
{
    const int64_t nx = projector->layout.shape.nx;
    const int64_t cy = v2v_psf_centre(psf->height), cx = v2v_psf_centre(psf->width);
    const int64_t before_y = v2v_kernel_before(psf->height, projector->height);
    const int64_t before_x = v2v_kernel_before(psf->width, projector->width);
    const int64_t after_y = v2v_kernel_after(psf->height, projector->height);
    const int64_t after_x = v2v_kernel_after(psf->width, projector->width);

    memset(rows, 0, (size_t)((before_y + 1 + after_y) * nx) * sizeof *rows);
    for (int64_t y = -before_y; y <= after_y; y++) {
        const float *from = kernel + (y + cy) * psf->width + cx;
        float *to = rows + (y + before_y) * nx;
        memcpy(to, from, (size_t)(after_x + 1) * sizeof *to);
        memcpy(to + nx - before_x, from - before_x, (size_t)before_x * sizeof *to);
    }
}

/* One transform for each slice of each view, cut into blocks. The slice spectra serve as scratch.
 * @param rows [thread,kernel rows,nx] */
static void compute_otfs(struct v2v_projector *projector, const struct v2v_psf_file *psf,
                         float *rows)
{
    const struct v2v_projector_layout *layout = &projector->layout;
    const int64_t first = projector->share.slices.first;
    const int64_t before = v2v_kernel_before(psf->height, projector->height);
    const int64_t count = before + 1 + v2v_kernel_after(psf->height, projector->height);
#pragma omp parallel num_threads(projector->threads)
    for (int64_t v = 0; v < psf->views; v++) {
#pragma omp for schedule(dynamic)
        for (int64_t z = 0; z < layout->slices; z++) {
            float *mine = rows + omp_get_thread_num() * count * layout->shape.nx;
            const int64_t slice = v * psf->slices + first + z;
            wrap_columns(projector, mine, psf->data + slice * psf->height * psf->width, psf);
            v2v_fft_slabs_local(v2v_projector_slice_fft(projector),
                                projector->slice_spectra + z * layout->slice_stride, mine, -before,
                                count);
        }
#pragma omp for schedule(static)
        for (int64_t b = 0; b < layout->blocks; b++) {
            const struct v2v_frequency_block *block = &projector->block[b];
            v2v_block_split(v2v_projector_otf(projector, b, v),
                            projector->slice_spectra + block->first, layout->slice_stride,
                            layout->slices, block->width);
        }
    }
}

static enum v2v_status take_memory(struct v2v_projector *projector, int ranks)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_projector_layout *layout = &projector->layout;
    const int64_t ranges = layout->rounds * layout->owners + 1;
    const int64_t exchanged = layout->owners * layout->slot;
    V2V_TRY(V2V_ALLOC(projector->otf, "projector.otf", layout->otf));
    V2V_TRY(V2V_ALLOC(projector->slice_spectra, "projector.spectra",
                      layout->slices * layout->slice_stride));
    V2V_TRY(V2V_ALLOC(projector->view_spectra, "projector.spectra",
                      layout->views * layout->view_stride));
    V2V_TRY(V2V_ALLOC(projector->scratch, "projector.block", projector->threads * layout->scratch));
    V2V_TRY(V2V_ALLOC(projector->range, "projector.cut", ranges));
    V2V_TRY(V2V_ALLOC(projector->block, "projector.cut", layout->blocks));
    V2V_TRY(V2V_ALLOC(projector->sent, "projector.exchange", exchanged));
    V2V_TRY(V2V_ALLOC(projector->received, "projector.exchange", exchanged));
    V2V_TRY(V2V_ALLOC(projector->to, "projector.exchange", ranks));
    V2V_TRY(V2V_ALLOC(projector->from, "projector.exchange", ranks));
    V2V_TRY(V2V_ALLOC(projector->counts, "projector.exchange", 2 * (int64_t)ranks));
    v2v_projector_cut(projector);
done:
    return rc;
}

/* Ranks hold the rows of views and, split by slabs, of volumes. */
static enum v2v_status create_slicing(struct v2v_projector *projector, int64_t slices)
{
    enum v2v_status rc = V2V_OK;
    const int ranks = v2v_comm_size(projector->comm);
    struct v2v_part *rows = NULL;
    V2V_TRY(V2V_ALLOC(rows, "projector.cut", ranks));
    for (int r = 0; r < ranks; r++) {
        rows[r] = v2v_par_part(projector->height, ranks, r);
    }
    V2V_TRY(v2v_slicing_create(&projector->slicing, projector->comm, slices, projector->height,
                               projector->width, rows));
done:
    v2v_mem_free(rows);
    return rc;
}

static enum v2v_status create_local(struct v2v_projector *projector, const struct v2v_psf_file *psf,
                                    enum v2v_beyond beyond, float **rows)
{
    enum v2v_status rc = V2V_OK;
    const int ranks = v2v_comm_size(projector->comm), rank = v2v_comm_rank(projector->comm);
    struct v2v_projector_layout *layout = &projector->layout;
    if (!v2v_projector_plan(layout, psf, projector->height, projector->width, beyond,
                            projector->split, ranks, rank)) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "projection of frames of %lld x %lld pixels is too large",
                         (long long)projector->height, (long long)projector->width));
    }
    V2V_TRY(take_memory(projector, ranks));
    V2V_TRY(create_slicing(projector, psf->slices));
    V2V_TRY(V2V_ALLOC(*rows, "projector.kernel",
                      v2v_mem_product(projector->threads, psf->height, layout->shape.nx)));
    if (layout->owners > 1) {
        V2V_TRY(v2v_fft_slabs_create(&projector->alone, &layout->shape, NULL));
    }
done:
    return rc;
}

enum v2v_status v2v_projector_create(struct v2v_projector **projector,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     enum v2v_split split, const struct v2v_comm *comm)
{
    return v2v_projector_create_beyond(projector, psf, height, width, V2V_BEYOND_ZERO, split, comm);
}

enum v2v_status v2v_projector_create_beyond(struct v2v_projector **projector,
                                            const struct v2v_psf_file *psf, int64_t height,
                                            int64_t width, enum v2v_beyond beyond,
                                            enum v2v_split split, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_projector *made = NULL;
    float *rows = NULL;
    const int ranks = v2v_comm_size(comm), rank = v2v_comm_rank(comm);

    V2V_ASSERT(height >= 1 && width >= 1);
    V2V_ASSERT(split != V2V_SPLIT_AUTO);
    *projector = NULL;
    rc = V2V_ALLOC(made, "projector", 1);
    if (rc == V2V_OK) {
        const struct v2v_part all_slices = {0, psf->slices}, all_rows = {0, height};
        const struct v2v_part my_slices = v2v_par_part(psf->slices, ranks, rank);
        const struct v2v_part my_rows = v2v_par_part(height, ranks, rank);
        made->comm = comm;
        made->split = split;
        made->height = height;
        made->width = width;
        made->threads = omp_get_max_threads();
        made->share.view_rows = my_rows;
        made->share.slices = split == V2V_SPLIT_SLICES ? my_slices : all_slices;
        made->share.rows = split == V2V_SPLIT_SLICES ? all_rows : my_rows;
        rc = create_local(made, psf, beyond, &rows);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_fft_slabs_create(&made->together, &made->layout.shape, comm));
    made->columns = v2v_fft_slabs_columns(made->together);
    compute_otfs(made, psf, rows);
    *projector = made;
    made = NULL;
done:
    v2v_mem_free(rows);
    v2v_projector_destroy(&made);
    return rc;
}

void v2v_projector_destroy(struct v2v_projector **projector)
{
    struct v2v_projector *old = *projector;
    if (old == NULL) {
        return;
    }
    void *memory[] = {old->otf,   old->slice_spectra, old->view_spectra, old->scratch,
                      old->range, old->block,         old->sent,         old->received,
                      old->to,    old->from,          old->counts};
    for (size_t i = 0; i < sizeof memory / sizeof *memory; i++) {
        v2v_mem_free(memory[i]);
    }
    v2v_fft_slabs_destroy(&old->alone);
    v2v_fft_slabs_destroy(&old->together);
    v2v_slicing_destroy(&old->slicing);
    v2v_mem_free(old);
    *projector = NULL;
}

float *v2v_projector_otf(const struct v2v_projector *projector, int64_t block, int64_t v)
{
    const int64_t one_view = projector->layout.slices * V2V_BLOCK_FLOATS;
    return projector->otf + (block * projector->layout.views + v) * one_view;
}

float *v2v_projector_scratch(const struct v2v_projector *projector)
{
    return projector->scratch + omp_get_thread_num() * projector->layout.scratch;
}
