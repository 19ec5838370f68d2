/* Sums in a fixed order: a contribution's place counts, not the process that brings it. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <omp.h>
#include <string.h>

enum { COUNT = V2V_PAR_SCRATCH / 8 + 13, ITEMS = 12 };

/* Sizes from 1 to 1e6 and both signs: almost every other order gives other bits. */
static float contribution(int64_t item, int64_t i)
{
    static const double sizes[] = {1.0, 1e3, 1e6};
    uint64_t n = (uint64_t)(item * COUNT + i);
    return (float)(sizes[item % 3] * v2v_random_normal(89, 0, n));
}

static float *make(int64_t count)
{
    float *x = v2v_mem_alloc("test", count, sizeof *x);
    assert_non_null(x);
    return x;
}

/* Items first, first + step, .. in this order on one rank. */
static void add_alone(float *sum, int64_t first, int64_t last, int64_t step)
{
    for (int64_t item = first; item != last; item += step) {
        for (int64_t i = 0; i < COUNT; i++) {
            sum[i] += contribution(item, i);
        }
    }
}

/* Rank r of comm brings item r. */
static void add_together(float *sum, const struct v2v_comm *comm)
{
    float *scratch = make(V2V_PAR_SCRATCH);
    for (int64_t i = 0; i < COUNT; i++) {
        sum[i] = contribution(v2v_comm_rank(comm), i);
    }
    v2v_par_sum_ordered_f32(comm, sum, COUNT, scratch);
    v2v_mem_free(scratch);
}

static void permuted_ranks_and_any_threads_give_one_ranks_bits(void **state)
{
    enum { ORDERS = 3 };
    static const char *const name[ORDERS] = {"as they are", "turned round", "rotated"};
    int size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    const int key[ORDERS] = {rank, -rank, (rank + 1) % size};
    float *alone = make(COUNT), *sum = make(COUNT);
    (void)state;
    add_alone(alone, 0, size, 1);
    print_message("%-14s %8s %s\n", "ranks", "threads", "sum of one rank");
    for (int order = 0; order < ORDERS; order++) {
        struct v2v_comm *comm = NULL;
        assert_ok(v2v_comm_split(&comm, test_world(), 0, key[order]));
        for (int threads = 1; threads <= 4; threads *= 2) {
            omp_set_num_threads(threads);
            add_together(sum, comm);
            omp_set_num_threads(1);
            int same = memcmp(sum, alone, COUNT * sizeof *sum) == 0;
            print_message("%-14s %8d %s\n", name[order], threads, same ? "same bits" : "differs");
            assert_true(same);
        }
        v2v_comm_destroy(&comm);
    }
    v2v_mem_free(sum);
    v2v_mem_free(alone);
}

/* Else the test above would prove nothing. */
static void another_order_gives_other_bits(void **state)
{
    float *forward = make(COUNT), *backward = make(COUNT);
    int64_t differing = 0;
    (void)state;
    add_alone(forward, 0, ITEMS, 1);
    add_alone(backward, ITEMS - 1, -1, -1);
    for (int64_t i = 0; i < COUNT; i++) {
        differing += forward[i] != backward[i];
    }
    print_message("%lld of %d sums differ when turned round\n", (long long)differing, (int)COUNT);
    assert_true(differing > COUNT / 4);
    v2v_mem_free(backward);
    v2v_mem_free(forward);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(permuted_ranks_and_any_threads_give_one_ranks_bits),
        cmocka_unit_test(another_order_gives_other_bits),
    };
    return test_mpi_main(tests, argc, argv);
}
