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

/** World ranks of data x branch x shard, those of -1 running over all. */
static int64_t ranks_of(const struct v2v_grid *grid, int data, int branch, int shard)
{
    int64_t set = 0;
    for (int d = 0; d < grid->data_size; d++) {
        for (int b = 0; b < grid->branch_size; b++) {
            for (int s = 0; s < grid->shard_size; s++) {
                int is_in = (data < 0 || d == data) && (branch < 0 || b == branch) &&
                            (shard < 0 || s == shard);
                int rank = (d * grid->branch_size + b) * grid->shard_size + s;
                set |= is_in ? (int64_t)1 << rank : 0;
            }
        }
    }
    return set;
}

static void check_grid(int branches, int shards)
{
    struct v2v_grid grid;
    const struct v2v_grid_shape shape = {branches, shards};
    const int size = v2v_comm_size(test_world()), rank = v2v_comm_rank(test_world());
    assert_ok(v2v_grid_create(&grid, test_world(), &shape));
    assert_int_equal(grid.branch_size, branches);
    assert_int_equal(grid.shard_size, shards);
    assert_int_equal(grid.data_size, size / (branches * shards));
    assert_ptr_equal(grid.world, test_world());
    if (rank >= grid.data_size * branches * shards) {
        const int64_t alone = (int64_t)1 << rank;
        assert_int_equal(grid.idle, 1);
        assert_true(grid.data_rank == -1 && grid.branch_rank == -1 && grid.shard_rank == -1);
        assert_true(members(grid.shard) == alone && members(grid.pair) == alone &&
                    members(grid.sample) == alone && members(grid.column) == alone);
    } else {
        int d = grid.data_rank, b = grid.branch_rank, s = grid.shard_rank;
        assert_int_equal(grid.idle, 0);
        assert_int_equal((d * branches + b) * shards + s, rank);
        assert_int_equal(v2v_comm_rank(grid.column), d);
        assert_int_equal(v2v_comm_rank(grid.pair), b);
        assert_int_equal(v2v_comm_rank(grid.shard), s);
        assert_int_equal(v2v_comm_rank(grid.sample), b * grid.shard_size + s);
        assert_int_equal(members(grid.sample), ranks_of(&grid, d, -1, -1));
        assert_int_equal(members(grid.column), ranks_of(&grid, -1, b, s));
        assert_int_equal(members(grid.pair), ranks_of(&grid, d, -1, s));
        assert_int_equal(members(grid.shard), ranks_of(&grid, d, b, -1));
    }
    v2v_grid_destroy(&grid);
    assert_null(grid.shard);
    assert_null(grid.pair);
    assert_null(grid.sample);
    assert_null(grid.column);
}

static void every_shape_that_fits_lays_out_data_branches_and_shards(void **state)
{
    (void)state;
    const int size = v2v_comm_size(test_world());
    for (int branches = 1; branches <= 2; branches++) {
        for (int shards = 1; branches * shards <= size; shards++) {
            check_grid(branches, shards);
        }
    }
}

static void shapes_of_more_ranks_than_there_are_are_refused(void **state)
{
    (void)state;
    struct v2v_grid grid;
    struct v2v_grid_shape shape = {1, v2v_comm_size(test_world()) + 1};
    assert_int_equal(v2v_grid_create(&grid, test_world(), &shape), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "parallel.shards"));
    shape = (struct v2v_grid_shape){2, v2v_comm_size(test_world())};
    assert_int_equal(v2v_grid_create(&grid, test_world(), &shape), V2V_E_CONFIG);
    shape = (struct v2v_grid_shape){3, 1};
    assert_int_equal(v2v_grid_create(&grid, test_world(), &shape), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "outside [0, 2]"));
}

static void rank_alone_has_a_grid_of_one(void **state)
{
    (void)state;
    struct v2v_grid grid;
    assert_ok(v2v_grid_create(&grid, NULL, &(struct v2v_grid_shape){1, 1}));
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
    enum v2v_status rc = v2v_grid_create(&grid, test_world(), &(struct v2v_grid_shape){1, 1});
    v2v_mem_set_limit(0);
    assert_int_equal(rc, V2V_E_MEMORY);
    assert_int_equal(v2v_mem_held(), held);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_shape_that_fits_lays_out_data_branches_and_shards),
        cmocka_unit_test(shapes_of_more_ranks_than_there_are_are_refused),
        cmocka_unit_test(rank_alone_has_a_grid_of_one),
        cmocka_unit_test(memory_that_is_short_on_one_rank_fails_on_all),
    };
    return test_mpi_main(tests, argc, argv);
}
