/* The account of time spent on communication. */
#include "support.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/par/time.h"

#include <math.h>
#include <time.h>

static void rest(void)
{
    const struct timespec some = {0, 50000000};
    nanosleep(&some, NULL);
}

/* Ranks of one host share the monotonic clock: who entered the barrier before the last rank did was
 * inside it for the difference at least, and for no longer than it took by its own clock. */
static void waiting_for_another_rank_is_counted(void **state)
{
    (void)state;
    v2v_par_barrier(test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        rest();
    }
    struct v2v_par_time before = v2v_par_time_now(), after;
    double last = before.clock;
    v2v_par_barrier(test_world());
    after = v2v_par_time_now();
    double spent = v2v_par_spent_between(&before, &after), inside = after.clock - before.clock;
    v2v_par_max_f64(test_world(), &last, 1);
    assert_true(spent <= inside);
    if (v2v_comm_size(test_world()) > 1) {
        /* the two clocks are read in a row, not at once: what lies between may hide a scheduler */
        assert_true(spent > 0.0 && spent >= last - before.clock - (inside - spent));
    } else {
        assert_true(spent == 0.0);
    }
}

static void every_collective_is_booked_under_its_kind(void **state)
{
    (void)state;
    enum { COUNT = 1000 };
    static float x[COUNT], y[COUNT];
    double most[2] = {0};
    int size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    int64_t count[64] = {0}, offset[64] = {0};
    assert_true(size <= 64);
    count[0] = 1;
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        for (int call = 0; call < 2; call++) {
            struct v2v_par_time before = v2v_par_time_now();
            switch (2 * kind + call) {
            case 2 * V2V_PAR_AGREE:
                assert_ok(v2v_par_agree(test_world(), V2V_OK));
                break;
            case 2 * V2V_PAR_AGREE + 1:
                v2v_par_barrier(test_world());
                break;
            case 2 * V2V_PAR_SUM:
                v2v_par_sum_f32(test_world(), x, COUNT);
                break;
            case 2 * V2V_PAR_SUM + 1:
                v2v_par_max_f64(test_world(), most, 2);
                break;
            case 2 * V2V_PAR_SPREAD:
                v2v_par_broadcast(test_world(), y, sizeof y, 0);
                break;
            case 2 * V2V_PAR_SPREAD + 1:
                v2v_par_allgather_f32(test_world(), y, x, count, offset);
                break;
            default:
                v2v_par_exchange_f32(test_world(), y, x, COUNT,
                                     (rank ^ 1) < size ? rank ^ 1 : rank);
            }
            struct v2v_par_time after = v2v_par_time_now();
            for (int other = 0; other < V2V_PAR_KINDS; other++) {
                int alone = kind == V2V_PAR_EXCHANGE ? (rank ^ 1) >= size : size == 1;
                assert_int_equal(after.spent[other] > before.spent[other], other == kind && !alone);
            }
        }
    }
}

static void shares_are_parts_of_the_time_and_the_same_on_all_ranks(void **state)
{
    (void)state;
    struct v2v_par_time since = v2v_par_time_now();
    if (v2v_comm_rank(test_world()) == 0) {
        rest();
    }
    v2v_par_barrier(test_world());
    struct v2v_par_shares shares = v2v_par_shares_since(test_world(), &since);
    double sum = 0.0, most[2] = {shares.mean, -shares.mean};
    for (int kind = 0; kind < V2V_PAR_KINDS; kind++) {
        assert_true(shares.kind[kind] >= 0.0);
        sum += shares.kind[kind];
    }
    assert_true(fabs(sum - shares.mean) <= 4.0 * 2.3e-16);
    /* the mean of a few equal numbers may round to above their maximum */
    assert_true(shares.largest <= 1.0 && shares.mean <= shares.largest * (1.0 + 1e-14));
    assert_in_range(shares.largest_rank, 0, v2v_comm_size(test_world()) - 1);
    v2v_par_max_f64(test_world(), most, 2);
    assert_true(most[0] == -most[1]);
    assert_int_equal(shares.mean > 0.0, v2v_comm_size(test_world()) > 1);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(waiting_for_another_rank_is_counted),
        cmocka_unit_test(every_collective_is_booked_under_its_kind),
        cmocka_unit_test(shares_are_parts_of_the_time_and_the_same_on_all_ranks),
    };
    return test_mpi_main(tests, argc, argv);
}
