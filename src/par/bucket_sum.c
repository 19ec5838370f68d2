#include "v2v3d/par/bucket_sum.h"

#include "par/comm_mpi.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"

#include <limits.h>
#include <string.h>

/* Buckets on the way to their sums at once, each with memory for what it receives. */
enum { SLOTS = 16, NO_SLOT = -1 };

/* What a bucket goes through: it is taken apart and summed level by level, settled by the rank that
 * ends up with a part of it, and put together from the last level back to the first. A stage that
 * has no ranks to talk to is passed at once. */
enum { REDUCE = 0, SETTLE = REDUCE + V2V_GRID_LEVELS, SPREAD, STAGES = SPREAD + V2V_GRID_LEVELS };

struct bucket {
    struct v2v_part part[V2V_GRID_LEVELS + 1]; /* of the arena, before each level, after the last */
    unsigned levels;                           /* on which there is somebody to talk to */
    int64_t missing;                           /* floats that are not ready */
    int entered, left;                         /* stages: equal when none is under way */
    int slot;
    int *counts; /* MPI's arrays for the message under way: 4 * largest */
};

struct v2v_bucket_sum {
    const struct v2v_comm *world;
    int size[V2V_GRID_LEVELS], rank[V2V_GRID_LEVELS];
    /* Messages of one kind and level keep the order of the buckets, on a communicator of their own:
     * how far a bucket has come differs from rank to rank. */
    MPI_Comm reduce[V2V_GRID_LEVELS], spread[V2V_GRID_LEVELS];
    struct bucket *bucket;
    MPI_Request *request; /* of each bucket */
    int64_t buckets;
    int64_t oldest; /* the first that is not through */
    int *counts;
    const float **source; /* [largest]: what is added up, by rank */
    float *slot;          /* [slots, slot_floats] */
    int64_t slot_floats;  /* a bucket, and a rounded-up part for each rank */
    int slots;
    unsigned taken; /* slots in use, as bits */
    struct v2v_bucket_round round;
};

/* ---- create ---- */

static int largest_level(const struct v2v_bucket_sum *sum)
{
    int most = 1;
    for (int level = 0; level < V2V_GRID_LEVELS; level++) {
        most = most > sum->size[level] ? most : sum->size[level];
    }
    return most;
}

/* What is left of the bucket on this rank after each level. */
static void cut_bucket(const struct v2v_bucket_sum *sum, struct bucket *bucket,
                       const struct v2v_bucket_run *run)
{
    for (int level = 0; level < V2V_GRID_LEVELS; level++) {
        struct v2v_part whole = bucket->part[level], own = whole;
        if ((run->levels >> level & 1) != 0 && sum->size[level] > 1) {
            bucket->levels |= 1u << level;
            own = v2v_par_part(whole.count, sum->size[level], sum->rank[level]);
            own.first += whole.first;
        }
        bucket->part[level + 1] = own;
    }
}

/* Backward passes start at the end of a run, and so do its buckets. */
static void cut_run(struct v2v_bucket_sum *sum, const struct v2v_bucket_setup *setup,
                    const struct v2v_bucket_run *run)
{
    V2V_ASSERT((run->levels >> V2V_GRID_LEVEL_DATA & 1) != 0);
    for (int64_t left = run->count; left > 0;) {
        int64_t count = v2v_smaller(left, setup->bucket);
        struct bucket *bucket = &sum->bucket[sum->buckets++];
        left -= count;
        *bucket = (struct bucket){.part = {{.first = run->first + left, .count = count}},
                                  .slot = NO_SLOT,
                                  .entered = STAGES,
                                  .left = STAGES};
        cut_bucket(sum, bucket, run);
    }
}

static enum v2v_status take_memory(struct v2v_bucket_sum *sum, const struct v2v_bucket_setup *setup)
{
    enum v2v_status rc = V2V_OK;
    int64_t buckets = 0, largest = largest_level(sum);
    V2V_ASSERT(setup->bucket > 0 && setup->bucket + largest <= INT_MAX);
    for (int64_t i = 0; i < setup->runs; i++) {
        buckets += (setup->run[i].count + setup->bucket - 1) / setup->bucket;
    }
    V2V_TRY(V2V_ALLOC(sum->bucket, "par.buckets", buckets));
    V2V_TRY(V2V_ALLOC(sum->request, "par.buckets", buckets));
    V2V_TRY(V2V_ALLOC(sum->counts, "par.buckets", v2v_mem_product(4, buckets, largest)));
    V2V_TRY(V2V_ALLOC(sum->source, "par.buckets", largest));
    for (int64_t i = 0; i < setup->runs; i++) {
        cut_run(sum, setup, &setup->run[i]);
    }
    for (int64_t k = 0; k < buckets; k++) {
        sum->request[k] = MPI_REQUEST_NULL;
        sum->bucket[k].counts = sum->counts + 4 * largest * k;
    }
    sum->oldest = buckets;
    if (largest > 1) {
        sum->slots = (int)v2v_smaller(buckets, SLOTS);
        sum->slot_floats = setup->bucket + largest;
        V2V_TRY(
            V2V_ALLOC(sum->slot, "par.buckets", v2v_mem_product(sum->slots, sum->slot_floats, 1)));
    }
done:
    return rc;
}

enum v2v_status v2v_bucket_sum_create(struct v2v_bucket_sum **sum,
                                      const struct v2v_bucket_setup *setup)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_bucket_sum *fresh = NULL;
    *sum = NULL;
    rc = V2V_ALLOC(fresh, "par.buckets", 1);
    if (rc == V2V_OK) {
        fresh->world = setup->world;
        for (int level = 0; level < V2V_GRID_LEVELS; level++) {
            fresh->size[level] = v2v_comm_size(setup->level[level]);
            fresh->rank[level] = v2v_comm_rank(setup->level[level]);
            fresh->reduce[level] = fresh->spread[level] = MPI_COMM_NULL;
        }
        rc = take_memory(fresh, setup);
    }
    V2V_TRY(v2v_par_agree(setup->world, rc));
    for (int level = 0; level < V2V_GRID_LEVELS; level++) {
        if (fresh->size[level] > 1) {
            MPI_Comm_dup(v2v_comm_mpi(setup->level[level]), &fresh->reduce[level]);
            MPI_Comm_dup(v2v_comm_mpi(setup->level[level]), &fresh->spread[level]);
        }
    }
done:
    if (rc != V2V_OK) {
        v2v_bucket_sum_destroy(&fresh);
    }
    *sum = fresh;
    return rc;
}

void v2v_bucket_sum_destroy(struct v2v_bucket_sum **sum)
{
    struct v2v_bucket_sum *self = *sum;
    if (self == NULL) {
        return;
    }
    for (int level = 0; level < V2V_GRID_LEVELS; level++) {
        if (self->reduce[level] != MPI_COMM_NULL) {
            MPI_Comm_free(&self->reduce[level]);
        }
        if (self->spread[level] != MPI_COMM_NULL) {
            MPI_Comm_free(&self->spread[level]);
        }
    }
    v2v_mem_free(self->slot);
    v2v_mem_free(self->counts);
    v2v_mem_free(self->source);
    v2v_mem_free(self->request);
    v2v_mem_free(self->bucket);
    v2v_mem_free(self);
    *sum = NULL;
}

/* ---- a bucket's way ---- */

/* Floats that stay in the nearest cache while all ranks' are added. */
enum { BLOCK = 2048 };

/* out = start + x of rank 0 + x of rank 1 + ..; out may be any of them. */
static void add_in_order(float *out, const float *start, const float *const *x, int ranks,
                         int64_t count)
{
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < count; i += BLOCK) {
        float sum[BLOCK];
        int64_t block = v2v_smaller(count - i, BLOCK);
        if (start != NULL) {
            memcpy(sum, start + i, (size_t)block * sizeof *sum);
        } else {
            memset(sum, 0, (size_t)block * sizeof *sum);
        }
        for (int r = 0; r < ranks; r++) {
            for (int64_t j = 0; j < block; j++) {
                sum[j] += x[r][i + j];
            }
        }
        memcpy(out + i, sum, (size_t)block * sizeof *sum);
    }
}

static void scale(float *x, int64_t count, float factor)
{
#pragma omp parallel for simd schedule(static)
    for (int64_t i = 0; i < count; i++) {
        x[i] *= factor;
    }
}

static float *slot_memory(const struct v2v_bucket_sum *sum, int slot)
{
    return sum->slot + slot * sum->slot_floats;
}

static int take_slot(struct v2v_bucket_sum *sum)
{
    for (int slot = 0; slot < sum->slots; slot++) {
        if ((sum->taken >> slot & 1) == 0) {
            sum->taken |= 1u << slot;
            return slot;
        }
    }
    return NO_SLOT;
}

static void give_slot_back(struct v2v_bucket_sum *sum, struct bucket *bucket)
{
    if (bucket->slot != NO_SLOT) {
        sum->taken &= ~(1u << bucket->slot);
        bucket->slot = NO_SLOT;
    }
}

/* What a rank contributes to its own part stays where it is. */
static void post_reduce(struct v2v_bucket_sum *sum, int64_t k, int level)
{
    struct bucket *bucket = &sum->bucket[k];
    int size = sum->size[level], own = (int)bucket->part[level + 1].count;
    int *counts = bucket->counts, *offsets = counts + size;
    int *taken = offsets + size, *places = taken + size;
    v2v_par_list_parts(counts, offsets, bucket->part[level].count, size);
    for (int r = 0; r < size; r++) {
        taken[r] = own;
        places[r] = r * own;
    }
    counts[sum->rank[level]] = taken[sum->rank[level]] = 0;
    MPI_Ialltoallv(sum->round.x + bucket->part[level].first, counts, offsets, MPI_FLOAT,
                   slot_memory(sum, bucket->slot), taken, places, MPI_FLOAT, sum->reduce[level],
                   &sum->request[k]);
}

/* The inner levels' sums are contributions to the next level; the samples' are the total. */
static void add_received(struct v2v_bucket_sum *sum, const struct bucket *bucket, int level)
{
    struct v2v_part own = bucket->part[level + 1];
    int is_last = level == V2V_GRID_LEVEL_DATA;
    float *place = (is_last ? sum->round.total : sum->round.x) + own.first;
    for (int r = 0; r < sum->size[level]; r++) {
        sum->source[r] = r == sum->rank[level] ? sum->round.x + own.first
                                               : slot_memory(sum, bucket->slot) + r * own.count;
    }
    add_in_order(place, is_last && !sum->round.first ? place : NULL, sum->source, sum->size[level],
                 own.count);
}

static void settle(struct v2v_bucket_sum *sum, struct bucket *bucket)
{
    const struct v2v_bucket_round *round = &sum->round;
    struct v2v_part own = bucket->part[V2V_GRID_LEVELS];
    float *place = round->total + own.first;
    if ((bucket->levels >> V2V_GRID_LEVEL_DATA & 1) == 0 && round->total != round->x) {
        const float *x = round->x + own.first;
        add_in_order(place, round->first ? NULL : place, &x, 1, own.count);
    }
    if (round->last && round->factor != 1.0f) {
        scale(place, own.count, round->factor);
    }
    give_slot_back(sum, bucket);
}

static void post_spread(struct v2v_bucket_sum *sum, int64_t k, int level)
{
    struct bucket *bucket = &sum->bucket[k];
    int size = sum->size[level];
    v2v_par_list_parts(bucket->counts, bucket->counts + size, bucket->part[level].count, size);
    MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL,
                    sum->round.total + bucket->part[level].first, bucket->counts,
                    bucket->counts + size, MPI_FLOAT, sum->spread[level], &sum->request[k]);
}

/* The level that a stage talks on, -1: none for this bucket in this round. */
static int level_of(const struct v2v_bucket_sum *sum, const struct bucket *bucket, int stage)
{
    int level = stage < SETTLE ? stage - REDUCE : STAGES - 1 - stage;
    if (stage == SETTLE || (stage > SETTLE && !sum->round.last)) {
        return -1;
    }
    return (bucket->levels >> level & 1) != 0 ? level : -1;
}

/* Enter the next stage, unless the bucket before has yet to: all ranks post in one order. */
static int enter(struct v2v_bucket_sum *sum, int64_t k)
{
    struct bucket *bucket = &sum->bucket[k];
    int stage = bucket->entered, level = level_of(sum, bucket, stage);
    if (bucket->missing > 0 || (k > 0 && sum->bucket[k - 1].entered <= stage)) {
        return 0;
    }
    if (level >= 0 && stage < SETTLE && bucket->slot == NO_SLOT) {
        bucket->slot = take_slot(sum);
        if (bucket->slot == NO_SLOT) {
            return 0;
        }
    }
    bucket->entered++;
    if (level >= 0 && stage < SETTLE) {
        post_reduce(sum, k, level);
    } else if (level >= 0) {
        post_spread(sum, k, level);
    }
    return 1;
}

/* Leave the stage that is under way when its message, if any, is through. */
static int leave(struct v2v_bucket_sum *sum, int64_t k)
{
    struct bucket *bucket = &sum->bucket[k];
    int stage = bucket->left, level = level_of(sum, bucket, stage), through = 1;
    if (level >= 0) {
        MPI_Test(&sum->request[k], &through, MPI_STATUS_IGNORE);
    }
    if (!through) {
        return 0;
    }
    if (stage == SETTLE) {
        settle(sum, bucket);
    } else if (stage < SETTLE && level >= 0) {
        add_received(sum, bucket, level);
    }
    bucket->left++;
    return 1;
}

static void move_on(struct v2v_bucket_sum *sum)
{
    for (int64_t k = sum->oldest; k < sum->buckets; k++) {
        struct bucket *bucket = &sum->bucket[k];
        int moves = 1;
        while (moves && bucket->left < STAGES) {
            moves = bucket->left < bucket->entered ? leave(sum, k) : enter(sum, k);
        }
        if (bucket->entered == 0) {
            break; /* nor may those behind it */
        }
    }
    while (sum->oldest < sum->buckets && sum->bucket[sum->oldest].left == STAGES) {
        sum->oldest++;
    }
}

/* ---- a round ---- */

/* A rank alone adds, it doesn't communicate. */
static void book(const struct v2v_bucket_sum *sum, double began)
{
    if (v2v_comm_size(sum->world) > 1) {
        v2v_par_spent(V2V_PAR_SUM, began);
    }
}

void v2v_bucket_sum_begin(struct v2v_bucket_sum *sum, const struct v2v_bucket_round *round)
{
    V2V_ASSERT(sum->oldest == sum->buckets);
    V2V_ASSERT(round->x != round->total || (round->first && round->last));
    sum->round = *round;
    sum->oldest = 0;
    for (int64_t k = 0; k < sum->buckets; k++) {
        sum->bucket[k].missing = sum->bucket[k].part[0].count;
        sum->bucket[k].entered = sum->bucket[k].left = 0;
    }
}

void v2v_bucket_sum_ready(struct v2v_bucket_sum *sum, int64_t first, int64_t count)
{
    double began = v2v_clock_now();
    for (int64_t k = sum->oldest; k < sum->buckets; k++) {
        struct v2v_part whole = sum->bucket[k].part[0];
        int64_t from = first > whole.first ? first : whole.first;
        int64_t to = v2v_smaller(first + count, whole.first + whole.count);
        if (to > from) {
            V2V_ASSERT(sum->bucket[k].missing >= to - from);
            sum->bucket[k].missing -= to - from;
        }
    }
    move_on(sum);
    book(sum, began);
}

void v2v_bucket_sum_finish(struct v2v_bucket_sum *sum, double *tail, int64_t count)
{
    double began = v2v_clock_now();
    MPI_Request request = MPI_REQUEST_NULL;
    V2V_ASSERT(count >= 0 && count <= INT_MAX);
    if (count > 0 && v2v_comm_size(sum->world) > 1) {
        MPI_Iallreduce(MPI_IN_PLACE, tail, (int)count, MPI_DOUBLE, MPI_SUM,
                       v2v_comm_mpi(sum->world), &request);
    }
    for (move_on(sum); sum->oldest < sum->buckets; move_on(sum)) {
        int any = MPI_UNDEFINED;
        V2V_ASSERT(sum->bucket[sum->oldest].missing == 0);
        MPI_Waitany((int)(sum->buckets - sum->oldest), sum->request + sum->oldest, &any,
                    MPI_STATUS_IGNORE);
        V2V_ASSERT(any != MPI_UNDEFINED);
    }
    if (v2v_comm_size(sum->world) > 1) { /* a rank alone may have no MPI */
        MPI_Wait(&request, MPI_STATUS_IGNORE);
    }
    book(sum, began);
}
