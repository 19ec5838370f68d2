/* The folder of a run: generations of checkpoints, what --resume and --force make of them. */
#include "small_run.h"

#include "v2v3d/io/file.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

/* A run with a checkpoint after every step. */
static void setup(struct scene *scene)
{
    scene_init(scene, test_folder(test_world()), 1, test_world());
    scene_record(scene, "recording.h5", scene_wave);
    scene->config.train.checkpoint_every_s = 0.0;
}

enum mode { FRESH, RESUME, FORCE };

static enum v2v_status train(struct scene *scene, int64_t steps, enum mode mode,
                             struct v2v_train_report *report)
{
    char run[PATH];
    struct v2v_train_job job = scene_job(scene, run, "run");
    scene->config.train.steps = steps;
    job.resume = mode == RESUME;
    job.force = mode == FORCE;
    return v2v_train_run(&job, report, test_world());
}

static enum v2v_status train_to(struct scene *scene, int64_t steps, enum mode mode)
{
    struct v2v_train_report report;
    return train(scene, steps, mode, &report);
}

static char *file_of(struct scene *scene, const char *name)
{
    static char path[PATH];
    snprintf(path, sizeof path, "%s/run/%s", scene->folder, name);
    return path;
}

/* Collective: rank 0 reads, reading is slow under the sanitizer. */
static int64_t step_of(struct scene *scene, const char *name)
{
    int64_t step = 0;
    if (v2v_comm_rank(test_world()) == 0 && v2v_file_exists(file_of(scene, name))) {
        step = scene_step(scene, file_of(scene, name));
    }
    v2v_par_broadcast(test_world(), &step, sizeof step, 0);
    return step;
}

static int64_t log_lines(struct scene *scene)
{
    int64_t lines = 0;
    FILE *log = fopen(file_of(scene, "metrics.jsonl"), "re");
    for (int c = log != NULL ? fgetc(log) : EOF; c != EOF; c = fgetc(log)) {
        lines += c == '\n';
    }
    if (log != NULL) {
        fclose(log);
    }
    return lines;
}

/* Rank 0 alone changes files; the others wait for it. */
static void damage(struct scene *scene, const char *name)
{
    v2v_par_barrier(test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        assert_int_equal(truncate(file_of(scene, name), 1000), 0);
    }
    v2v_par_barrier(test_world());
}

static void resuming_without_a_checkpoint_starts_at_step_0(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 1, RESUME));
    assert_int_equal(step_of(&scene, "weights.h5"), 1);
    assert_int_equal(log_lines(&scene), 1);
    scene_fini(&scene);
}

static void resuming_a_finished_run_keeps_both_generations(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 3, FRESH));
    v2v_par_barrier(test_world());
    assert_ok(train_to(&scene, 3, RESUME));
    assert_int_equal(step_of(&scene, "weights.h5"), 3);
    assert_int_equal(step_of(&scene, "weights.prev.h5"), 2);
    assert_int_equal(log_lines(&scene), 3);
    scene_fini(&scene);
}

static void a_damaged_checkpoint_never_replaces_the_good_one(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 3, FRESH));
    damage(&scene, "weights.h5");
    assert_ok(train_to(&scene, 2, RESUME)); /* nothing to do but to find the good one */
    assert_int_equal(step_of(&scene, "weights.h5"), 2);
    v2v_par_barrier(test_world());
    assert_ok(train_to(&scene, 3, RESUME));
    assert_int_equal(step_of(&scene, "weights.h5"), 3);
    assert_int_equal(step_of(&scene, "weights.prev.h5"), 2);
    assert_int_equal(step_of(&scene, "weights.bad.h5"), -1);
    assert_int_equal(log_lines(&scene), 3);
    scene_fini(&scene);
}

static void two_damaged_checkpoints_are_bad_input(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 2, FRESH));
    damage(&scene, "weights.h5");
    damage(&scene, "weights.prev.h5");
    assert_int_equal(train_to(&scene, 3, RESUME), V2V_E_INPUT);
    assert_int_equal(log_lines(&scene), 2);
    scene_fini(&scene);
}

static void forcing_leaves_nothing_of_the_older_run(void **state)
{
    (void)state;
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 3, FRESH));
    v2v_par_barrier(test_world());
    assert_ok(train_to(&scene, 1, FORCE));
    assert_int_equal(step_of(&scene, "weights.h5"), 1);
    assert_int_equal(step_of(&scene, "weights.prev.h5"), 0);
    assert_int_equal(log_lines(&scene), 1);
    scene_fini(&scene);
}

static int64_t config_bytes(struct scene *scene)
{
    FILE *file = fopen(file_of(scene, "config.yaml"), "re");
    assert_non_null(file);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    int64_t bytes = ftell(file);
    fclose(file);
    return bytes;
}

static void a_run_that_cannot_start_leaves_the_older_one_alone(void **state)
{
    (void)state;
    static const enum mode mode[] = {FORCE, RESUME};
    struct scene scene;
    setup(&scene);
    assert_ok(train_to(&scene, 2, FRESH));
    int64_t bytes = config_bytes(&scene);
    v2v_par_barrier(test_world());
    scene.config.train.crop = 2 * SIDE;
    for (int i = 0; i < 2; i++) {
        assert_int_equal(train_to(&scene, 1000000, mode[i]), V2V_E_INPUT);
        assert_int_equal(step_of(&scene, "weights.h5"), 2);
        assert_int_equal(step_of(&scene, "weights.prev.h5"), 1);
        assert_int_equal(config_bytes(&scene), bytes);
        assert_int_equal(log_lines(&scene), 2);
    }
    scene_fini(&scene);
}

/* So it is after a write that failed: the older one was kept, the newer one never came. */
static void generations_that_are_one_file_leave_no_temporary(void **state)
{
    (void)state;
    struct scene scene;
    char newest[PATH];
    setup(&scene);
    assert_ok(train_to(&scene, 2, FRESH));
    v2v_par_barrier(test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        snprintf(newest, sizeof newest, "%s", file_of(&scene, "weights.h5"));
        assert_int_equal(unlink(file_of(&scene, "weights.prev.h5")), 0);
        assert_int_equal(link(newest, file_of(&scene, "weights.prev.h5")), 0);
    }
    v2v_par_barrier(test_world());
    assert_ok(train_to(&scene, 3, RESUME));
    assert_int_equal(step_of(&scene, "weights.h5"), 3);
    assert_int_equal(step_of(&scene, "weights.prev.h5"), 2);
    assert_false(v2v_file_exists(file_of(&scene, "weights.prev.h5.v2v3d-part")));
    assert_false(v2v_file_exists(file_of(&scene, "weights.h5.v2v3d-part")));
    scene_fini(&scene);
}

static void a_folder_that_is_held_is_busy(void **state)
{
    (void)state;
    struct scene scene;
    int held = -1;
    setup(&scene);
    assert_ok(train_to(&scene, 1, FRESH));
    v2v_par_barrier(test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        held = open(file_of(&scene, "lock"), O_RDWR | O_CLOEXEC);
        assert_true(held >= 0);
        assert_int_equal(flock(held, LOCK_EX), 0);
    }
    v2v_par_barrier(test_world());
    for (int mode = FRESH; mode <= FORCE; mode++) {
        assert_int_equal(train_to(&scene, 2, (enum mode)mode), V2V_E_BUSY);
    }
    assert_int_equal(step_of(&scene, "weights.h5"), 1);
    if (held >= 0) {
        close(held);
    }
    scene_fini(&scene);
}

/* Squares of the gradient leave float32 here: views of 1e12, a weight of 1e9. The weights are never
 * stepped, and no checkpoint says that they are good. */
static void gradients_too_large_to_square_step_nothing(void **state)
{
    (void)state;
    struct scene scene;
    struct v2v_train_report report;
    setup(&scene);
    scene.config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, 1e12};
    scene.config.loss.weight[V2V_LOSS_MSE] = (struct v2v_number){V2V_NUMBER_GIVEN, 1e9};
    assert_int_equal(train(&scene, 30, FRESH, &report), V2V_E_NUMERIC);
    assert_int_equal(report.steps, 10);
    assert_non_null(strstr(v2v_status_message(), "there is no checkpoint"));
    assert_false(v2v_file_exists(file_of(&scene, "weights.h5")));
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(resuming_without_a_checkpoint_starts_at_step_0),
        cmocka_unit_test(resuming_a_finished_run_keeps_both_generations),
        cmocka_unit_test(a_damaged_checkpoint_never_replaces_the_good_one),
        cmocka_unit_test(two_damaged_checkpoints_are_bad_input),
        cmocka_unit_test(forcing_leaves_nothing_of_the_older_run),
        cmocka_unit_test(a_run_that_cannot_start_leaves_the_older_one_alone),
        cmocka_unit_test(generations_that_are_one_file_leave_no_temporary),
        cmocka_unit_test(a_folder_that_is_held_is_busy),
        cmocka_unit_test(gradients_too_large_to_square_step_nothing),
    };
    return scene_mpi_main(tests, argc, argv);
}
