/** The ways to compute the network that `bench` compares. */
#ifndef V2V_BENCH_VARIANTS_H
#define V2V_BENCH_VARIANTS_H

#include "v2v3d/bench/bench.h"
#include "v2v3d/v2v/model.h"

struct v2v_variant {
    const char *name, *id;
    int64_t width; /**< 0: the job's */
    int backend, winograd, every_slice, precision;
    double skip;
};

/** Variants of a job in the order of the table: the default, each switch by itself, what the
 *  reference computes, the other library, bf16 where it is native, skipping; then the default at
 *  other widths, up to the widest.
 *  @kind Local. @param variants [V2V_BENCH_MOST_ROWS] out, widths filled in. @return their number
 */
int64_t v2v_variants_list(struct v2v_variant *variants, const struct v2v_bench_job *job);

/** The network's specification for a variant. @kind Local */
struct v2v_model_spec v2v_variant_spec(const struct v2v_variant *variant,
                                       const struct v2v_bench_job *job);

#endif
