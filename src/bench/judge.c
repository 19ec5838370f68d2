#include "bench/judge.h"

#include "bench/network_twin.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/metrics.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/v2v/schema.h"
#include <math.h>

/* The golden frame's seed and rule: volumes keep the signal's size at any width. */
static const int64_t rule_seed = 7;

/* PSNR of the mean volume, [z,y,x], in the truth's units. */
static enum v2v_status psnr_of(double *psnr, const float *mean, const struct v2v_bench_job *job)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scores scores;
    V2V_TRY(v2v_scores_of(&scores, job->truth, mean, job->psf->slices, job->size, job->size, 0));
    *psnr = scores.psnr;
done:
    return rc;
}

static enum v2v_status score_twin(struct v2v_judge *judge, const struct v2v_bench_job *job)
{
    enum v2v_status rc = V2V_OK;
    float *mean = NULL;
    V2V_TRY(V2V_ALLOC(mean, "bench.mean", judge->voxels));
    for (int64_t i = 0; i < judge->voxels; i++) {
        mean[i] = (float)((judge->volume[0][i] + judge->volume[1][i]) / (2.0 * job->gain));
    }
    V2V_TRY(psnr_of(&judge->psnr, mean, job));
done:
    v2v_mem_free(mean);
    return rc;
}

enum v2v_status v2v_judge_init(struct v2v_judge *judge, const struct v2v_variant *variant,
                               const struct v2v_bench_job *job, const struct v2v_shifts *shifts)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_model_spec spec = v2v_variant_spec(variant, job);
    *judge = (struct v2v_judge){.width = variant->width,
                                .voxels = v2v_mem_product(spec.slices, job->size, job->size),
                                .is_trained = job->weights != NULL && variant->width == job->width,
                                .psnr = NAN};
    V2V_TRY(v2v_model_schema(&judge->fields, &spec));
    V2V_TRY(V2V_ALLOC(judge->weights, "bench.weights", judge->fields.total));
    if (judge->is_trained) {
        V2V_TRY(v2v_weights_file_read(judge->weights, job->weights, "weights", &judge->fields));
    } else {
        V2V_TRY(v2v_rule_weights(&judge->fields, judge->weights, V2V_RULE_HASH, rule_seed));
    }
    for (int b = 0; b < V2V_JUDGE_BRANCHES; b++) {
        V2V_TRY(V2V_ALLOC(judge->volume[b], "bench.twin", judge->voxels));
    }
    V2V_TRY(v2v_network_twin(judge->volume, &spec, shifts, &judge->fields, judge->weights,
                             job->views, job->size, job->size));
    if (job->truth != NULL && judge->is_trained) {
        V2V_TRY(score_twin(judge, job));
    }
done:
    return rc;
}

void v2v_judge_fini(struct v2v_judge *judge)
{
    for (int b = 0; b < V2V_JUDGE_BRANCHES; b++) {
        v2v_mem_free(judge->volume[b]);
    }
    v2v_mem_free(judge->weights);
    v2v_fields_fini(&judge->fields);
    *judge = (struct v2v_judge){0};
}

static double relative_error(const float *volume, const double *twin, int64_t count)
{
    double difference = 0.0, norm = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double d = volume[i] - twin[i];
        difference += d * d;
        norm += twin[i] * twin[i];
    }
    return sqrt(difference / norm);
}

enum v2v_status v2v_judge_row(struct v2v_bench_row *row, const struct v2v_judge *judge,
                              const struct v2v_bench_job *job, float *const *volume)
{
    enum v2v_status rc = V2V_OK;
    double psnr = 0.0;
    for (int b = 0; b < V2V_JUDGE_BRANCHES; b++) {
        row->error[b] = relative_error(volume[b], judge->volume[b], judge->voxels);
    }
    row->psnr_change = NAN;
    if (!isnan(judge->psnr)) {
        float *mean = volume[0]; /* not needed any more */
        for (int64_t i = 0; i < judge->voxels; i++) {
            mean[i] = (float)(((double)volume[0][i] + (double)volume[1][i]) / (2.0 * job->gain));
        }
        V2V_TRY(psnr_of(&psnr, mean, job));
        row->psnr_change = psnr - judge->psnr;
    }
done:
    return rc;
}
