#include "method/richardson_lucy.h"

#include "v2v3d/tensor/blind.h"

/* Phase-space Richardson-Lucy: numerator A_v^T(recorded_v / A_v x), denominator A_v^T 1.
 * Lu et al., "Phase-space deconvolution for light field microscopy", Optics Express 27, 18131
 * (2019). */

/** ratio <- recorded / projected, in units of the mean view; 0 where the view is unlit, 1 where
 *  it is blind. */
static void divide(float *ratio, const float *recorded, const uint8_t *unlit, int64_t count,
                   float scale)
{
    float least = V2V_PROJECTION_FLOOR;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        const float above = recorded[i] > 0 && !unlit[i] ? recorded[i] * scale : 0;
        const float light = above / (ratio[i] > least ? ratio[i] : least);
        ratio[i] = recorded[i] != V2V_BLIND || unlit[i] ? light : 1;
    }
}

static void correct(struct v2v_richardson_lucy *self, const float *views,
                    const struct v2v_view_list *list, float scale)
{
    const int64_t v = list->view[0], here = v2v_richardson_lucy_pixels(self);
    const float *recorded = views + v * self->height * self->width;
    divide(self->ratio, recorded, self->unlit + v * here, here, scale);
    v2v_projector_adjoint(self->projector, self->numerator, self->ratio, list->view, 1, 1.0f);
}

static const struct v2v_richardson_lucy_variant variant = {
    .iterations = 10, .judged_every = 1, .start = 1.0, .correct = correct};

static const char *const keys[] = {"deconv.iterations", "deconv.stop", "deconv.weight", NULL};

const struct v2v_estimator_ops v2v_estimator_rld = {
    .name = "rld", .variant = &variant, .keys = keys, V2V_RICHARDSON_LUCY_OPS};
