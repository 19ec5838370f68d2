/* Training at any rank count: the same losses as one rank, and runs that go on bit for bit. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/nn/schema.h"
#include "v2v3d/train/train.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, KERNEL = 9, SIDE = 64, FRAMES = 2, PATH = 512 };

struct scene {
    struct v2v_config config;
    struct v2v_psf_file psf;
    struct v2v_recording *recording;
    const char *folder;
    size_t held; /* bytes that the world itself holds */
};

/* Views whose kernels drift with depth, as tilted needles do. */
static void fill_psf(struct v2v_psf_file *psf)
{
    *psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf->data, "test", VIEWS * SLICES * KERNEL * KERNEL));
    for (int v = 0; v < VIEWS; v++) {
        for (int z = 0; z < SLICES; z++) {
            int y = KERNEL / 2 + (v % 3 - 1) * (z - 1), x = KERNEL / 2 + (v / 3) * (z - 2);
            psf->data[((v * SLICES + z) * KERNEL + y) * KERNEL + x] = 1.0f;
        }
    }
    v2v_psf_normalize_views(psf);
}

static void write_recording(const char *path)
{
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording_info info = {
        .frames = FRAMES, .views = VIEWS, .height = SIDE, .width = SIDE};
    float *views = NULL;
    int64_t count = VIEWS * SIDE * SIDE;
    int main_rank = v2v_comm_rank(test_world()) == 0;
    assert_ok(V2V_ALLOC(views, "test", count));
    assert_ok(v2v_recording_create(&writer, path, &info, test_world()));
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < count; i++) {
            double wave = 1.0 + sin((double)(i % SIDE) * 0.3) * cos((double)(i / SIDE) * 0.2);
            views[i] = (float)(wave + 0.1 * v2v_random_normal(23, (uint64_t)t, (uint64_t)i));
        }
        assert_ok(v2v_recording_write(writer, views, t, 0, main_rank ? VIEWS : 0));
    }
    assert_ok(v2v_recording_finish(&writer));
    v2v_mem_free(views);
}

static void setup(struct scene *scene, int64_t batch)
{
    char path[PATH];
    *scene = (struct scene){.folder = test_folder(test_world()), .held = v2v_mem_held()};
    fill_psf(&scene->psf);
    snprintf(path, sizeof path, "%s/recording.h5", scene->folder);
    write_recording(path);
    v2v_config_defaults(&scene->config);
    scene->config.model.width = 4;
    scene->config.train.crop = 32;
    scene->config.train.halo = 4;
    scene->config.train.steps = 20;
    scene->config.train.batch = batch;
    scene->config.train.learning_rate = 1e-3;
    struct v2v_input_settings input = {.views = VIEWS};
    assert_ok(v2v_recording_open(&scene->recording, path, &input, test_world()));
}

static void teardown(struct scene *scene)
{
    v2v_recording_close(&scene->recording);
    v2v_psf_file_fini(&scene->psf);
    assert_int_equal(v2v_mem_held(), scene->held);
}

/* Train in RUN `name`; returns the last loss. */
static double train(struct scene *scene, const char *name, int64_t branches, int64_t steps,
                    int resume, struct v2v_comm *comm)
{
    char run[PATH];
    struct v2v_train_report report;
    struct v2v_train_job job = {.config = &scene->config,
                                .psf = &scene->psf,
                                .recordings = &scene->recording,
                                .recording_count = 1,
                                .folder = run,
                                .resume = resume};
    snprintf(run, sizeof run, "%s/%s", scene->folder, name);
    scene->config.parallel.branches = branches;
    scene->config.train.steps = steps;
    assert_ok(v2v_train_run(&job, &report, comm));
    assert_int_equal(report.steps, steps);
    return report.last_total;
}

/* Twenty steps of Adam: a step's relative round-off of 1e-6 in the gradients can turn the step of
 * an element whose gradient is near 0 by the learning rate; the bar for the loss is 1e-4.
 */
static void check_against_one_rank(int64_t batch, int64_t branches)
{
    struct scene scene;
    double alone = 0.0;
    setup(&scene, batch);
    double together = train(&scene, "together", branches, 20, 0, test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        alone = train(&scene, "alone", 1, 20, 0, NULL);
        print_message("loss after 20 steps: %.9g, on one rank %.9g\n", together, alone);
    }
    v2v_par_broadcast(test_world(), &alone, sizeof alone, 0);
    assert_true(isfinite(alone));
    assert_true(fabs(together - alone) <= 1e-4 * fabs(alone));
    teardown(&scene);
}

static void data_ranks_train_like_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(3, 1);
}

static void branch_ranks_train_like_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(2, v2v_comm_size(test_world()) > 1 ? 2 : 1);
}

static void more_ranks_than_samples_train_like_one_rank(void **state)
{
    (void)state;
    check_against_one_rank(1, 1);
}

/* All three arenas of a checkpoint of the whole network. */
static void read_arenas(struct scene *scene, const char *name, float **arenas, int64_t *count)
{
    static const char *const group[] = {"weights", "adam_m", "adam_v"};
    char path[PATH];
    struct v2v_fields fields = {0};
    struct v2v_model_spec spec = {.views = VIEWS,
                                  .slices = SLICES,
                                  .width = scene->config.model.width,
                                  .features = scene->config.model.features,
                                  .branches = V2V_BRANCH_BOTH,
                                  .volume_scale = 1.0};
    assert_ok(v2v_model_schema(&fields, &spec));
    assert_ok(V2V_ALLOC(*arenas, "test", 3 * fields.total));
    snprintf(path, sizeof path, "%s/%s/weights.h5", scene->folder, name);
    for (int i = 0; i < 3; i++) {
        assert_ok(v2v_weights_file_read(*arenas + i * fields.total, path, group[i], &fields));
    }
    *count = 3 * fields.total;
    v2v_fields_fini(&fields);
}

static void ten_and_ten_steps_equal_twenty_bit_for_bit(void **state)
{
    (void)state;
    struct scene scene;
    float *whole = NULL, *parts = NULL;
    int64_t count = 0;
    int64_t branches = v2v_comm_size(test_world()) > 1 ? 2 : 1;
    setup(&scene, 2);
    double loss = train(&scene, "whole", branches, 20, 0, test_world());
    (void)train(&scene, "parts", branches, 10, 0, test_world());
    double resumed = train(&scene, "parts", branches, 20, 1, test_world());
    assert_true(loss == resumed);
    read_arenas(&scene, "whole", &whole, &count);
    read_arenas(&scene, "parts", &parts, &count);
    assert_memory_equal(whole, parts, (size_t)count * sizeof *whole);
    v2v_mem_free(whole);
    v2v_mem_free(parts);
    teardown(&scene);
}

static void a_checkpoint_resumes_on_another_rank_count(void **state)
{
    (void)state;
    struct scene scene;
    double alone = 0.0;
    setup(&scene, 2);
    (void)train(&scene, "shared", v2v_comm_size(test_world()) > 1 ? 2 : 1, 10, 0, test_world());
    double together = train(&scene, "whole", 1, 20, 0, test_world());
    if (v2v_comm_rank(test_world()) == 0) {
        alone = train(&scene, "shared", 1, 20, 1, NULL);
    }
    v2v_par_broadcast(test_world(), &alone, sizeof alone, 0);
    assert_true(fabs(together - alone) <= 1e-4 * fabs(alone));
    teardown(&scene);
}

static void a_stop_request_on_one_rank_checkpoints_on_all(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH], weights[PATH + 16];
    struct v2v_train_report report;
    struct v2v_weights_info info;
    setup(&scene, 1);
    snprintf(run, sizeof run, "%s/stopped", scene.folder);
    struct v2v_train_job job = {.config = &scene.config,
                                .psf = &scene.psf,
                                .recordings = &scene.recording,
                                .recording_count = 1,
                                .folder = run,
                                .max_time_s = 1e-9};
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_STOPPED);
    assert_int_equal(report.steps, 1);
    snprintf(weights, sizeof weights, "%s/weights.h5", run);
    assert_ok(v2v_weights_file_info(&info, weights));
    assert_int_equal(info.step, 1);
    teardown(&scene);
}

static void a_folder_with_a_run_is_refused(void **state)
{
    (void)state;
    struct scene scene;
    char run[PATH];
    struct v2v_train_report report;
    setup(&scene, 1);
    (void)train(&scene, "run", 1, 2, 0, test_world());
    snprintf(run, sizeof run, "%s/run", scene.folder);
    struct v2v_train_job job = {.config = &scene.config,
                                .psf = &scene.psf,
                                .recordings = &scene.recording,
                                .recording_count = 1,
                                .folder = run};
    assert_int_equal(v2v_train_run(&job, &report, test_world()), V2V_E_USAGE);
    assert_non_null(strstr(v2v_status_message(), "--resume"));
    teardown(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_ranks_train_like_one_rank),
        cmocka_unit_test(branch_ranks_train_like_one_rank),
        cmocka_unit_test(more_ranks_than_samples_train_like_one_rank),
        cmocka_unit_test(ten_and_ten_steps_equal_twenty_bit_for_bit),
        cmocka_unit_test(a_checkpoint_resumes_on_another_rank_count),
        cmocka_unit_test(a_stop_request_on_one_rank_checkpoints_on_all),
        cmocka_unit_test(a_folder_with_a_run_is_refused),
    };
    return test_mpi_main(tests, argc, argv);
}
