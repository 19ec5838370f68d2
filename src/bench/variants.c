#include "bench/variants.h"
#include "v2v3d/op/bf16.h"

static const struct v2v_variant table[] = {
    {.name = "default", .id = "default", .winograd = 1},
    {.name = "winograd off", .id = "winograd_off"},
    {.name = "merging off", .id = "merging_off", .winograd = 1, .every_slice = 1},
    {.name = "both off", .id = "both_off", .every_slice = 1},
    {.name = "openblas, winograd off",
     .id = "openblas_winograd_off",
     .backend = V2V_BACKEND_OPENBLAS},
    {.name = "bf16", .id = "bf16", .precision = V2V_PRECISION_BF16},
    {.name = "skip auto", .id = "skip", .winograd = 1, .skip = V2V_SKIP_AUTO},
    {.name = "width 16", .id = "width_16", .width = 16, .winograd = 1},
    {.name = "width 32", .id = "width_32", .width = 32, .winograd = 1},
    {.name = "width 64", .id = "width_64", .width = 64, .winograd = 1},
    {.name = "width 128", .id = "width_128", .width = 128, .winograd = 1},
};
_Static_assert(V2V_BACKEND_ONEDNN == 0 && V2V_PRECISION_F32 == 0, "what the table leaves out");
enum { VARIANTS = sizeof table / sizeof table[0] };
_Static_assert((int)VARIANTS <= (int)V2V_BENCH_MOST_ROWS, "a result holds every variant");

/* The time of emulated bf16 would say nothing about bf16. */
static int can_run(const struct v2v_variant *variant)
{
    return variant->precision == V2V_PRECISION_F32 || v2v_op_bf16() >= V2V_BF16_NATIVE;
}

int64_t v2v_variants_list(struct v2v_variant *variants, const struct v2v_bench_job *job)
{
    int64_t count = 0;
    for (int i = 0; i < VARIANTS; i++) {
        /* the default is the job's width already */
        if (table[i].width <= job->widest && table[i].width != job->width && can_run(&table[i])) {
            variants[count] = table[i];
            if (variants[count].width == 0) {
                variants[count].width = job->width;
            }
            count++;
        }
    }
    return count;
}

struct v2v_model_spec v2v_variant_spec(const struct v2v_variant *variant,
                                       const struct v2v_bench_job *job)
{
    return (struct v2v_model_spec){.views = job->psf->views,
                                   .slices = job->psf->slices,
                                   .width = variant->width,
                                   .features = job->features,
                                   .branches = V2V_BRANCH_BOTH,
                                   .backend = variant->backend,
                                   .winograd = variant->winograd,
                                   .precision = variant->precision,
                                   .every_slice = variant->every_slice,
                                   .volume_scale = job->volume_scale,
                                   .skip = variant->skip};
}
