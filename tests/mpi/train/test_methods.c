/* Every network of the registry trains, at any rank count, to the same loss; its checkpoints go on
 * bit for bit. */
#include "small_run.h"

#include <string.h>

enum { STEPS = 6 };

/* Sums of gradients in another order differ by 1e-7 of them; at this learning rate that does not
 * grow in so few steps, and the loss, 1e-3 of which one step changes, keeps four digits. */
static void check_against_one_rank(struct scene *scene, int64_t branches)
{
    double alone = 0.0;
    double together = scene_train(scene, "together", branches, STEPS, 0, test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        alone = scene_train(scene, "alone", 1, STEPS, 0, NULL);
        print_message("%s, batch %d, %d branch ranks: loss %.9g, on one rank %.9g\n",
                      scene->config.model.method, (int)scene->config.train.batch, (int)branches,
                      together, alone);
    }
    v2v_par_broadcast(test_world(), &alone, sizeof alone, 0);
    assert_true(isfinite(alone) && alone > 0.0);
    assert_true(fabs(together - alone) <= 1e-4 * alone);
}

static void check_resume(struct scene *scene)
{
    char path[2][PATH];
    float *arenas[2] = {NULL, NULL};
    int64_t count[2] = {0, 0};
    static const char *const name[] = {"whole", "parts"};
    scene_train(scene, name[0], 1, STEPS, 0, test_world());
    scene_train(scene, name[1], 1, STEPS / 2, 0, test_world());
    scene_train(scene, name[1], 1, STEPS, 1, test_world());
    for (int i = 0; i < 2; i++) {
        snprintf(path[i], PATH, "%s/%s/weights.h5", scene->folder, name[i]);
        assert_ok(scene_arenas(scene, path[i], &arenas[i], &count[i]));
        assert_int_equal(scene_step(scene, path[i]), STEPS);
    }
    assert_memory_equal(arenas[0], arenas[1], (size_t)count[0] * sizeof(float));
    v2v_mem_free(arenas[0]);
    v2v_mem_free(arenas[1]);
}

static void every_network_trains_on_any_ranks_to_the_same_loss(void **state)
{
    (void)state;
    struct scene scene;
    scene_init(&scene, test_folder(test_world()), 3, test_world());
    scene_record(&scene, "recording.h5", scene_wave);
    scene_truth(&scene, scene_wave);
    scene.config.vcdnet.width = scene.config.deepcad.width = 4;
    scene.config.deepcad.levels = scene.config.deepcad.frames = FRAMES / 2;
    scene.config.train.learning_rate = 1e-4;
    scene.config.train.average = 0.9;
    for (int64_t i = 0; i < v2v_network_count(); i++) {
        const struct v2v_network_ops *ops = v2v_network_at(i);
        snprintf(scene.config.model.method, sizeof scene.config.model.method, "%s", ops->name);
        scene.config.train.batch = 3;
        check_against_one_rank(&scene, 1);
        scene.config.train.batch = 1;
        check_against_one_rank(&scene,
                               v2v_comm_size(test_world()) >= ops->outputs ? ops->outputs : 1);
        check_resume(&scene);
    }
    scene_fini(&scene);
}

static void a_method_that_there_is_not_is_refused(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH];
    struct v2v_train_report report;
    scene_init(&scene, test_folder(test_world()), 1, test_world());
    scene_record(&scene, "recording.h5", scene_wave);
    struct v2v_train_job job = scene_job(&scene, run, "none");
    assert_ok(v2v_config_set(&scene.config, "model.method=backcnv"));
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "did you mean 'backconv'?"));
    assert_ok(v2v_config_set(&scene.config, "model.method=backconv"));
    assert_ok(v2v_config_set(&scene.config, "parallel.slabs=2"));
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_E_CONFIG);
    assert_non_null(strstr(v2v_status_message(), "does not compute slabs"));
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_network_trains_on_any_ranks_to_the_same_loss),
        cmocka_unit_test(a_method_that_there_is_not_is_refused),
    };
    return scene_mpi_main(tests, argc, argv);
}
