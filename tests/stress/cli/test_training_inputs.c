/* Twenty steps of training on each input: the weights stay finite, or the run ends with what the
 * trainer promises. */
#include "hard_input.h"
#include "small_run.h"

#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum { STEPS = 20, HOT = 2 * SIDE * SIDE + 17 * SIDE + 5 };

static enum test_hard which;

static float hard(int t, int64_t i)
{
    return test_hard_sample(which, i + t, SIDE, HOT);
}

/* Of a run that ended well: all steps are in the checkpoint, weights and moments are finite. */
static void assert_trained(const struct scene *scene, const char *run,
                           const struct v2v_train_report *report)
{
    char path[2 * PATH];
    float *arenas = NULL;
    int64_t count = 0;
    snprintf(path, sizeof path, "%s/weights.h5", run);
    assert_int_equal(report->steps, STEPS);
    assert_true(isfinite(report->last_total));
    assert_int_equal(scene_step(scene, path), STEPS);
    assert_ok(scene_arenas(scene, path, &arenas, &count));
    assert_int_equal(v2v_first_not_finite(arenas, count), -1);
    v2v_mem_free(arenas);
}

/* One cell of the table: how it ended. Only what no gain helps may be refused, by the gain's name;
 * and a loss that leaves float32 ends the run with advice and a good checkpoint. */
static void train(struct scene *scene)
{
    char run[PATH];
    struct v2v_train_report report;
    struct v2v_train_job job = scene_job(scene, run, "run");
    int by_hand = scene->config.input.gain.mode == V2V_NUMBER_GIVEN;
    job.force = 1;
    enum v2v_status rc = v2v_train_run(&job, &report, NULL);
    print_message(" | %-10s %5lld %9.2e", v2v_status_name(rc), (long long)report.steps,
                  report.last_total);
    if (rc == V2V_OK) {
        assert_trained(scene, run, &report);
    } else if (rc == V2V_E_INPUT) {
        assert_true(!by_hand && (which == TEST_HARD_ZERO || which == TEST_HARD_SUBNORMAL));
        assert_non_null(strstr(v2v_status_message(), "input.gain"));
    } else {
        assert_int_equal(rc, V2V_E_NUMERIC);
        assert_non_null(strstr(v2v_status_message(), "train.learning_rate"));
    }
}

static void twenty_steps_stay_finite_or_end_with_advice(void **state)
{
    struct scene scene;
    (void)state;
    scene_init(&scene, test_folder(NULL), 1, NULL);
    scene.config.train.steps = STEPS;
    print_message("%-10s | %-26s | %-26s\n", "recording", "offset and gain automatic",
                  "taken as it is");
    for (int i = 0; i < TEST_HARD_INPUTS; i++) {
        which = (enum test_hard)i;
        scene_record(&scene, "hard.h5", hard);
        print_message("%-10s", test_hard_name(which));
        scene.config.input.offset = (struct v2v_number){V2V_NUMBER_AUTO, 0.0};
        scene.config.input.gain = (struct v2v_number){V2V_NUMBER_AUTO, 0.0};
        train(&scene);
        scene.config.input.offset = (struct v2v_number){V2V_NUMBER_NONE, 0.0};
        scene.config.input.gain = (struct v2v_number){V2V_NUMBER_GIVEN, 1.0};
        train(&scene);
        print_message("\n");
    }
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(twenty_steps_stay_finite_or_end_with_advice),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
