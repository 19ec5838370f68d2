/* Training at any rank count: the same bits as one rank, and runs that go on bit for bit. */
#include "small_run.h"

#include "v2v3d/base/stop.h"
#include "v2v3d/op/bf16.h"

#include <string.h>

static void setup(struct scene *scene, int64_t batch)
{
    scene_init(scene, test_folder(test_world()), batch, test_world());
    scene_record(scene, "recording.h5", scene_wave);
    /* From this start round-off grows fourfold a step: a sum in another order, 1e-8 of the first
     * gradient, would be 1e-1 of the twentieth loss. */
    scene->config.train.init = V2V_RULE_HE;
}

static void read_arenas(struct scene *scene, const char *name, float **arenas, int64_t *count)
{
    char path[PATH];
    snprintf(path, sizeof path, "%s/%s/weights.h5", scene->folder, name);
    assert_ok(scene_arenas(scene, path, arenas, count));
}

/* Weights and moments of two runs' newest checkpoints. */
static void assert_same_bits(struct scene *scene, const char *one, const char *other)
{
    float *a = NULL, *b = NULL;
    int64_t count = 0, other_count = 0;
    read_arenas(scene, one, &a, &count);
    read_arenas(scene, other, &b, &other_count);
    assert_int_equal(count, other_count);
    assert_memory_equal(a, b, (size_t)count * sizeof *a);
    v2v_mem_free(a);
    v2v_mem_free(b);
}

/* One rank computes all slabs of a crop, or as many ranks one each. */
static void use_slabs(struct scene *scene, int64_t slabs, int64_t shards)
{
    scene->config.train.crop = SIDE;
    scene->config.parallel.slabs = slabs;
    scene->config.parallel.shards = shards;
}

static void check_against_one_rank(int64_t batch, int64_t branches, int64_t slabs, int precision)
{
    struct scene scene;
    double alone = 0.0;
    setup(&scene, batch);
    scene.config.train.precision = precision;
    if (slabs > 1) {
        use_slabs(&scene, slabs, slabs);
        /* Either exchange of the projector gives the bits of one rank, which has none. */
        scene.config.parallel.transform = slabs == 2 ? V2V_TRANSFORM_FFTW3_MPI : V2V_TRANSFORM_OWN;
    }
    double together = scene_train(&scene, "together", branches, 20, 0, test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        scene.config.parallel.shards = 0;
        alone = scene_train(&scene, "alone", 1, 20, 0, NULL);
        print_message("loss after 20 steps: %.9g, on one rank %.9g\n", together, alone);
    }
    v2v_par_broadcast(test_world(), &alone, sizeof alone, 0);
    assert_true(isfinite(alone));
    /* the loss is a sum of doubles over ranks: their order shows in its last bits */
    assert_true(fabs(together - alone) <= 1e-12 * fabs(alone));
    assert_same_bits(&scene, "together", "alone");
    scene_fini(&scene);
}

static void data_ranks_train_to_the_bits_of_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(3, 1, 1, V2V_PRECISION_F32);
}

static void branch_ranks_train_to_the_bits_of_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(2, v2v_comm_size(test_world()) > 1 ? 2 : 1, 1, V2V_PRECISION_F32);
}

static void more_ranks_than_samples_train_to_the_bits_of_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(1, 1, 1, V2V_PRECISION_F32);
}

static double change(double value, double from)
{
    return fabs(value - from) / from;
}

/* Ranks that share a crop; four ranks share its branches, too. */
static int64_t shards(void)
{
    int64_t size = v2v_comm_size(test_world());
    return size == 4 ? 2 : size;
}

static void slab_ranks_train_to_the_bits_of_one_rank_with_as_many_slabs(void **state)
{
    (void)state;
    check_against_one_rank(1, v2v_comm_size(test_world()) / shards(), shards(), V2V_PRECISION_F32);
}

/* Three ranks: the third takes part in the steps' numbers alone. */
static void a_rank_left_over_by_slabs_leaves_the_bits_alone(void **state)
{
    (void)state;
    if (v2v_comm_size(test_world()) != 3) {
        test_skip("only three ranks leave one over");
    }
    check_against_one_rank(1, 1, 2, V2V_PRECISION_F32);
}

/* The bar for sums in another order: 1e-4 after 20 steps. It holds from `kaiming` and at
 * this learning rate; from `he` the last bits decide, and at 1e-3 the kernels of AVX2 and of
 * AVX-512 part by 2e-4. */
static void slabs_train_like_a_whole_crop(void **state)
{
    (void)state;
    struct scene scene;
    double loss[2];
    setup(&scene, 1);
    scene.config.train.init = V2V_RULE_KAIMING;
    scene.config.train.learning_rate = 1e-4;
    use_slabs(&scene, 1, 1);
    loss[0] = scene_train(&scene, "whole", 1, 20, 0, test_world());
    use_slabs(&scene, 2, shards() == 2 ? 2 : 1);
    loss[1] = scene_train(&scene, "slabs", 1, 20, 0, test_world());
    print_message("loss after 20 steps: %.9g, in two slabs %.9g\n", loss[0], loss[1]);
    assert_true(loss[0] != loss[1] && change(loss[1], loss[0]) <= 1e-4);
    scene_fini(&scene);
}

static void skip_without_bf16(void)
{
    if (v2v_op_bf16() == V2V_BF16_NONE) {
        test_skip("no bf16 convolutions on this processor");
    }
}

static void branch_ranks_train_to_the_bits_of_one_rank_in_bf16(void **state)
{
    (void)state;
    skip_without_bf16();
    check_against_one_rank(2, v2v_comm_size(test_world()) > 1 ? 2 : 1, 1,
                           V2V_PRECISION_BF16_ALWAYS);
}

/* The bar: the losses stay within 2 %. At this learning rate two ways of float32,
 * Winograd and direct, part by 0.3 % in as many steps; at 1e-3 by 3 %, which would say nothing
 * about bf16. Equal losses would mean that it was not taken. */
static void a_run_in_bf16_follows_the_run_in_float32(void **state)
{
    (void)state;
    enum { STEPS = 50 };
    struct scene scene;
    char name[32];
    double first = 0.0, last[2] = {0.0};
    skip_without_bf16();
    setup(&scene, 2);
    scene.config.model.width = 8;
    scene.config.train.learning_rate = 1e-4;
    first = scene_train(&scene, "first", 1, 1, 0, test_world());
    for (int i = 0; i < 2; i++) {
        scene.config.train.precision = i == 0 ? V2V_PRECISION_F32 : V2V_PRECISION_BF16_ALWAYS;
        snprintf(name, sizeof name, "precision%d", i);
        last[i] = scene_train(&scene, name, 1, STEPS, 0, test_world());
    }
    print_message("loss %.9g, after %d steps %.9g, in bf16 %.9g\n", first, STEPS, last[0], last[1]);
    assert_true(last[0] < 0.9 * first);
    assert_true(last[0] != last[1] && change(last[1], last[0]) <= 0.02);
    scene_fini(&scene);
}

static void ten_and_ten_steps_equal_twenty_bit_for_bit(void **state)
{
    (void)state;
    struct scene scene;
    int64_t branches = v2v_comm_size(test_world()) > 1 ? 2 : 1;
    setup(&scene, 2);
    double loss = scene_train(&scene, "whole", branches, 20, 0, test_world());
    (void)scene_train(&scene, "parts", branches, 10, 0, test_world());
    double resumed = scene_train(&scene, "parts", branches, 20, 1, test_world());
    assert_true(loss == resumed);
    assert_same_bits(&scene, "whole", "parts");
    scene_fini(&scene);
}

static void a_checkpoint_resumes_on_another_rank_count(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene, 2);
    (void)scene_train(&scene, "shared", v2v_comm_size(test_world()) > 1 ? 2 : 1, 10, 0,
                      test_world());
    (void)scene_train(&scene, "whole", 1, 20, 0, test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        (void)scene_train(&scene, "shared", 1, 20, 1, NULL);
    }
    v2v_par_barrier(test_world());
    assert_same_bits(&scene, "whole", "shared");
    scene_fini(&scene);
}

static void a_stop_request_on_one_rank_checkpoints_on_all(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH], weights[PATH + 16];
    struct v2v_train_report report;
    struct v2v_weights_info info;
    setup(&scene, 1);
    struct v2v_train_job job = scene_job(&scene, run, "stopped");
    job.max_time_s = 1e-9;
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_STOPPED);
    assert_int_equal(report.steps, 1);
    snprintf(weights, sizeof weights, "%s/weights.h5", run);
    assert_ok(v2v_weights_file_info(&info, weights));
    assert_int_equal(info.step, 1);
    scene_fini(&scene);
}

static void a_folder_with_a_run_is_refused(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH];
    struct v2v_train_report report;
    setup(&scene, 1);
    (void)scene_train(&scene, "run", 1, 2, 0, test_world());
    struct v2v_train_job job = scene_job(&scene, run, "run");
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_E_USAGE);
    assert_non_null(strstr(v2v_status_message(), "--resume"));
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_ranks_train_to_the_bits_of_one_rank),
        cmocka_unit_test(branch_ranks_train_to_the_bits_of_one_rank),
        cmocka_unit_test(more_ranks_than_samples_train_to_the_bits_of_one_rank),
        cmocka_unit_test(slab_ranks_train_to_the_bits_of_one_rank_with_as_many_slabs),
        cmocka_unit_test(a_rank_left_over_by_slabs_leaves_the_bits_alone),
        cmocka_unit_test(slabs_train_like_a_whole_crop),
        cmocka_unit_test(branch_ranks_train_to_the_bits_of_one_rank_in_bf16),
        cmocka_unit_test(a_run_in_bf16_follows_the_run_in_float32),
        cmocka_unit_test(ten_and_ten_steps_equal_twenty_bit_for_bit),
        cmocka_unit_test(a_checkpoint_resumes_on_another_rank_count),
        cmocka_unit_test(a_stop_request_on_one_rank_checkpoints_on_all),
        cmocka_unit_test(a_folder_with_a_run_is_refused),
    };
    return scene_mpi_main(tests, argc, argv);
}
