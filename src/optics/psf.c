#include "v2v3d/optics/psf.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/hot_pixels.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>
#include <string.h>

static double sum_of(const float *x, int64_t count)
{
    double sum = 0;
    for (int64_t i = 0; i < count; i++) {
        sum += x[i];
    }
    return sum;
}

/* A brightest view's PSFs sum to so many times a darkest one's: sets differ by 1.15 at most, but
 * where they carry what each view gets of the light. */
static const double uneven = 2.0;

/* Rank-0, before they are normalised. */
static void warn_of_sums(const struct v2v_psf_file *psf, const char *path)
{
    const int64_t samples = psf->slices * psf->height * psf->width;
    double least = INFINITY, most = 0.0;
    for (int64_t v = 0; v < psf->views; v++) {
        const double sum = v2v_sum(psf->data + v * samples, samples);
        least = fmin(least, sum > 0.0 ? sum : INFINITY);
        most = fmax(most, sum);
    }
    if (most > uneven * least) {
        v2v_log(V2V_LOG_WARNING,
                "%s: PSFs of some views sum to %.3g times those of others, which is taken out: if "
                "views are so bright, --normalize none",
                path, most / least);
    }
}

enum v2v_status v2v_psf_read(struct v2v_psf_file *psf, const char *path, const char *without,
                             int normalize, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_psf_file_read(psf, path, without, comm));
    if (normalize == V2V_NORMALIZE_VIEW) {
        if (v2v_comm_rank(comm) == 0) {
            warn_of_sums(psf, path);
        }
        v2v_psf_normalize_views(psf);
    }
done:
    return rc;
}

/* Parts of the set, of `samples` each. */
static void normalize(struct v2v_psf_file *psf, int64_t parts, int64_t samples)
{
#pragma omp parallel for schedule(static)
    for (int64_t part = 0; part < parts; part++) {
        float *x = psf->data + part * samples;
        const double sum = sum_of(x, samples);
        for (int64_t i = 0; i < samples && sum > 0; i++) {
            x[i] = (float)(x[i] / sum);
        }
    }
}

void v2v_psf_normalize_views(struct v2v_psf_file *psf)
{
    normalize(psf, psf->views, psf->slices * psf->height * psf->width);
}

void v2v_psf_normalize_slices(struct v2v_psf_file *psf)
{
    normalize(psf, psf->views * psf->slices, psf->height * psf->width);
}

enum v2v_status v2v_psf_positive(struct v2v_psf_file *copy, const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = psf->height * psf->width, kernels = psf->views * psf->slices;
    *copy = *psf;
    copy->data = NULL;
    V2V_TRY(V2V_ALLOC(copy->data, "optics.psf", v2v_mem_product(kernels, pixels, 1)));
#pragma omp parallel for schedule(static)
    for (int64_t k = 0; k < kernels; k++) {
        const float *from = psf->data + k * pixels;
        float *to = copy->data + k * pixels;
        double sum = 0.0, positive = 0.0;
        for (int64_t i = 0; i < pixels; i++) {
            sum += (double)from[i];
            positive += from[i] > 0.0f ? (double)from[i] : 0.0;
        }
        const double scale = sum > 0.0 ? sum / positive : 0.0;
        for (int64_t i = 0; i < pixels; i++) {
            to[i] = from[i] > 0.0f ? (float)(scale * (double)from[i]) : 0.0f;
        }
    }
done:
    return rc;
}

double v2v_psf_energy_mean(const struct v2v_psf_file *psf)
{
    return sum_of(psf->data, psf->slices * psf->height * psf->width) / (double)psf->slices;
}

double v2v_psf_light(const struct v2v_psf_file *psf)
{
    const double sum = v2v_sum(psf->data, psf->views * psf->slices * psf->height * psf->width);
    return sum > 0.0 ? sum / (double)psf->views : 1.0;
}

double v2v_psf_voxel_noise(const struct v2v_psf_file *psf)
{
    const int64_t samples = psf->views * psf->slices * psf->height * psf->width;
    return sqrt(v2v_sum_of_squares(psf->data, samples) / (double)psf->slices);
}

double v2v_psf_sharpness(const struct v2v_psf_file *psf)
{
    const int64_t pixels = psf->height * psf->width;
    double most = 0.0;
#pragma omp parallel for schedule(static) reduction(max : most)
    for (int64_t i = 0; i < psf->views * psf->slices; i++) {
        most = fmax(most, v2v_sharpness_of_image(psf->data + i * pixels, psf->height, psf->width));
    }
    return most;
}
