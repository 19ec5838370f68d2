/* Which process grid a run gets. */
#include "support.h"

#include "v2v3d/par/grid.h"

#include <string.h>

static const struct v2v_grid_shape any = {0, 0};

static struct v2v_grid_work frames_of(int64_t items)
{
    return (struct v2v_grid_work){.items = items,
                                  .height = 512,
                                  .unit = 32,
                                  .margin = 8,
                                  .most_shards = 64,
                                  .most_branches = 2};
}

static void assert_choice(const struct v2v_grid_shape *wanted, const struct v2v_grid_work *work,
                          int ranks, int branches, int shards)
{
    struct v2v_grid_shape shape;
    assert_ok(v2v_grid_choose(&shape, wanted, work, ranks));
    if (shape.branches != branches || shape.shards != shards) {
        fail_msg("%lld items on %d ranks: %d x %d, not %d x %d", (long long)work->items, ranks,
                 shape.branches, shape.shards, branches, shards);
    }
}

static void many_frames_go_side_by_side(void **state)
{
    (void)state;
    struct v2v_grid_work work = frames_of(100);
    for (int ranks = 1; ranks <= 5; ranks++) {
        assert_choice(&any, &work, ranks, 1, 1);
    }
    assert_choice(&any, &work, 50, 1, 1);
}

static void one_frame_is_parted_by_branches_then_by_rows(void **state)
{
    (void)state;
    struct v2v_grid_work work = frames_of(1);
    assert_choice(&any, &work, 1, 1, 1);
    assert_choice(&any, &work, 2, 2, 1);
    assert_choice(&any, &work, 4, 2, 2);
    assert_choice(&any, &work, 8, 2, 4);
    assert_choice(&any, &work, 3, 1, 3);
}

static void frames_that_leave_ranks_over_are_parted(void **state)
{
    (void)state;
    struct v2v_grid_work work = frames_of(2);
    assert_choice(&any, &work, 4, 2, 1);
    assert_choice(&any, &work, 8, 2, 2);
}

static void what_is_asked_for_is_kept(void **state)
{
    (void)state;
    struct v2v_grid_work work = frames_of(100);
    assert_choice(&(struct v2v_grid_shape){2, 0}, &work, 4, 2, 1);
    assert_choice(&(struct v2v_grid_shape){0, 4}, &work, 4, 1, 4);
    assert_choice(&(struct v2v_grid_shape){2, 2}, &work, 7, 2, 2);
    work.most_shards = 1;
    work.items = 1;
    assert_choice(&any, &work, 8, 2, 1);
}

static void short_memory_takes_slabs_where_speed_would_not(void **state)
{
    (void)state;
    struct v2v_grid_work work = frames_of(100);
    work.bytes = 10;
    work.fixed_bytes = 2;
    work.most_bytes = 10;
    assert_choice(&any, &work, 2, 1, 1);
    work.most_bytes = 7; /* half of the rows and a margin: 2 + 8 * (256 + 8) / 512 */
    assert_choice(&any, &work, 2, 1, 2);
    work.most_bytes = 3; /* nothing fits: as if there were no limit */
    assert_choice(&any, &work, 2, 1, 1);
}

static void more_than_there_are_ranks_is_refused(void **state)
{
    (void)state;
    struct v2v_grid_shape shape;
    const struct v2v_grid_work work = frames_of(1);
    const struct v2v_grid_shape wanted = {2, 3};
    assert_int_equal(v2v_grid_choose(&shape, &wanted, &work, 5), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "2 x 3 need 6 ranks, this run has 5"));
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(many_frames_go_side_by_side),
        cmocka_unit_test(one_frame_is_parted_by_branches_then_by_rows),
        cmocka_unit_test(frames_that_leave_ranks_over_are_parted),
        cmocka_unit_test(what_is_asked_for_is_kept),
        cmocka_unit_test(short_memory_takes_slabs_where_speed_would_not),
        cmocka_unit_test(more_than_there_are_ranks_is_refused),
    };
    (void)argc;
    (void)argv;
    return cmocka_run_group_tests(tests, NULL, NULL);
}
