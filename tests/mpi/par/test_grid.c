#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/par/grid.h"

#include <string.h>

/** The ranks of a communicator as a bit set of world ranks. */
static int64_t members(const struct v2v_comm *comm)
{
    int64_t set = (int64_t)1 << v2v_comm_rank(test_world());
    v2v_par_sum_i64(comm, &set, 1);
    return set;
}

static void check_grid(int branches, int expected_branches)
{
    struct v2v_grid grid;
    const int size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    const int data_size = size / expected_branches;
    assert_ok(v2v_grid_create(&grid, test_world(), branches));
    assert_int_equal(grid.branch_size, expected_branches);
    assert_int_equal(grid.data_size, data_size);
    assert_ptr_equal(grid.world, test_world());
    int64_t pair = (int64_t)1 << rank, column = pair;
    if (rank >= data_size * expected_branches) {
        assert_int_equal(grid.idle, 1);
        assert_int_equal(grid.data_rank, -1);
        assert_int_equal(grid.branch_rank, -1);
    } else {
        assert_int_equal(grid.idle, 0);
        assert_int_equal(grid.data_rank, rank / expected_branches);
        assert_int_equal(grid.branch_rank, rank % expected_branches);
        assert_int_equal(v2v_comm_rank(grid.pair), grid.branch_rank);
        assert_int_equal(v2v_comm_rank(grid.column), grid.data_rank);
        pair = column = 0;
        for (int b = 0; b < expected_branches; b++) {
            pair |= (int64_t)1 << (grid.data_rank * expected_branches + b);
        }
        for (int d = 0; d < data_size; d++) {
            column |= (int64_t)1 << (d * expected_branches + grid.branch_rank);
        }
    }
    assert_int_equal(members(grid.pair), pair);
    assert_int_equal(members(grid.column), column);
    v2v_grid_destroy(&grid);
    assert_null(grid.pair);
    assert_null(grid.column);
}

static void one_branch_puts_every_rank_on_its_own_data(void **state)
{
    (void)state;
    check_grid(1, 1);
}

static void zero_branches_chooses_two_for_even_rank_counts(void **state)
{
    (void)state;
    check_grid(0, v2v_comm_size(test_world()) % 2 == 0 ? 2 : 1);
}

static void two_branches_pair_ranks_and_leave_an_odd_one_idle(void **state)
{
    (void)state;
    if (v2v_comm_size(test_world()) == 1) {
        struct v2v_grid grid;
        assert_int_equal(v2v_grid_create(&grid, test_world(), 2), V2V_E_CONFIG);
        assert_non_null(strstr(v2v_status_message(), "parallel.branches"));
        return;
    }
    check_grid(2, 2);
}

static void other_branch_counts_are_refused(void **state)
{
    (void)state;
    struct v2v_grid grid;
    assert_int_equal(v2v_grid_create(&grid, test_world(), 3), V2V_E_CONFIG);
    assert_int_equal(v2v_grid_create(&grid, test_world(), -1), V2V_E_CONFIG);
}

static void rank_alone_has_a_grid_of_one(void **state)
{
    (void)state;
    struct v2v_grid grid;
    assert_ok(v2v_grid_create(&grid, NULL, 0));
    assert_int_equal(grid.data_size, 1);
    assert_int_equal(grid.branch_size, 1);
    assert_int_equal(grid.idle, 0);
    v2v_grid_destroy(&grid);
}

static void memory_that_is_short_on_one_rank_fails_on_all(void **state)
{
    (void)state;
    struct v2v_grid grid;
    const int last = v2v_comm_size(test_world()) - 1;
    size_t held = v2v_mem_held();
    if (v2v_comm_rank(test_world()) == last) {
        v2v_mem_set_limit(held + 1);
    }
    enum v2v_status rc = v2v_grid_create(&grid, test_world(), 1);
    v2v_mem_set_limit(0);
    assert_int_equal(rc, V2V_E_MEMORY);
    assert_int_equal(v2v_mem_held(), held);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_branch_puts_every_rank_on_its_own_data),
        cmocka_unit_test(zero_branches_chooses_two_for_even_rank_counts),
        cmocka_unit_test(two_branches_pair_ranks_and_leave_an_odd_one_idle),
        cmocka_unit_test(other_branch_counts_are_refused),
        cmocka_unit_test(rank_alone_has_a_grid_of_one),
        cmocka_unit_test(memory_that_is_short_on_one_rank_fails_on_all),
    };
    return test_mpi_main(tests, argc, argv);
}
