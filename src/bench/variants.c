#include "bench/variants.h"
#include "v2v3d/op/bf16.h"

static const struct v2v_variant table[] = {
    {"default", "default", 0, V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
    {"winograd off", "winograd_off", 0, V2V_BACKEND_ONEDNN, 0, 0, V2V_PRECISION_F32},
    {"merging off", "merging_off", 0, V2V_BACKEND_ONEDNN, 1, 1, V2V_PRECISION_F32},
    {"both off", "both_off", 0, V2V_BACKEND_ONEDNN, 0, 1, V2V_PRECISION_F32},
    {"openblas, winograd off", "openblas_winograd_off", 0, V2V_BACKEND_OPENBLAS, 0, 0,
     V2V_PRECISION_F32},
    {"bf16", "bf16", 0, V2V_BACKEND_ONEDNN, 0, 0, V2V_PRECISION_BF16},
    {"width 16", "width_16", 16, V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
    {"width 32", "width_32", 32, V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
    {"width 64", "width_64", 64, V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
    {"width 128", "width_128", 128, V2V_BACKEND_ONEDNN, 1, 0, V2V_PRECISION_F32},
};
enum { VARIANTS = sizeof table / sizeof table[0] };
_Static_assert((int)VARIANTS <= (int)V2V_BENCH_MOST_ROWS, "a result holds every variant");

/* The time of emulated bf16 would say nothing about bf16. */
static int can_run(const struct v2v_variant *variant)
{
    return variant->precision == V2V_PRECISION_F32 || v2v_op_bf16() == V2V_BF16_NATIVE;
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
                                   .volume_scale = job->volume_scale};
}
