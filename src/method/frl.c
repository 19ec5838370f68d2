#include "method/richardson_lucy.h"

#include "v2v3d/tensor/blind.h"

/* Fast Richardson-Lucy: numerator A_v^T recorded_v, denominator A_v^T A_v x. The ratio is taken of
 * back-projections, which are smooth, and not of pixels: noise is not divided by dim projections,
 * so that negative samples may count as they are and leave no pedestal of clipped noise. A negative
 * numerator counts as 0: the voxel shrinks by 1 - w; at 0 it would stay there for good. What the
 * 2pSAM pipeline does by default; the factor is that of Daube-Witherspoon and Muehllehner, "An
 * iterative image space reconstruction algorithm suitable for volume ECT", IEEE Trans. Med. Imaging
 * 5, 61 (1986), of one view at a time. An iteration takes one back-projection a view more than
 * Richardson-Lucy. */

/* Both images are 0 where the view is unlit, and the same where it is blind: numerator and
 * denominator see the same pixels. */
static void correct(struct v2v_richardson_lucy *self, const float *views,
                    const struct v2v_view_list *list, float scale)
{
    const float least = V2V_PROJECTION_FLOOR;
    const int64_t v = list->view[0], count = v2v_richardson_lucy_pixels(self);
    const float *recorded = views + v * self->height * self->width;
    const uint8_t *unlit = self->unlit + v * count;
    float *image = self->ratio;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        image[i] = unlit[i] ? 0 : image[i] > least ? image[i] : least;
    }
    v2v_projector_adjoint(self->projector, self->denominator, image, list->view, 1, 1.0f);
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        const float light = recorded[i] != V2V_BLIND ? recorded[i] * scale : image[i];
        image[i] = unlit[i] ? 0 : light;
    }
    v2v_projector_adjoint(self->projector, self->numerator, image, list->view, 1, 1.0f);
    const int64_t voxels = self->share.slices.count * self->share.rows.count * self->width;
    float *numerator = self->numerator;
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < voxels; i++) {
        numerator[i] = numerator[i] > 0 ? numerator[i] : 0;
    }
}

static const struct v2v_richardson_lucy_variant variant = {
    .iterations = 10, .has_denominator = 1, .judged_every = 1, .start = 1.0, .correct = correct};

static const char *const keys[] = {"deconv.iterations", "deconv.stop", "deconv.weight", NULL};

const struct v2v_estimator_ops v2v_estimator_frl = {
    .name = "frl", .variant = &variant, .keys = keys, V2V_RICHARDSON_LUCY_OPS};
