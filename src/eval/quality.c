#include "v2v3d/eval/quality.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

/* Of pixels at the highest value: so many, and so many times those at the next one. */
enum { LEAST_SATURATED = 10, TIMES_NEXT = 2 };

struct v2v_match v2v_match_of(float *scratch, const float *recorded, const float *projected,
                              int64_t height, int64_t width)
{
    struct v2v_match match = {0};
    const double sigma = v2v_noise_of_images(scratch, recorded, 1, height, width);
    for (int64_t i = 0; i < height * width; i++) {
        const double y = (double)recorded[i], p = (double)projected[i];
        match.yy += y * y;
        match.yp += y * p;
        match.pp += p * p;
        match.y += y;
        match.p += p;
    }
    match.noise = sigma * sigma * (double)(height * width);
    return match;
}

void v2v_match_add(struct v2v_match *sum, const struct v2v_match *match)
{
    sum->yy += match->yy;
    sum->yp += match->yp;
    sum->pp += match->pp;
    sum->y += match->y;
    sum->p += match->p;
    sum->noise += match->noise;
}

double v2v_match_scale(const struct v2v_match *match)
{
    return match->pp > 0.0 ? match->yp / match->pp : 1.0;
}

static double squares_missed(const struct v2v_match *match, double scale)
{
    const double missed = match->yy - scale * (2.0 * match->yp - scale * match->pp);
    return missed < 0.0 ? 0.0 : missed; /* NaN stays */
}

double v2v_match_residual(const struct v2v_match *match, double scale)
{
    return match->yy > 0.0 ? sqrt(squares_missed(match, scale) / match->yy) : NAN;
}

double v2v_match_sigmas(const struct v2v_match *match, double scale)
{
    return match->noise > 0.0 ? sqrt(squares_missed(match, scale) / match->noise) : NAN;
}

double v2v_match_flux(const struct v2v_match *match)
{
    return match->y > 0.0 ? match->p / match->y : NAN;
}

int64_t v2v_saturated_pixels(const float *views, int64_t count)
{
    float highest = -INFINITY, next = -INFINITY;
    int64_t at_highest = 0, at_next = 0;
    for (int64_t i = 0; i < count; i++) {
        if (views[i] > highest) {
            next = highest;
            at_next = at_highest;
            highest = views[i];
            at_highest = 1;
        } else if (views[i] == highest) {
            at_highest++;
        } else if (views[i] > next) {
            next = views[i];
            at_next = 1;
        } else if (views[i] == next) {
            at_next++;
        }
    }
    return at_next > 0 && at_highest >= LEAST_SATURATED && at_highest / TIMES_NEXT >= at_next
               ? at_highest
               : 0;
}

double v2v_mean_of_known(const double *x, int64_t count, int64_t stride)
{
    double sum = 0.0;
    int64_t known = 0;
    for (int64_t i = 0; i < count; i++) {
        if (!isnan(x[i * stride])) {
            sum += x[i * stride];
            known++;
        }
    }
    return known > 0 ? sum / (double)known : NAN;
}

/** Collective(comm). @param psf of these views alone @param images [v+1,y,x]: scratch */
static enum v2v_status match_views(struct v2v_match *match, const struct v2v_psf_file *psf,
                                   const float *slices, const float *recorded, float *images,
                                   int64_t height, int64_t width, float scale,
                                   const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t views = psf->views, pixels = height * width;
    struct v2v_projector *projector = NULL;
    float *rows = NULL;
    v2v_watchdog_beat("views of the quality of a volume");
    V2V_TRY(v2v_projector_create(&projector, psf, height, width, V2V_SPLIT_SLICES, comm));
    const struct v2v_projector_share share = v2v_projector_share(projector);
    rc = V2V_ALLOC(rows, "eval.views", v2v_mem_product(views, share.view_rows.count, width));
    V2V_TRY(v2v_par_agree(comm, rc));
    v2v_projector_forward(projector, rows, slices, NULL, views, scale);
    v2v_projector_gather_views(projector, images, rows, views);
    for (int64_t v = 0; v < views; v++) {
        const struct v2v_match one = v2v_match_of(images + views * pixels, recorded + v * pixels,
                                                  images + v * pixels, height, width);
        v2v_match_add(match, &one);
    }
done:
    v2v_mem_free(rows);
    v2v_projector_destroy(&projector);
    return rc;
}

/* What a projector of several views may hold, bytes over all ranks, and of what a memory limit
 * leaves a rank. */
static const int64_t most_bytes = (int64_t)512 << 20;
static const double most_of_room = 0.5;

/** Views that are projected together, so that slices are transformed for all of them at once.
 *  Collective(comm). */
static int64_t views_together(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                              const struct v2v_comm *comm)
{
    struct v2v_psf_file some = *psf;
    const double most = fmin((double)most_bytes, most_of_room * (double)v2v_mem_room());
    while (some.views > 1 &&
           (double)v2v_projector_bytes(&some, height, width, V2V_SPLIT_SLICES, 1) > most) {
        some.views--;
    }
    int64_t fewer = psf->views - some.views;
    v2v_par_max_i64(comm, &fewer, 1); /* a rank may have less room */
    return psf->views - fewer;
}

enum v2v_status v2v_match_frame(struct v2v_match *match, const struct v2v_psf_file *psf,
                                const float *slices, const float *views, int64_t height,
                                int64_t width, float scale, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t pixels = height * width, kernels = psf->slices * psf->height * psf->width;
    const int64_t together = views_together(psf, height, width, comm);
    float *images = NULL;
    struct v2v_psf_file some = *psf;
    *match = (struct v2v_match){0};
    rc = V2V_ALLOC(images, "eval.views", v2v_mem_product(together + 1, pixels, 1));
    V2V_TRY(v2v_par_agree(comm, rc));
    for (int64_t v = 0; v < psf->views; v += together) {
        some.views = v2v_smaller(together, psf->views - v);
        some.data = psf->data + v * kernels;
        V2V_TRY(match_views(match, &some, slices, views + v * pixels, images, height, width, scale,
                            comm));
    }
done:
    v2v_mem_free(images);
    return rc;
}
