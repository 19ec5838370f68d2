/** A training run that takes milliseconds a step: five views that see depth under different angles,
 *  a noisy recording of two frames, a network of width 4. For the tests of train. */
#ifndef V2V_TEST_SMALL_RUN_H
#define V2V_TEST_SMALL_RUN_H

#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/weights_file.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/train/train.h"

#include <math.h>
#include <stdio.h>

/** test_mpi_main with the helper that looks at files, started before MPI as the program does:
 *  without it a look forks this whole process. */
#define scene_mpi_main(tests, argc, argv) (v2v_file_guard_start(), test_mpi_main(tests, argc, argv))

enum { VIEWS = 5, SLICES = 4, KERNEL = 9, SIDE = 64, FRAMES = 2, PATH = 512 };

struct scene {
    struct v2v_config config;
    struct v2v_psf_file psf;
    struct v2v_recording *recording;
    struct v2v_volume *truth; /* NULL until scene_truth */
    struct v2v_comm *comm;
    const char *folder;
    int64_t height, width; /* of the frames to record */
    size_t held;           /* bytes held before */
};

/** Views whose kernels drift with depth, as tilted needles do. */
static inline void scene_psf(struct v2v_psf_file *psf)
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

static inline float scene_wave(int t, int64_t i)
{
    double wave = 1.0 + sin((double)(i % SIDE) * 0.3) * cos((double)(i / SIDE) * 0.2);
    return (float)(wave + 0.1 * v2v_random_normal(23, (uint64_t)t, (uint64_t)i));
}

/** Write a recording whose samples `sample` gives, and open it. */
static inline void scene_record(struct scene *scene, const char *name,
                                float (*sample)(int t, int64_t i))
{
    char path[PATH];
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording_info info = {.frames = FRAMES,
                                      .views = VIEWS,
                                      .height = scene->height,
                                      .width = scene->width,
                                      .offset = (double)NAN};
    struct v2v_input_settings input = {.views = VIEWS};
    int64_t samples = VIEWS * scene->height * scene->width;
    float *views = NULL;
    int64_t mine = v2v_comm_rank(scene->comm) == 0 ? VIEWS : 0;
    snprintf(path, sizeof path, "%s/%s", scene->folder, name);
    assert_ok(V2V_ALLOC(views, "test", samples));
    assert_ok(v2v_recording_create(&writer, path, &info, scene->comm));
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < samples; i++) {
            views[i] = sample(t, i);
        }
        assert_ok(v2v_recording_write(writer, views, t, 0, mine));
    }
    assert_ok(v2v_recording_finish(&writer));
    v2v_mem_free(views);
    v2v_recording_close(&scene->recording);
    assert_ok(v2v_recording_open(&scene->recording, path, &input, scene->comm));
}

/** Write a volume for each frame, whose voxels `sample` gives, and open it. */
static inline void scene_truth(struct scene *scene, float (*sample)(int t, int64_t i))
{
    char path[PATH];
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = scene->height, .width = scene->width};
    const int64_t voxels = SLICES * scene->height * scene->width;
    float *volume = NULL;
    snprintf(path, sizeof path, "%s/truth.h5", scene->folder);
    assert_ok(V2V_ALLOC(volume, "test", voxels));
    assert_ok(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, scene->comm));
    for (int t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < voxels; i++) {
            volume[i] = sample(t, i);
        }
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, volume, t, 0,
                                   v2v_comm_rank(scene->comm) == 0 ? SLICES : 0));
    }
    assert_ok(v2v_volume_finish(&writer));
    v2v_mem_free(volume);
    assert_ok(v2v_volume_open(&scene->truth, path, NULL, scene->comm));
}

/** Optics and settings; the recording follows. */
static inline void scene_init(struct scene *scene, const char *folder, int64_t batch,
                              struct v2v_comm *comm)
{
    *scene = (struct scene){
        .comm = comm, .folder = folder, .height = SIDE, .width = SIDE, .held = v2v_mem_held()};
    scene_psf(&scene->psf);
    v2v_config_defaults(&scene->config);
    scene->config.model.width = 4;
    scene->config.backconv.width = 8;
    scene->config.train.crop = 32;
    scene->config.train.halo = 4;
    scene->config.train.steps = 20;
    scene->config.train.batch = batch;
    scene->config.train.learning_rate = 1e-3;
}

static inline void scene_fini(struct scene *scene)
{
    v2v_recording_close(&scene->recording);
    v2v_volume_close(&scene->truth);
    v2v_psf_file_fini(&scene->psf);
    assert_int_equal(v2v_mem_held(), scene->held);
}

/** The job in RUN = run[PATH], folder/name. */
static inline struct v2v_train_job scene_job(struct scene *scene, char *run, const char *name)
{
    snprintf(run, PATH, "%s/%s", scene->folder, name);
    return (struct v2v_train_job){.config = &scene->config,
                                  .psf = &scene->psf,
                                  .recordings = &scene->recording,
                                  .truths = scene->truth != NULL ? &scene->truth : NULL,
                                  .recording_count = 1,
                                  .folder = run};
}

/** Train in RUN `name`, over an older run unless it is resumed; returns the last loss. */
static inline double scene_train(struct scene *scene, const char *name, int64_t branches,
                                 int64_t steps, int resume, struct v2v_comm *comm)
{
    char run[PATH];
    struct v2v_train_report report;
    struct v2v_train_job job = scene_job(scene, run, name);
    job.resume = resume;
    job.force = !resume;
    scene->config.parallel.branches = branches;
    scene->config.train.steps = steps;
    assert_ok(v2v_train_run(&job, &report, comm));
    assert_int_equal(report.steps, steps);
    return report.last_total;
}

/** All arenas of a checkpoint of the whole network, *count floats. */
static inline enum v2v_status scene_arenas(const struct scene *scene, const char *path,
                                           float **arenas, int64_t *count)
{
    static const char *const group[] = {"weights", "adam_m", "adam_v", "last"};
    enum v2v_status rc = V2V_OK;
    struct v2v_schema schema = {0};
    const struct v2v_network_spec spec = {
        .config = &scene->config, .views = VIEWS, .slices = SLICES, .outputs = V2V_NETWORK_ALL};
    assert_ok(v2v_network_schema(&schema, scene->config.model.method, &spec));
    const int64_t total = schema.fields.total;
    const int groups = scene->config.train.average > 0.0 ? 4 : 3;
    assert_ok(V2V_ALLOC(*arenas, "test", groups * total));
    for (int i = 0; i < groups && rc == V2V_OK; i++) {
        rc = v2v_weights_file_read(*arenas + i * total, path, group[i], &schema.fields);
    }
    *count = groups * total;
    v2v_schema_fini(&schema);
    return rc;
}

/** The step of a checkpoint, -1 when one of its arrays is bad. */
static inline int64_t scene_step(const struct scene *scene, const char *path)
{
    float *arenas = NULL;
    int64_t count = 0;
    struct v2v_weights_info info = {.step = -1};
    if (scene_arenas(scene, path, &arenas, &count) != V2V_OK ||
        v2v_weights_file_info(&info, path) != V2V_OK) {
        info.step = -1;
    }
    v2v_mem_free(arenas);
    return info.step;
}

#endif
