#include "v2v3d/fft/fft2.h"
#include "v2v3d/base/memory.h"
#include <fftw3.h>
#include <limits.h>

struct v2v_fft2 {
    int64_t ny, nx;
    fftwf_plan forward, inverse;
};

static int has_small_factors_only(int64_t n)
{
    static const int factors[] = {2, 3, 5, 7};
    for (size_t i = 0; i < sizeof factors / sizeof factors[0]; i++) {
        while (n % factors[i] == 0) {
            n /= factors[i];
        }
    }
    return n == 1;
}

int64_t v2v_fft_good_size(int64_t n)
{
    V2V_ASSERT(n <= INT64_MAX / 4); /* the next power of two is in range */
    int64_t even = n <= 2 ? 2 : n + n % 2;
    while (!has_small_factors_only(even)) {
        even += 2;
    }
    return even;
}

enum v2v_status v2v_fft2_create(struct v2v_fft2 **fft, int64_t ny, int64_t nx)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fft2 *created = NULL;
    float *image = NULL;
    struct v2v_complex *spectrum = NULL;

    V2V_ASSERT(ny >= 1 && nx >= 1 && ny <= INT_MAX && nx <= INT_MAX);
    *fft = NULL;
    V2V_TRY(V2V_ALLOC(created, "fft.plan", 1));
    /* FFTW_ESTIMATE doesn't touch the arrays; it reads their alignment, which later ones share. */
    V2V_TRY(V2V_ALLOC(image, "fft.plan", v2v_mem_product(ny, nx, 1)));
    V2V_TRY(V2V_ALLOC(spectrum, "fft.plan", v2v_mem_product(ny, nx / 2 + 1, 1)));
    created->ny = ny;
    created->nx = nx;
    created->forward =
        fftwf_plan_dft_r2c_2d((int)ny, (int)nx, image, (fftwf_complex *)(void *)spectrum,
                              FFTW_ESTIMATE | FFTW_PRESERVE_INPUT);
    created->inverse = fftwf_plan_dft_c2r_2d((int)ny, (int)nx, (fftwf_complex *)(void *)spectrum,
                                             image, FFTW_ESTIMATE);
    if (created->forward == NULL || created->inverse == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "no room to plan transforms of %lld x %lld pixels",
                         (long long)ny, (long long)nx));
    }
    *fft = created;
    created = NULL;
done:
    v2v_mem_free(spectrum);
    v2v_mem_free(image);
    v2v_fft2_destroy(&created);
    return rc;
}

void v2v_fft2_destroy(struct v2v_fft2 **fft)
{
    if (*fft == NULL) {
        return;
    }
    if ((*fft)->forward != NULL) {
        fftwf_destroy_plan((*fft)->forward);
    }
    if ((*fft)->inverse != NULL) {
        fftwf_destroy_plan((*fft)->inverse);
    }
    v2v_mem_free(*fft);
    *fft = NULL;
}

/* A plan may be run on other arrays than its own when they are aligned alike. */
static int is_aligned(const void *array)
{
    return (uintptr_t)array % 64 == 0;
}

void v2v_fft2_forward(const struct v2v_fft2 *fft, struct v2v_complex *spectrum, float *image)
{
    V2V_ASSERT(is_aligned(spectrum) && is_aligned(image));
    fftwf_execute_dft_r2c(fft->forward, image, (fftwf_complex *)(void *)spectrum);
}

void v2v_fft2_inverse(const struct v2v_fft2 *fft, float *image, struct v2v_complex *spectrum)
{
    V2V_ASSERT(is_aligned(spectrum) && is_aligned(image));
    fftwf_execute_dft_c2r(fft->inverse, (fftwf_complex *)(void *)spectrum, image);
}
