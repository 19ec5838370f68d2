/* Ranks whose weights have parted are found and named. */
#include "small_run.h"

#include "train/alike.h"
#include "v2v3d/nn/rule.h"

#include <omp.h>
#include <string.h>

/* A trainer's grid and weights; it needs no samples. */
static void setup(struct scene *scene, struct v2v_trainer *trainer, int64_t branches)
{
    char run[PATH];
    scene_init(scene, test_folder(test_world()), 1, test_world());
    scene_record(scene, "recording.h5", scene_wave);
    scene->config.parallel.branches = branches;
    struct v2v_train_job job = scene_job(scene, run, "run");
    assert_ok(v2v_trainer_create(trainer, &job, test_world()));
    assert_ok(v2v_rule_weights(&trainer->network->schema.fields, trainer->network->weights,
                               V2V_RULE_HE, 3));
}

static void fini(struct scene *scene, struct v2v_trainer *trainer)
{
    v2v_trainer_destroy(trainer);
    scene_fini(scene);
}

/* Flip the lowest bit of weight i on one rank, and back again on the second call. */
static void flip(struct v2v_trainer *trainer, int rank, int64_t i)
{
    if (v2v_comm_rank(test_world()) == rank) {
        uint32_t bits = 0;
        memcpy(&bits, &trainer->network->weights[i], sizeof bits);
        bits ^= 1;
        memcpy(&trainer->network->weights[i], &bits, sizeof bits);
    }
}

static void check_flip(struct v2v_trainer *trainer, int rank, int64_t i, const char *part)
{
    char expected[128];
    int size = v2v_comm_size(test_world());
    /* of two ranks that differ the lower one is taken to be right, else the majority */
    int named = size == 2 ? 1 : rank, right = size == 2 ? 0 : rank == 0;
    flip(trainer, rank, i);
    assert_int_equal(v2v_alike_weights(trainer, 42), V2V_E_INTERNAL);
    snprintf(expected, sizeof expected,
             "after step 42 the weights of %s on rank %d are not those of rank %d:", part, named,
             right);
    assert_non_null(strstr(v2v_status_message(), expected));
    flip(trainer, rank, i);
    assert_ok(v2v_alike_weights(trainer, 43));
}

static void one_flipped_bit_is_found_on_any_rank_in_any_part(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_trainer trainer;
    setup(&scene, &trainer, 1);
    assert_ok(v2v_alike_weights(&trainer, 41));
    for (int rank = 0; rank < v2v_comm_size(test_world()) && v2v_comm_size(test_world()) > 1;
         rank++) {
        const struct v2v_schema *schema = &trainer.network->schema;
        for (int64_t g = 0; g < schema->groups; g++) {
            const struct v2v_group *group = &schema->group[g];
            check_flip(&trainer, rank, group->first, group->name);
            check_flip(&trainer, rank, group->first + group->count - 1, group->name);
        }
    }
    fini(&scene, &trainer);
}

/* Branches on different ranks share the encoder alone; a left-over rank is not asked. */
static void branches_are_compared_with_their_own(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_trainer trainer;
    int size = v2v_comm_size(test_world());
    if (size == 1) {
        test_skip("one rank has nobody to compare with");
    }
    setup(&scene, &trainer, 2);
    const int64_t own = trainer.network->schema.group[0].first;
    assert_ok(v2v_alike_weights(&trainer, 1));
    flip(&trainer, 0, own); /* who holds unet1 beside rank 0? */
    assert_int_equal(v2v_alike_weights(&trainer, 2), size >= 4 ? V2V_E_INTERNAL : V2V_OK);
    flip(&trainer, 0, own);
    flip(&trainer, 1, 5);
    assert_int_equal(v2v_alike_weights(&trainer, 3), V2V_E_INTERNAL);
    assert_non_null(strstr(v2v_status_message(), "the weights of feat_extract on rank 1 are"));
    flip(&trainer, 1, 5);
    if (size == 3) {
        flip(&trainer, 2, 5);
    }
    assert_ok(v2v_alike_weights(&trainer, 4));
    fini(&scene, &trainer);
}

/* Alone it would take both slabs of a crop: more memory than any rank that works. */
static void a_left_over_rank_plans_no_network(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_trainer trainer;
    char run[PATH];
    if (v2v_comm_size(test_world()) != 3) {
        test_skip("only three ranks leave one over");
    }
    scene_init(&scene, test_folder(test_world()), 1, test_world());
    scene_record(&scene, "recording.h5", scene_wave);
    scene.config.train.crop = SIDE;
    scene.config.parallel.slabs = scene.config.parallel.shards = 2;
    scene.config.parallel.branches = 1;
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_ok(v2v_trainer_create(&trainer, &job, test_world()));
    int64_t least = -(int64_t)v2v_mem_held(), held = (int64_t)v2v_mem_held();
    if (trainer.grid.idle) {
        least = -INT64_MAX;
    }
    v2v_par_max_i64(test_world(), &least, 1);
    if (trainer.grid.idle) {
        assert_true(held < -least / 2);
    }
    fini(&scene, &trainer);
}

static void reproducible_runs_refuse_ranks_of_different_threads(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_train_report report;
    char run[PATH];
    int size = v2v_comm_size(test_world());
    scene_init(&scene, test_folder(test_world()), 1, test_world());
    scene_record(&scene, "recording.h5", scene_wave);
    scene.config.train.steps = 1;
    scene.config.parallel.reproducible = 1;
    omp_set_num_threads(v2v_comm_rank(test_world()) == size - 1 ? 2 : 1);
    struct v2v_train_job job = scene_job(&scene, run, "threads");
    enum v2v_status rc = v2v_train_run(&job, &report, test_world());
    omp_set_num_threads(1);
    assert_int_equal(rc, size > 1 ? V2V_E_CONFIG : V2V_OK);
    if (size > 1) {
        assert_non_null(strstr(v2v_status_message(), "from 1 to 2 threads"));
    }
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_flipped_bit_is_found_on_any_rank_in_any_part),
        cmocka_unit_test(branches_are_compared_with_their_own),
        cmocka_unit_test(a_left_over_rank_plans_no_network),
        cmocka_unit_test(reproducible_runs_refuse_ranks_of_different_threads),
    };
    return scene_mpi_main(tests, argc, argv);
}
