/* The learning rate that falls in a straight line, and the running mean of the weights. */
#include "small_run.h"

#include "v2v3d/nn/rule.h"

#include <string.h>

/* A network of the scene, trained for some steps; weights, moments and, with an average, the last
 * weights. To be freed. */
static float *train(struct scene *scene, int64_t steps, int resume, int64_t *count)
{
    char path[PATH];
    float *arenas = NULL;
    scene_train(scene, "run", 1, steps, resume, test_world());
    snprintf(path, sizeof path, "%s/run/weights.h5", scene->folder);
    assert_ok(scene_arenas(scene, path, &arenas, count));
    return arenas;
}

static float *fresh(const struct scene *scene, int64_t *total)
{
    struct v2v_schema schema = {0};
    float *weights = NULL;
    const struct v2v_network_spec spec = {
        .config = &scene->config, .views = VIEWS, .slices = SLICES, .outputs = V2V_NETWORK_ALL};
    assert_ok(v2v_network_schema(&schema, scene->config.model.method, &spec));
    *total = schema.fields.total;
    assert_ok(V2V_ALLOC(weights, "test", *total));
    assert_ok(v2v_rule_weights(&schema.fields, weights, (int)scene->config.train.init,
                               scene->config.train.seed));
    v2v_schema_fini(&schema);
    return weights;
}

static void setup(struct scene *scene)
{
    scene_init(scene, test_folder(test_world()), 1, test_world());
    snprintf(scene->config.model.method, sizeof scene->config.model.method, "backconv");
    scene->config.train.init = V2V_RULE_HE;
    scene_record(scene, "recording.h5", scene_wave);
}

/* The first step of Adam is as long as the learning rate, for every weight that has a gradient:
 * a 20th of it, for it rises over 20 steps. */
static void the_rate_rises_and_falls(void **state)
{
    (void)state;
    struct scene scene;
    int64_t total = 0, count = 0;
    double largest = 0.0;
    setup(&scene);
    scene.config.train.schedule = V2V_SCHEDULE_LINEAR;
    float *before = fresh(&scene, &total), *after = train(&scene, 1, 0, &count);
    for (int64_t i = 0; i < total; i++) {
        largest = fmax(largest, fabs((double)after[i] - (double)before[i]));
    }
    const double expected = scene.config.train.learning_rate / 20.0;
    if (!(fabs(largest - expected) <= 1e-2 * expected)) {
        fail_msg("the largest step is %g, not %g", largest, expected);
    }
    v2v_mem_free(before);
    v2v_mem_free(after);
    scene_fini(&scene);
}

/* After one step the mean is 1/11 of the first weights and 10/11 of the last. */
static void the_result_is_the_mean_of_the_weights(void **state)
{
    (void)state;
    struct scene scene;
    int64_t total = 0, count = 0;
    setup(&scene);
    scene.config.train.average = 0.9;
    float *before = fresh(&scene, &total), *arenas = train(&scene, 1, 0, &count);
    assert_int_equal(count, 4 * total);
    const float *mean = arenas, *last = arenas + 3 * total;
    assert_memory_not_equal(last, before, (size_t)total * sizeof *last);
    for (int64_t i = 0; i < total; i++) {
        const double expected = ((double)before[i] + 10.0 * (double)last[i]) / 11.0;
        assert_true(fabs((double)mean[i] - expected) <= 2e-7 * (fabs(expected) + 1e-3));
    }
    v2v_mem_free(before);
    v2v_mem_free(arenas);
    scene_fini(&scene);
}

/* By a rate of 0 a step changes nothing. */
static void without_a_mean_the_run_goes_on_with_the_last_weights(void **state)
{
    (void)state;
    struct scene scene;
    int64_t count = 0, total = 0;
    setup(&scene);
    scene.config.train.average = 0.9;
    float *averaged = train(&scene, 3, 0, &count);
    total = count / 4;
    scene.config.train.average = 0.0;
    scene.config.train.learning_rate = 0.0;
    float *alone = train(&scene, 4, 1, &count);
    assert_int_equal(count, 3 * total);
    assert_memory_equal(alone, averaged + 3 * total, (size_t)total * sizeof *alone);
    assert_memory_not_equal(alone, averaged, (size_t)total * sizeof *alone);
    v2v_mem_free(averaged);
    v2v_mem_free(alone);
    scene_fini(&scene);
}

static void with_the_time_the_run_is_complete(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH], path[PATH + 16];
    struct v2v_train_report report;
    setup(&scene);
    struct v2v_train_job job = scene_job(&scene, run, "run");
    scene.config.train.steps = 1000000000;
    job.force = 1;
    job.max_time_s = 0.5;
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_STOPPED);
    scene.config.train.schedule = V2V_SCHEDULE_LINEAR;
    assert_ok(v2v_train_run(&job, &report, test_world()));
    snprintf(path, sizeof path, "%s/weights.h5", run);
    assert_true(report.steps > 0 && report.steps < scene.config.train.steps);
    assert_int_equal(scene_step(&scene, path), report.steps);
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_rate_rises_and_falls),
        cmocka_unit_test(the_result_is_the_mean_of_the_weights),
        cmocka_unit_test(without_a_mean_the_run_goes_on_with_the_last_weights),
        cmocka_unit_test(with_the_time_the_run_is_complete),
    };
    return scene_mpi_main(tests, argc, argv);
}
