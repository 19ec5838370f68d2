/** What every variant of one width is judged by: its weights and the twin's volumes. */
#ifndef V2V_BENCH_JUDGE_H
#define V2V_BENCH_JUDGE_H

#include "bench/variants.h"

enum { V2V_JUDGE_BRANCHES = 2 };

struct v2v_judge {
    int64_t width, voxels;
    struct v2v_fields fields;
    float *weights;                     /**< arena of the fields */
    double *volume[V2V_JUDGE_BRANCHES]; /**< [z,y,x] of the twin */
    int is_trained;                     /**< the weights come from the job's file */
    double psnr;                        /**< of the twin's mean volume; NaN: not measured */
};

/** Weights of the variant's width (from the job's file when it is the job's width, else by rule)
 * and the twin's volumes of the job's frame. @kind Local; v2v_judge_fini after both */
enum v2v_status v2v_judge_init(struct v2v_judge *judge, const struct v2v_variant *variant,
                               const struct v2v_bench_job *job,
                               const struct v2v_shifts *shifts) V2V_MUST_CHECK;
void v2v_judge_fini(struct v2v_judge *judge);

/** error and psnr_change of a variant that computed `volume` [2]: [z,y,x]. @kind Local */
enum v2v_status v2v_judge_row(struct v2v_bench_row *row, const struct v2v_judge *judge,
                              const struct v2v_bench_job *job, float *const *volume) V2V_MUST_CHECK;

#endif
