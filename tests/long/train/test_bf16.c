/* Training in bf16 against training in float32: the same crops, the same start, 2000 steps.
 *
 * The losses of single steps are those of single noisy crops, and two runs part at once: bf16 keeps
 * 8 bits, so every product is off by 2^-8 and every sum of n by about 2^-8 / sqrt(n) of itself.
 * What must agree is where the training goes: the mean loss of a stretch of steps, over which crops
 * and steps average out, to 2 %. */
#include "small_run.h"

#include "v2v3d/op/bf16.h"

#include <stdlib.h>
#include <string.h>

enum { STEPS = 2000, STRETCH = 200, STRETCHES = STEPS / STRETCH, LINE = 1024, MODEL_WIDTH = 8 };

static const double most_apart = 0.02;

/* Mean total loss of each stretch, out of RUN/metrics.jsonl. */
static void read_losses(double mean[STRETCHES], const char *run)
{
    char path[2 * PATH], line[LINE];
    int step = 0;
    snprintf(path, sizeof path, "%s/metrics.jsonl", run);
    FILE *log = fopen(path, "re");
    assert_non_null(log);
    memset(mean, 0, STRETCHES * sizeof *mean);
    for (; fgets(line, sizeof line, log) != NULL && step < STEPS; step++) {
        const char *total = strstr(line, "\"total\":");
        assert_non_null(total);
        mean[step / STRETCH] += strtod(total + strlen("\"total\":"), NULL) / STRETCH;
    }
    assert_int_equal(fclose(log), 0);
    assert_int_equal(step, STEPS);
}

static void train(double mean[STRETCHES], struct scene *scene, const char *name, int precision)
{
    char run[PATH];
    struct v2v_train_report report;
    struct v2v_train_job job = scene_job(scene, run, name);
    scene->config.train.precision = precision;
    assert_ok(v2v_train_run(&job, &report, NULL));
    assert_int_equal(report.steps, STEPS);
    read_losses(mean, run);
}

static void two_thousand_steps_in_bf16_end_within_two_percent_of_float32(void **state)
{
    struct scene scene;
    double exact[STRETCHES], rough[STRETCHES];
    (void)state;
    if (v2v_op_bf16() < V2V_BF16_EMULATED) {
        test_skip("this processor cannot compute in bf16");
    }
    scene_init(&scene, test_folder(NULL), 1, NULL);
    scene.config.model.width = MODEL_WIDTH;
    scene.config.train.steps = STEPS;
    scene.config.train.log_every = 1;
    scene_record(&scene, "recording.h5", scene_wave);
    train(exact, &scene, "exact", V2V_PRECISION_F32);
    train(rough, &scene, "rough", V2V_PRECISION_BF16_ALWAYS);
    print_message("%-12s %10s %10s %9s\n", "up to step", "float32", "bf16", "apart");
    for (int i = 0; i < STRETCHES; i++) {
        print_message("%-12d %10.5f %10.5f %8.2f%%\n", (i + 1) * STRETCH, exact[i], rough[i],
                      100.0 * (rough[i] / exact[i] - 1.0));
    }
    assert_true(exact[STRETCHES - 1] < exact[0]); /* they learned */
    assert_true(rough[0] != exact[0]);            /* it was another precision */
    assert_true(fabs(rough[STRETCHES - 1] / exact[STRETCHES - 1] - 1.0) <= most_apart);
    scene_fini(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(two_thousand_steps_in_bf16_end_within_two_percent_of_float32),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
