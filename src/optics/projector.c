#include "v2v3d/optics/projector.h"
#include "optics/sizes.h"
#include "optics/spectrum_block.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/par/comm.h"
#include <omp.h>
#include <string.h>

/* Sizes of everything that a projector holds; one place, so that v2v_projector_bytes can't drift
 * from v2v_projector_create. */
struct layout {
    int64_t ny, nx;        /* transform size */
    int64_t blocks;        /* of V2V_BLOCK frequencies; the last one is filled up with zeros */
    int64_t stride;        /* from spectrum to spectrum, complex numbers */
    int64_t image;         /* from padded image to padded image, floats */
    int64_t scratch;       /* of one thread: a block of all slices and of one view, floats */
    int64_t otf;           /* all OTFs of this rank, floats */
    int64_t slice_spectra; /* complex numbers */
    int64_t view_spectra;  /* complex numbers */
};

struct v2v_projector {
    struct layout layout;
    int64_t views;
    int64_t height, width;
    struct v2v_part slices; /* of this rank */
    int threads;
    float scale;
    const struct v2v_comm *comm; /* borrowed */
    struct v2v_fft2 *fft;
    float *otf;                        /* [block,v,z,2,V2V_BLOCK]: read once, front to back */
    struct v2v_complex *slice_spectra; /* [z,stride] */
    struct v2v_complex *view_spectra;  /* [v,stride] */
    float *image;                      /* [thread,image] */
    float *scratch;                    /* [thread,scratch] */
};

/* How far a kernel of K pixels reaches before and after its centre. Two pixels of a frame of
 * `size` pixels lie at most size-1 apart, so taps beyond that are never used. */
static int64_t reach_before(int64_t kernel, int64_t size)
{
    return v2v_smaller(v2v_psf_centre(kernel), size - 1);
}

static int64_t reach_after(int64_t kernel, int64_t size)
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
    const int64_t before = reach_before(kernel, size), after = reach_after(kernel, size);
    return v2v_fft_good_size(size + (before > after ? before : after));
}

/* 0 when a size leaves int64_t. */
static int layout_plan(struct layout *layout, const struct v2v_psf_file *psf, int64_t height,
                       int64_t width, int64_t slices)
{
    if (height > INT32_MAX / 4 || width > INT32_MAX / 4) {
        return 0; /* FFTW counts in int */
    }
    layout->ny = transform_size(height, psf->height);
    layout->nx = transform_size(width, psf->width);
    layout->stride = v2v_round_up(layout->ny * (layout->nx / 2 + 1), V2V_BLOCK);
    layout->blocks = layout->stride / V2V_BLOCK;
    layout->image = v2v_round_up(layout->ny * layout->nx, 64 / (int64_t)sizeof(float));
    layout->scratch = v2v_mem_product(slices + 1, V2V_BLOCK_FLOATS, 1);
    layout->slice_spectra = v2v_mem_product(slices, layout->stride, 1);
    layout->view_spectra = v2v_mem_product(psf->views, layout->stride, 1);
    layout->otf = v2v_mem_product(v2v_mem_product(psf->views, slices, 2), layout->stride, 1);
    return layout->scratch >= 0 && layout->slice_spectra >= 0 && layout->view_spectra >= 0 &&
           layout->otf >= 0;
}

int64_t v2v_projector_bytes(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                            int ranks)
{
    struct layout layout;
    const struct v2v_part fullest = v2v_par_part(psf->slices, ranks, 0);
    if (!layout_plan(&layout, psf, height, width, fullest.count)) {
        return INT64_MAX;
    }
    const int64_t float_bytes = (int64_t)sizeof(float);
    return (layout.otf + omp_get_max_threads() * (layout.image + layout.scratch)) * float_bytes +
           (layout.slice_spectra + layout.view_spectra) * (int64_t)sizeof(struct v2v_complex) +
           (int64_t)sizeof(struct v2v_projector);
}

/* image[ny,nx] = taps around index 0, wrapped; zero elsewhere. */
static void embed_kernel(const struct v2v_projector *projector, float *image, const float *kernel,
                         int64_t kernel_height, int64_t kernel_width)
{
    const int64_t ny = projector->layout.ny, nx = projector->layout.nx;
    const int64_t cy = v2v_psf_centre(kernel_height), cx = v2v_psf_centre(kernel_width);
    const int64_t before_y = reach_before(kernel_height, projector->height);
    const int64_t before_x = reach_before(kernel_width, projector->width);
    const int64_t after_y = reach_after(kernel_height, projector->height);
    const int64_t after_x = reach_after(kernel_width, projector->width);

    memset(image, 0, (size_t)(ny * nx) * sizeof *image);
    for (int64_t y = -before_y; y <= after_y; y++) {
        const float *from = kernel + (y + cy) * kernel_width + cx;
        float *to = image + (y < 0 ? y + ny : y) * nx;
        memcpy(to, from, (size_t)(after_x + 1) * sizeof *to);
        memcpy(to + nx - before_x, from - before_x, (size_t)before_x * sizeof *to);
    }
}

static float *otf_at(const struct v2v_projector *projector, int64_t block, int64_t v)
{
    const int64_t one_view = projector->slices.count * V2V_BLOCK_FLOATS;
    return projector->otf + (block * projector->views + v) * one_view;
}

static float *thread_image(const struct v2v_projector *projector)
{
    return projector->image + omp_get_thread_num() * projector->layout.image;
}

static float *thread_scratch(const struct v2v_projector *projector)
{
    return projector->scratch + omp_get_thread_num() * projector->layout.scratch;
}

/* One transform for each slice of each view, cut into blocks. The slice spectra serve as scratch:
 * one for each z, so that threads share none. */
static void compute_otfs(struct v2v_projector *projector, const struct v2v_psf_file *psf)
{
    const struct layout *layout = &projector->layout;
#pragma omp parallel for schedule(dynamic) num_threads(projector->threads)
    for (int64_t z = 0; z < projector->slices.count; z++) {
        float *image = thread_image(projector);
        struct v2v_complex *spectrum = projector->slice_spectra + z * layout->stride;
        for (int64_t v = 0; v < psf->views; v++) {
            const int64_t slice = v * psf->slices + projector->slices.first + z;
            embed_kernel(projector, image, psf->data + slice * psf->height * psf->width,
                         psf->height, psf->width);
            v2v_fft2_forward(projector->fft, spectrum, image);
            for (int64_t block = 0; block < layout->blocks; block++) {
                v2v_block_split(otf_at(projector, block, v) + z * V2V_BLOCK_FLOATS,
                                spectrum + block * V2V_BLOCK, layout->stride, 1);
            }
        }
    }
}

static enum v2v_status create_local(struct v2v_projector *projector, const struct v2v_psf_file *psf,
                                    int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    struct layout *layout = &projector->layout;

    projector->views = psf->views;
    projector->height = height;
    projector->width = width;
    projector->scale = 1.0f;
    projector->threads = omp_get_max_threads();
    if (!layout_plan(layout, psf, height, width, projector->slices.count)) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "projection of frames of %lld x %lld pixels is too large",
                         (long long)height, (long long)width));
    }
    V2V_TRY(v2v_fft2_create(&projector->fft, layout->ny, layout->nx));
    V2V_TRY(V2V_ALLOC(projector->otf, "projector.otf", layout->otf));
    V2V_TRY(V2V_ALLOC(projector->slice_spectra, "projector.spectra", layout->slice_spectra));
    V2V_TRY(V2V_ALLOC(projector->view_spectra, "projector.spectra", layout->view_spectra));
    V2V_TRY(V2V_ALLOC(projector->image, "projector.image", projector->threads * layout->image));
    V2V_TRY(V2V_ALLOC(projector->scratch, "projector.block", projector->threads * layout->scratch));
    compute_otfs(projector, psf);
done:
    return rc;
}

enum v2v_status v2v_projector_create(struct v2v_projector **projector,
                                     const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                     const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;

    V2V_ASSERT(height >= 1 && width >= 1);
    rc = V2V_ALLOC(*projector, "projector", 1);
    if (rc == V2V_OK) {
        (*projector)->comm = comm;
        (*projector)->slices = v2v_par_part(psf->slices, v2v_comm_size(comm), v2v_comm_rank(comm));
        rc = create_local(*projector, psf, height, width);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
done:
    if (rc != V2V_OK) {
        v2v_projector_destroy(projector);
    }
    return rc;
}

void v2v_projector_destroy(struct v2v_projector **projector)
{
    if (*projector == NULL) {
        return;
    }
    v2v_mem_free((*projector)->scratch);
    v2v_mem_free((*projector)->image);
    v2v_mem_free((*projector)->view_spectra);
    v2v_mem_free((*projector)->slice_spectra);
    v2v_mem_free((*projector)->otf);
    v2v_fft2_destroy(&(*projector)->fft);
    v2v_mem_free(*projector);
    *projector = NULL;
}

struct v2v_part v2v_projector_slices(const struct v2v_projector *projector)
{
    return projector->slices;
}

void v2v_projector_set_scale(struct v2v_projector *projector, float scale)
{
    projector->scale = scale;
}

/* spectra[i] = transforms of n frames, padded with zeros. */
static void transform_frames(struct v2v_projector *projector, struct v2v_complex *spectra,
                             const float *frames, int64_t n)
{
    const int64_t height = projector->height, width = projector->width;
    const int64_t ny = projector->layout.ny, nx = projector->layout.nx;
#pragma omp parallel for schedule(dynamic) num_threads(projector->threads)
    for (int64_t i = 0; i < n; i++) {
        float *image = thread_image(projector);
        const float *frame = frames + i * height * width;
        for (int64_t y = 0; y < height; y++) {
            memcpy(image + y * nx, frame + y * width, (size_t)width * sizeof *image);
            memset(image + y * nx + width, 0, (size_t)(nx - width) * sizeof *image);
        }
        memset(image + height * nx, 0, (size_t)((ny - height) * nx) * sizeof *image);
        v2v_fft2_forward(projector->fft, spectra + i * projector->layout.stride, image);
    }
}

/* frames[i] = scale * corner of the inverse transforms; the spectra are destroyed. */
static void restore_frames(struct v2v_projector *projector, float *frames,
                           struct v2v_complex *spectra, int64_t n)
{
    const int64_t height = projector->height, width = projector->width;
    const int64_t ny = projector->layout.ny, nx = projector->layout.nx;
    const float factor = (float)((double)projector->scale / (double)(ny * nx));
#pragma omp parallel for schedule(dynamic) num_threads(projector->threads)
    for (int64_t i = 0; i < n; i++) {
        float *image = thread_image(projector);
        float *frame = frames + i * height * width;
        v2v_fft2_inverse(projector->fft, image, spectra + i * projector->layout.stride);
        for (int64_t y = 0; y < height; y++) {
            for (int64_t x = 0; x < width; x++) {
                frame[y * width + x] = factor * image[y * nx + x];
            }
        }
    }
}

static int64_t view_at(const struct v2v_projector *projector, const int32_t *list, int64_t i)
{
    const int64_t v = list == NULL ? i : list[i];
    V2V_ASSERT(v >= 0 && v < projector->views);
    return v;
}

void v2v_projector_forward(struct v2v_projector *projector, float *views, const float *volume,
                           const int32_t *list, int64_t count)
{
    const int64_t slices = projector->slices.count, stride = projector->layout.stride;

    V2V_ASSERT(count >= 0 && count <= projector->views);
    transform_frames(projector, projector->slice_spectra, volume, slices);
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t block = 0; block < projector->layout.blocks; block++) {
        float *slice = thread_scratch(projector);
        float *view = slice + slices * V2V_BLOCK_FLOATS;
        v2v_block_split(slice, projector->slice_spectra + block * V2V_BLOCK, stride, slices);
        for (int64_t i = 0; i < count; i++) {
            const float *otf = otf_at(projector, block, view_at(projector, list, i));
            v2v_block_project(view, otf, slice, slices);
            v2v_block_merge(projector->view_spectra + i * stride + block * V2V_BLOCK, view, stride,
                            1);
        }
    }
    restore_frames(projector, views, projector->view_spectra, count);
    if (v2v_comm_size(projector->comm) > 1) {
        v2v_par_sum_f32(projector->comm, views, count * projector->height * projector->width);
    }
}

void v2v_projector_adjoint(struct v2v_projector *projector, float *volume, const float *views,
                           const int32_t *list, int64_t count)
{
    const int64_t slices = projector->slices.count, stride = projector->layout.stride;

    V2V_ASSERT(count >= 0 && count <= projector->views);
    transform_frames(projector, projector->view_spectra, views, count);
#pragma omp parallel for schedule(static) num_threads(projector->threads)
    for (int64_t block = 0; block < projector->layout.blocks; block++) {
        float *slice = thread_scratch(projector);
        float *view = slice + slices * V2V_BLOCK_FLOATS;
        memset(slice, 0, (size_t)(slices * V2V_BLOCK_FLOATS) * sizeof *slice);
        for (int64_t i = 0; i < count; i++) {
            const float *otf = otf_at(projector, block, view_at(projector, list, i));
            v2v_block_split(view, projector->view_spectra + i * stride + block * V2V_BLOCK, stride,
                            1);
            v2v_block_project_adjoint(slice, otf, view, slices);
        }
        v2v_block_merge(projector->slice_spectra + block * V2V_BLOCK, slice, stride, slices);
    }
    restore_frames(projector, volume, projector->slice_spectra, slices);
}
