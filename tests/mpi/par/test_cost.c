/* What data movement is said to cost: the same on all ranks, and lines over bytes and ranks. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/cost.h"
#include <math.h>
#include <time.h>

static void measured_figures_are_the_same_on_all_ranks_and_positive(void **state)
{
    struct v2v_comm_cost cost, first;
    const size_t held = v2v_mem_held();
    (void)state;
    assert_ok(v2v_comm_cost_measure(&cost, test_world()));
    assert_true(cost.sum_step_s == 0 && cost.sum_byte_s == 0);
    assert_ok(v2v_comm_cost_measure_sums(&cost, test_world()));
    assert_int_equal(v2v_mem_held(), held);
    first = cost;
    v2v_par_broadcast(test_world(), &first, (int64_t)sizeof first, 0);
    assert_int_equal(cost.ranks, v2v_comm_size(test_world()));
    const double figures[] = {cost.message_s, cost.byte_s, cost.sum_step_s, cost.sum_byte_s};
    const double others[] = {first.message_s, first.byte_s, first.sum_step_s, first.sum_byte_s};
    for (int i = 0; i < 4; i++) {
        assert_true(figures[i] == others[i]);
        assert_true(cost.ranks == 1 ? figures[i] == 0 : figures[i] > 0 && isfinite(figures[i]));
    }
}

static void a_rank_short_of_memory_fails_the_measurement_on_all(void **state)
{
    struct v2v_comm_cost cost;
    (void)state;
    if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
        v2v_mem_set_limit(v2v_mem_held() + 1000);
    }
    const size_t held = v2v_mem_held();
    assert_int_equal(v2v_comm_cost_measure(&cost, test_world()), V2V_E_MEMORY);
    assert_int_equal(v2v_comm_cost_measure_sums(&cost, test_world()), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_int_equal(v2v_mem_held(), held);
}

static void predictions_follow_the_lines(void **state)
{
    static const struct v2v_comm_cost cost = {2, 1e-6, 1e-9, 2e-6, 4e-9};
    (void)state;
    assert_true(v2v_comm_exchange_s(&cost, 1, 1e6, 3) == 0);
    assert_true(v2v_comm_allreduce_s(&cost, 1, 1e6) == 0);
    /* three turns of three messages, and a megabyte */
    assert_true(fabs(v2v_comm_exchange_s(&cost, 4, 1e6, 3) - (9e-6 + 1e-3)) < 1e-12);
    /* two times two steps, and 3/4 of a megabyte twice */
    assert_true(fabs(v2v_comm_allreduce_s(&cost, 4, 1e6) - (8e-6 + 6e-3)) < 1e-12);
}

struct sleeper {
    int rank;
    struct timespec time;
};

static void nap(const void *context)
{
    const struct sleeper *sleeper = context;
    if (v2v_comm_rank(test_world()) == sleeper->rank) {
        nanosleep(&sleeper->time, NULL);
    }
}

static void the_slowest_rank_is_what_counts(void **state)
{
    const struct sleeper last = {v2v_comm_size(test_world()) - 1, {0, 20000000}};
    (void)state;
    assert_true(v2v_comm_median_s(nap, &last, test_world()) >= 0.02);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(measured_figures_are_the_same_on_all_ranks_and_positive),
        cmocka_unit_test(a_rank_short_of_memory_fails_the_measurement_on_all),
        cmocka_unit_test(predictions_follow_the_lines),
        cmocka_unit_test(the_slowest_rank_is_what_counts),
    };
    return test_mpi_main(tests, argc, argv);
}
