/* Sums that travel while they are computed: on every grid of the ranks the bits of a plain loop. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/par/bucket_sum.h"

#include <string.h>

/* More buckets than are under way at once (16), the last ones short, parts of uneven length. */
enum { BUCKET = 701, SHARED = 5 * BUCKET + 3, OWN = 21 * BUCKET + 11, TOTAL = SHARED + OWN };

struct grid {
    int data, branches, shards;
    int place[V2V_GRID_LEVELS]; /* of this rank */
    struct v2v_comm *level[V2V_GRID_LEVELS];
};

/* Sizes from 1 to 1e6 and both signs: almost every other order gives other bits. */
static float contribution(int sample, int branch, int shard, int64_t i)
{
    static const double sizes[] = {1.0, 1e3, 1e6};
    int item = (sample * 2 + branch) * 8 + shard;
    return (float)(sizes[(sample + branch + shard) % 3] *
                   v2v_random_normal(97, (uint64_t)item, (uint64_t)i));
}

/* Samples in order; of each the branches in order (of what is not shared, one alone); of each the
 * shards in order. */
static float expected(const struct grid *grid, int samples, int64_t i, float factor)
{
    int only = i < SHARED ? -1 : grid->place[V2V_GRID_LEVEL_BRANCH];
    float total = 0.0f;
    for (int s = 0; s < samples; s++) {
        float of_sample = 0.0f;
        for (int b = 0; b < grid->branches; b++) {
            float of_branch = 0.0f;
            for (int p = 0; p < grid->shards && (only < 0 || b == only); p++) {
                of_branch += contribution(s, b, p, i);
            }
            of_sample += of_branch;
        }
        total += of_sample;
    }
    return total * factor;
}

static void make_grid(struct grid *grid, int branches, int shards)
{
    int size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    *grid =
        (struct grid){.data = size / branches / shards,
                      .branches = branches,
                      .shards = shards,
                      .place = {rank % shards, rank / shards % branches, rank / shards / branches}};
    int data = grid->place[V2V_GRID_LEVEL_DATA], branch = grid->place[V2V_GRID_LEVEL_BRANCH];
    int shard = grid->place[V2V_GRID_LEVEL_SHARD];
    assert_ok(v2v_comm_split(&grid->level[V2V_GRID_LEVEL_SHARD], test_world(),
                             data * branches + branch, rank));
    assert_ok(v2v_comm_split(&grid->level[V2V_GRID_LEVEL_BRANCH], test_world(),
                             data * shards + shard, rank));
    assert_ok(v2v_comm_split(&grid->level[V2V_GRID_LEVEL_DATA], test_world(),
                             branch * shards + shard, rank));
}

static void drop_grid(struct grid *grid)
{
    for (int level = 0; level < V2V_GRID_LEVELS; level++) {
        v2v_comm_destroy(&grid->level[level]);
    }
}

static void make_sum(struct v2v_bucket_sum **sum, const struct grid *grid)
{
    const struct v2v_bucket_run run[] = {
        {.first = SHARED,
         .count = OWN,
         .levels = 1u << V2V_GRID_LEVEL_SHARD | 1u << V2V_GRID_LEVEL_DATA},
        {.first = 0,
         .count = SHARED,
         .levels =
             1u << V2V_GRID_LEVEL_SHARD | 1u << V2V_GRID_LEVEL_BRANCH | 1u << V2V_GRID_LEVEL_DATA}};
    struct v2v_bucket_setup setup = {
        .world = test_world(), .run = run, .runs = 2, .bucket = BUCKET};
    memcpy(setup.level, grid->level, sizeof setup.level);
    assert_ok(v2v_bucket_sum_create(sum, &setup));
}

/* Some ranks get ready from the end on in pieces that fit no bucket, the others all at once. */
static void get_ready(struct v2v_bucket_sum *sum)
{
    enum { PIECE = 1234 };
    int64_t left = v2v_comm_rank(test_world()) % 3 == 1 ? 0 : TOTAL;
    if (left == 0) {
        v2v_bucket_sum_ready(sum, 0, TOTAL);
    }
    while (left > 0) {
        int64_t piece = left < PIECE ? left : PIECE;
        left -= piece;
        v2v_bucket_sum_ready(sum, left, piece);
        v2v_bucket_sum_ready(sum, 0, 0);
    }
}

static void run_round(struct v2v_bucket_sum *sum, const struct grid *grid, float *x, float *total,
                      int round, int samples, float factor)
{
    int rounds = (samples + grid->data - 1) / grid->data;
    int sample = round * grid->data + grid->place[V2V_GRID_LEVEL_DATA];
    struct v2v_bucket_round setup = {
        .x = x, .total = total, .first = round == 0, .last = round == rounds - 1, .factor = factor};
    double tail[2] = {v2v_comm_rank(test_world()), 1.0};
    for (int64_t i = 0; i < TOTAL; i++) {
        x[i] = sample < samples ? contribution(sample, grid->place[V2V_GRID_LEVEL_BRANCH],
                                               grid->place[V2V_GRID_LEVEL_SHARD], i)
                                : 0.0f;
    }
    v2v_bucket_sum_begin(sum, &setup);
    get_ready(sum);
    v2v_bucket_sum_finish(sum, tail, setup.last ? 2 : 0);
    if (setup.last) {
        double size = v2v_comm_size(test_world());
        assert_true(tail[0] == size * (size - 1.0) / 2.0 && tail[1] == size);
    }
}

/* Every float of a sum of `samples`; the arena of the contributions is the total's when they come
 * in one round. */
static void check_sum(struct v2v_bucket_sum *sum, const struct grid *grid, int samples)
{
    const float factor = 0.3f;
    float *x = NULL, *total = NULL;
    int rounds = (samples + grid->data - 1) / grid->data;
    assert_ok(V2V_ALLOC(x, "test", TOTAL));
    assert_ok(V2V_ALLOC(total, "test", TOTAL));
    float *result = rounds > 1 ? total : x;
    for (int64_t i = 0; i < TOTAL; i++) {
        total[i] = 1e30f; /* of an earlier step */
    }
    for (int round = 0; round < rounds; round++) {
        run_round(sum, grid, x, result, round, samples, factor);
    }
    for (int64_t i = 0; i < TOTAL; i++) {
        float right = expected(grid, samples, i, factor);
        if (memcmp(&result[i], &right, sizeof right) != 0) {
            fail_msg("%d samples, %d x %d x %d ranks, float %lld: %.9g, not %.9g", samples,
                     grid->data, grid->branches, grid->shards, (long long)i, (double)result[i],
                     (double)right);
        }
    }
    v2v_mem_free(total);
    v2v_mem_free(x);
}

static void every_grid_gives_the_bits_of_a_plain_loop(void **state)
{
    (void)state;
    int size = v2v_comm_size(test_world()), grids = 0;
    for (int branches = 1; branches <= 2; branches++) {
        for (int shards = 1; shards <= size; shards++) {
            struct grid grid;
            struct v2v_bucket_sum *sum = NULL;
            if (size % (branches * shards) != 0) {
                continue;
            }
            make_grid(&grid, branches, shards);
            make_sum(&sum, &grid);
            check_sum(sum, &grid, 1);         /* more ranks than samples */
            check_sum(sum, &grid, grid.data); /* one round */
            check_sum(sum, &grid,
                      2 * grid.data + 1); /* three, some ranks without one in the last */
            v2v_bucket_sum_destroy(&sum);
            drop_grid(&grid);
            grids++;
        }
    }
    assert_true(grids > 0);
}

/* Else the test above would prove nothing about the order. */
static void another_order_gives_other_bits(void **state)
{
    (void)state;
    int64_t differing = 0;
    for (int64_t i = 0; i < TOTAL; i++) {
        float forward = 0.0f, backward = 0.0f;
        for (int s = 0; s < 3; s++) {
            forward += contribution(s, 0, 0, i);
            backward += contribution(2 - s, 0, 0, i);
        }
        differing += forward != backward;
    }
    assert_true(differing > TOTAL / 8);
}

static void nothing_to_sum_is_no_failure(void **state)
{
    (void)state;
    struct v2v_bucket_sum *sum = NULL;
    struct v2v_bucket_run run = {.levels = 1u << V2V_GRID_LEVEL_DATA};
    struct v2v_bucket_setup setup = {.world = test_world(),
                                     .level = {[V2V_GRID_LEVEL_DATA] = test_world()},
                                     .run = &run,
                                     .runs = 1,
                                     .bucket = BUCKET};
    float nothing[1] = {5.0f};
    double tail = 1.0;
    assert_ok(v2v_bucket_sum_create(&sum, &setup));
    v2v_bucket_sum_begin(
        sum, &(struct v2v_bucket_round){.x = nothing, .total = nothing, .first = 1, .last = 1});
    v2v_bucket_sum_finish(sum, &tail, 1);
    assert_true(tail == v2v_comm_size(test_world()) && nothing[0] == 5.0f);
    v2v_bucket_sum_destroy(&sum);
    v2v_bucket_sum_destroy(&sum);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_grid_gives_the_bits_of_a_plain_loop),
        cmocka_unit_test(another_order_gives_other_bits),
        cmocka_unit_test(nothing_to_sum_is_no_failure),
    };
    return test_mpi_main(tests, argc, argv);
}
