/* One run on any number of ranks, in any grid: the same weights and moments, to the last bit. */
#include "program.h"

#include <string.h>

static void run_on(struct scene *scene, int ranks, int branches, int shards, char text[TEXT])
{
    char command[256];
    snprintf(
        command, sizeof command,
        TRAIN
        "run --force --reproducible --steps 4 --set train.batch=3 "
        "--set train.init=he --set train.crop=64 --set parallel.slabs=2 --set parallel.branches=%d "
        "--set parallel.shards=%d",
        branches, shards);
    if (program_run(scene, ranks, command, text) != 0) {
        fail_msg("%d ranks, branches %d, shards %d: %s", ranks, branches, shards, text);
    }
}

/* Round-off grows fourfold a step from this start: a sum in another order would show. */
static void every_rank_count_and_grid_gives_the_bits_of_one_rank(void **state)
{
    (void)state;
    static const struct {
        int ranks, branches, shards;
    } grids[] = {{1, 1, 1}, {2, 1, 1}, {2, 2, 1}, {2, 1, 2}, {3, 1, 1}, {3, 2, 1}, {3, 1, 2},
                 {4, 1, 1}, {4, 2, 1}, {4, 1, 2}, {4, 2, 2}, {5, 1, 1}, {5, 2, 1}, {5, 2, 2},
                 {7, 1, 1}, {7, 2, 1}, {7, 1, 2}, {8, 1, 1}, {8, 2, 1}, {8, 1, 2}, {8, 2, 2}};
    static char text[TEXT];
    struct scene scene;
    float *alone = NULL, *arenas = NULL;
    int64_t count = 0;
    program_init(&scene);
    for (size_t i = 0; i < sizeof grids / sizeof *grids; i++) {
        run_on(&scene, grids[i].ranks, grids[i].branches, grids[i].shards, text);
        assert_ok(scene_arenas(&scene, program_file(&scene, "run/weights.h5"), &arenas, &count));
        if (alone == NULL) {
            alone = arenas;
            continue;
        }
        if (memcmp(alone, arenas, (size_t)count * sizeof *alone) != 0) {
            fail_msg("%d ranks, branches %d, shards %d: not the bits of one rank", grids[i].ranks,
                     grids[i].branches, grids[i].shards);
        }
        v2v_mem_free(arenas);
    }
    v2v_mem_free(alone);
    scene_fini(&scene);
}

/* Bad memory on one rank: the job ends at the next comparison and says where. */
static void weights_that_part_end_the_job(void **state)
{
    (void)state;
    static char text[TEXT];
    struct scene scene;
#ifndef V2V_FAULTS
    test_skip("this build has no fault points: -DV2V_FAULTS=ON");
#endif
    program_init(&scene);
    setenv("V2V_FAULT", "train.weights:2:3", 1);
    int code = program_run(&scene, 3,
                           TRAIN "run --steps 20 --set parallel.branches=1 "
                                 "--set train.checkpoint_every_s=100 --set train.check_every=4",
                           text);
    unsetenv("V2V_FAULT");
    assert_int_equal(code, 70);
    assert_non_null(strstr(text, "after step 4 the weights of feat_extract on rank 2 are not those "
                                 "of rank 0"));
    assert_false(v2v_file_exists(program_file(&scene, "run/weights.h5")));
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_rank_count_and_grid_gives_the_bits_of_one_rank),
        cmocka_unit_test(weights_that_part_end_the_job),
    };
    return PROGRAM_OR_TESTS(tests, argc, argv);
}
