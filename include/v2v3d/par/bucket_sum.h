#ifndef V2V3D_PAR_BUCKET_SUM_H
#define V2V3D_PAR_BUCKET_SUM_H
#include "v2v3d/par/comm.h"

#ifdef __cplusplus
extern "C" {
#endif

/** The ranks that share one sample, from the inside out, and those that hold different samples. */
enum { V2V_GRID_LEVEL_SHARD, V2V_GRID_LEVEL_BRANCH, V2V_GRID_LEVEL_DATA, V2V_GRID_LEVELS };

/** Floats [first, first + count) of an arena and the levels that they are summed over, as bits. */
struct v2v_bucket_run {
    int64_t first, count;
    unsigned levels; /**< 1u << V2V_GRID_LEVEL_SHARD | ..; _DATA always is among them */
};

struct v2v_bucket_setup {
    const struct v2v_comm *world;                  /**< all that create the sum */
    const struct v2v_comm *level[V2V_GRID_LEVELS]; /**< NULL or one rank: nothing to sum there */
    const struct v2v_bucket_run *run;              /**< in the order in which they get ready */
    int64_t runs;
    int64_t bucket; /**< floats that go out at once; V2V_BUCKET_FLOATS */
};

/** 4 MB: a message's latency doesn't count, and buckets are enough to overlap. */
enum { V2V_BUCKET_FLOATS = 1 << 20 };

/** Sums of an arena over ranks, in a fixed order, that travel while the arena still is computed.
 *
 *  Of every float: the contributions of a level's ranks are added in rank order, the result is the
 *  next level's contribution; those of the last level are added to what earlier rounds left. So n
 *  samples over r ranks in n / r rounds get the same bits for every r.
 *  A bucket is posted as soon as all its floats are ready, and moves on whenever the sum is told of
 *  more: non-blocking all-to-all (a rank then sums its part), at the end a non-blocking gather. */
struct v2v_bucket_sum;

/** @kind Collective(world). The level's sizes and the runs are the same on ranks that share a
 *  level. @return V2V_OK | V2V_E_MEMORY, agreed */
enum v2v_status v2v_bucket_sum_create(struct v2v_bucket_sum **sum,
                                      const struct v2v_bucket_setup *setup) V2V_MUST_CHECK;
/** @kind Collective(world); accepts NULL, nulls the pointer. */
void v2v_bucket_sum_destroy(struct v2v_bucket_sum **sum);

/** A round: the arena that contributions are made in, where they add up, and what becomes of it. */
struct v2v_bucket_round {
    float *x;     /**< used up */
    float *total; /**< may be x when the first round is the last one */
    int first;    /**< total is zeroed before */
    int last;     /**< total is scaled and spread to all ranks */
    float factor; /**< in the last round */
};

/** Nothing is ready yet. Nothing of the last round is under way. @kind Local. */
void v2v_bucket_sum_begin(struct v2v_bucket_sum *sum, const struct v2v_bucket_round *round);

/** x[first, first + count) is final: it is left alone until the round is finished. What is under
 *  way moves on, also for count 0. @kind Local: never waits */
void v2v_bucket_sum_ready(struct v2v_bucket_sum *sum, int64_t first, int64_t count);

/** Wait for the end of the round; all was ready. `tail` (count > 0): numbers summed over the world
 *  beside the last buckets, without a meeting of their own.
 *  @kind Collective(world) */
void v2v_bucket_sum_finish(struct v2v_bucket_sum *sum, double *tail, int64_t count);

#ifdef __cplusplus
}
#endif

#endif
