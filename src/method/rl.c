#include "method/richardson_lucy.h"

#include "v2v3d/tensor/blind.h"

/* Richardson-Lucy: A^T((y + b) / (A x + b)) over A^T 1, sums over all views, whose projections
 * share the transforms of the slices: with V views and Z slices an iteration takes 2 (V + Z) of
 * them, view by view 2 V (Z + 1).
 * W. H. Richardson, J. Opt. Soc. Am. 62, 55 (1972); L. B. Lucy, Astron. J. 79, 745 (1974).
 *
 * Without b, noise about zero counts where it is positive only, and is divided by what is next to
 * nothing. A background on both sides is Richardson-Lucy of data with Gaussian noise beside that
 * of photons (D. L. Snyder, C. W. Helstrom, A. D. Lanterman, M. Faisal and R. L. White, J. Opt.
 * Soc. Am. A 12, 272 (1995), who add its variance, in photons). Photons are not known here: b is 3
 * standard deviations of the views' noise, which leaves 1.3e-3 of the noise below zero.
 * Where there is noise alone, a ratio next to b / b takes the start away slowly: it is dim. */

static void correct(struct v2v_richardson_lucy *self, const float *views,
                    const struct v2v_view_list *list, float scale)
{
    const float least = V2V_PROJECTION_FLOOR, added = self->background;
    const int64_t count = v2v_richardson_lucy_pixels(self);
    for (int64_t i = 0; i < list->count; i++) {
        const int64_t v = list->view[i];
        const float *recorded = views + v * self->height * self->width;
        const uint8_t *unlit = self->unlit + v * count;
        float *ratio = self->ratio + i * count;
#pragma omp parallel for simd schedule(static)
        for (int64_t p = 0; p < count; p++) {
            const float above = recorded[p] * scale + added, below = ratio[p] + added;
            const float light = above > 0 ? above / (below > least ? below : least) : 0;
            ratio[p] = unlit[p] ? 0 : recorded[p] != V2V_BLIND ? light : 1;
        }
    }
    v2v_projector_adjoint(self->projector, self->numerator, self->ratio, list->view, list->count,
                          1.0f);
}

static const struct v2v_richardson_lucy_variant variant = {.iterations = 30,
                                                           .has_denominator = 1,
                                                           .at_once = 1,
                                                           .judged_every = 5,
                                                           .start = 0.05,
                                                           .background = 3.0,
                                                           .correct = correct};

static const char *const keys[] = {"deconv.iterations", "deconv.stop", NULL};

const struct v2v_estimator_ops v2v_estimator_rl = {
    .name = "rl", .variant = &variant, .keys = keys, V2V_RICHARDSON_LUCY_OPS};
