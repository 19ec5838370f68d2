#include "optics/moments.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/psf_figures.h"
#include "v2v3d/optics/psf_fit.h"
#include <math.h>

enum v2v_status v2v_psf_compare(struct v2v_psf_likeness *likeness, const struct v2v_psf_file *a,
                                const struct v2v_psf_file *b)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = a->height * a->width, samples = a->slices * pixels;
    V2V_ASSERT(a->views == b->views && a->slices == b->slices && a->height == b->height &&
               a->width == b->width);
    *likeness = (struct v2v_psf_likeness){.views = a->views};
    V2V_TRY(V2V_ALLOC(likeness->correlation, "psf.likeness", a->views));
    V2V_TRY(V2V_ALLOC(likeness->centroid, "psf.likeness", a->views));
    for (int64_t v = 0; v < a->views; v++) {
        likeness->correlation[v] =
            v2v_psf_correlation(a->data + v * samples, b->data + v * samples, samples);
        for (int64_t i = v * a->slices; i < (v + 1) * a->slices; i++) {
            double p[3], q[3];
            v2v_slice_moments(p, a->data + i * pixels, a->height, a->width);
            v2v_slice_moments(q, b->data + i * pixels, b->height, b->width);
            if (p[0] > 0 && q[0] > 0) {
                const double apart = hypot(p[1] / p[0] - q[1] / q[0], p[2] / p[0] - q[2] / q[0]);
                likeness->centroid[v] = fmax(likeness->centroid[v], apart);
            }
        }
    }
done:
    if (rc != V2V_OK) {
        v2v_psf_likeness_fini(likeness);
    }
    return rc;
}

void v2v_psf_likeness_fini(struct v2v_psf_likeness *likeness)
{
    v2v_mem_free(likeness->correlation);
    v2v_mem_free(likeness->centroid);
    *likeness = (struct v2v_psf_likeness){0};
}
