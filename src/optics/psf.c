#include "v2v3d/optics/psf.h"

static double sum_of(const float *x, int64_t count)
{
    double sum = 0;
    for (int64_t i = 0; i < count; i++) {
        sum += x[i];
    }
    return sum;
}

enum v2v_status v2v_psf_read(struct v2v_psf_file *psf, const char *path, int normalize,
                             const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    V2V_TRY(v2v_psf_file_read(psf, path, comm));
    if (normalize == V2V_NORMALIZE_VIEW) {
        v2v_psf_normalize_views(psf);
    }
done:
    return rc;
}

void v2v_psf_normalize_views(struct v2v_psf_file *psf)
{
    const int64_t one_view = psf->slices * psf->height * psf->width;
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < psf->views; v++) {
        float *view = psf->data + v * one_view;
        const double sum = sum_of(view, one_view);
        for (int64_t i = 0; i < one_view && sum > 0; i++) {
            view[i] = (float)(view[i] / sum);
        }
    }
}

double v2v_psf_energy_mean(const struct v2v_psf_file *psf)
{
    return sum_of(psf->data, psf->slices * psf->height * psf->width) / (double)psf->slices;
}

double v2v_psf_light(const struct v2v_psf_file *psf)
{
    const double sum = sum_of(psf->data, psf->views * psf->slices * psf->height * psf->width);
    return sum > 0.0 ? sum / (double)psf->views : 1.0;
}
