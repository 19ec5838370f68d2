#include "v2v3d/eval/quality.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/optics/grouped.h"
#include "v2v3d/tensor/blind.h"
#include "v2v3d/tensor/statistics.h"

#include <math.h>

struct v2v_match v2v_match_of(float *scratch, const float *recorded, const float *projected,
                              int64_t height, int64_t width)
{
    struct v2v_match match = {0};
    const double sigma = v2v_noise_of_images(scratch, recorded, 1, height, width);
    int64_t seen = 0;
    for (int64_t i = 0; i < height * width; i++) {
        const int is_seen = recorded[i] != V2V_BLIND;
        const double y = is_seen ? (double)recorded[i] : 0.0;
        const double p = is_seen ? (double)projected[i] : 0.0;
        seen += is_seen;
        match.yy += y * y;
        match.yp += y * p;
        match.pp += p * p;
        match.y += y;
        match.p += p;
    }
    match.noise = sigma * sigma * (double)seen;
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
    v2v_structure_add(&sum->structure, &match->structure);
}

/* Where nothing was recorded both are 0, so that nothing is missed. */
static void darken_blind(float *recorded, float *projected, int64_t samples)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < samples; i++) {
        projected[i] = recorded[i] != V2V_BLIND ? projected[i] : 0.0f;
        recorded[i] = recorded[i] != V2V_BLIND ? recorded[i] : 0.0f;
    }
}

struct v2v_match v2v_match_views(struct v2v_match *of_view, float *scratch, float *recorded,
                                 float *projected, int64_t count, int64_t height, int64_t width)
{
    struct v2v_match all = {0};
    const int64_t pixels = height * width;
    for (int64_t v = 0; v < count; v++) {
        of_view[v] =
            v2v_match_of(scratch, recorded + v * pixels, projected + v * pixels, height, width);
    }
    darken_blind(recorded, projected, count * pixels);
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < count; v++) {
        of_view[v].structure =
            v2v_structure_of(recorded + v * pixels, projected + v * pixels, height, width);
    }
    for (int64_t v = 0; v < count; v++) {
        v2v_match_add(&all, &of_view[v]);
    }
    return all;
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

int64_t v2v_match_odd_view(double *times, const struct v2v_match *of_view, int64_t views)
{
    double oddest = 1.0;
    int64_t odd = -1;
    for (int64_t v = 0; v < views; v++) {
        struct v2v_structure others = {0};
        for (int64_t o = 0; o < views; o++) {
            if (o != v) {
                v2v_structure_add(&others, &of_view[o].structure);
            }
        }
        const double here = v2v_structure_brightness(&of_view[v].structure, &others);
        const double oddness = fmax(here, 1.0 / here);
        if (oddness > oddest) {
            oddest = oddness;
            *times = here;
            odd = v;
        }
    }
    return odd;
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

/* What the OTFs of views that are projected together may hold, bytes over all ranks. */
static const int64_t most_bytes = (int64_t)512 << 20;

/* Of the structure, from which on it is looked where the views lie. */
static const double worth_a_look = 0.03;

/* Local. */
static enum v2v_status find_displaced(double *displaced, const struct v2v_match *match,
                                      const float *recorded, const float *projected, int64_t count,
                                      int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    double *shift = NULL;
    for (int64_t v = 0; v < count; v++) {
        displaced[v] = NAN;
    }
    if (!(v2v_structure_missed(&match->structure) >= worth_a_look)) {
        return V2V_OK;
    }
    V2V_TRY(V2V_ALLOC(shift, "eval.shifts", 2 * count));
    V2V_TRY(v2v_structure_shifts(shift, recorded, projected, count, height, width));
    for (int64_t v = 0; v < count; v++) {
        displaced[v] = hypot(shift[2 * v], shift[2 * v + 1]);
    }
done:
    v2v_mem_free(shift);
    return rc;
}

enum v2v_status v2v_match_frame(struct v2v_match *match, struct v2v_match *of_view,
                                double *displaced, float *views, float *projected, int64_t count,
                                int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    float *scratch = NULL;
    *match = (struct v2v_match){0};
    V2V_TRY(V2V_ALLOC(scratch, "eval.views", v2v_mem_product(height, width, 1)));
    *match = v2v_match_views(of_view, scratch, views, projected, count, height, width);
    V2V_TRY(find_displaced(displaced, match, views, projected, count, height, width));
done:
    v2v_mem_free(scratch);
    return rc;
}

enum v2v_status v2v_match_project(float *projected, const struct v2v_psf_file *psf,
                                  const float *slices, int64_t height, int64_t width, float scale,
                                  const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_grouped *grouped = NULL;
    V2V_TRY(v2v_grouped_create(&grouped, psf, height, width, V2V_SPLIT_SLICES, most_bytes, comm));
    V2V_TRY(v2v_grouped_forward(grouped, projected, slices, scale));
done:
    v2v_grouped_destroy(&grouped);
    return rc;
}
