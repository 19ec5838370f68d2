#include "capture.h"
#include "small_optics.h"
#include "small_recording.h"

#include "v2v3d/base/random.h"
#include "v2v3d/base/stop.h"
#include "v2v3d/io/file.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/recon/recon.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/v2v/model.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

/* Frames that need padding on both sides; a number of them that 2, 3, 4 ranks don't share evenly.
 */
enum { HEIGHT = 40, WIDTH = 30, PADDED_HEIGHT = 64, PADDED_WIDTH = 32, FRAMES = 5 };
enum { PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };
enum { PADDED = PADDED_HEIGHT * PADDED_WIDTH };

static const struct v2v_scaling scaling = {.offset = 100, .gain = 1.0 / 64};
static float frames[FRAMES][SAMPLES], expected[2][FRAMES][VOXELS];

static const struct v2v_estimator_ops *method; /* under test */
static struct v2v_config config;
static struct v2v_psf_file psf;

/** The network that the weight file is for. */
static struct v2v_model *model_of_config(void)
{
    const struct v2v_model_spec spec = {.views = VIEWS,
                                        .slices = SLICES,
                                        .width = config.model.width,
                                        .features = config.model.features,
                                        .branches = V2V_BRANCH_BOTH,
                                        .volume_scale = config.model.volume_scale};
    struct v2v_shifts shifts = {0};
    struct v2v_model *model = NULL;
    assert_ok(v2v_shifts_from_psf(&shifts, &psf));
    assert_ok(v2v_model_create(&model, &spec, &shifts));
    assert_ok(
        v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HASH, 7));
    v2v_shifts_fini(&shifts);
    return model;
}

static void weights_file(const char *path)
{
    struct v2v_weights_info info;
    struct v2v_model *model = model_of_config();
    assert_ok(v2v_network_describe(&info, &config, VIEWS, SLICES, 0));
    if (v2v_comm_rank(test_world()) == 0) {
        assert_ok(v2v_weights_file_write(
            path, &info, v2v_model_fields(model),
            (const float *const[V2V_WEIGHTS_GROUPS]){v2v_model_weights(model)}, NULL, NULL));
    }
    v2v_par_barrier(test_world());
    v2v_model_destroy(&model);
}

/** Row or column i of the padded frame: mirrored about the last one, n < 32 often enough. */
static int mirror(int i, int n)
{
    while (i >= n) {
        i = i >= 2 * n - 1 ? i - 2 * (n - 1) : 2 * (n - 1) - i;
    }
    return i;
}

/** What one rank with both branches makes of every frame. */
static void expect_of_network(void)
{
    static float padded[VIEWS * PADDED], volume[2][SLICES * PADDED];
    struct v2v_model *model = model_of_config();
    assert_ok(v2v_model_plan(model, PADDED_HEIGHT, PADDED_WIDTH, 0));
    for (int t = 0; t < FRAMES; t++) {
        for (int i = 0; i < VIEWS * PADDED; i++) {
            int v = i / PADDED, y = mirror(i / PADDED_WIDTH % PADDED_HEIGHT, HEIGHT);
            int x = mirror(i % PADDED_WIDTH, WIDTH);
            padded[i] = (frames[t][v * PIXELS + y * WIDTH + x] - 100) / 64;
        }
        v2v_model_forward(model, volume[0], volume[1], padded);
        for (int i = 0; i < VOXELS; i++) {
            int z = i / PIXELS, y = i / WIDTH % HEIGHT, x = i % WIDTH;
            for (int b = 0; b < 2; b++) {
                expected[b][t][i] = 64 * volume[b][z * PADDED + y * PADDED_WIDTH + x];
            }
        }
    }
    v2v_model_destroy(&model);
}

/** Frame t with its neighbours: at the ends as many as in the middle. */
static void fuse(float *views, float (*from)[SAMPLES], int64_t t)
{
    const int64_t neighbours = config.recon.neighbours;
    struct v2v_fusion *fusion = NULL;
    memcpy(views, from[t], sizeof from[t]);
    if (neighbours > 0) {
        assert_ok(v2v_fusion_create(&fusion, neighbours, VIEWS, HEIGHT, WIDTH, 0));
        v2v_fusion_begin(fusion, from[t]);
        const int64_t all = 2 * neighbours + 1 < FRAMES ? 2 * neighbours + 1 : FRAMES;
        const int64_t middle = t - neighbours > 0 ? t - neighbours : 0;
        const int64_t first = middle + all <= FRAMES ? middle : FRAMES - all;
        for (int64_t u = first; u < first + all; u++) {
            if (u != t) {
                v2v_fusion_add(fusion, from[t], v2v_fusion_align(fusion, from[t], from[u]));
            }
        }
        v2v_fusion_end(fusion, views);
        v2v_fusion_destroy(&fusion);
    }
}

/** What one rank makes of every frame, without a gain: powers of two round nowhere. */
static void expect_of_deconvolution(void)
{
    static float scaled[FRAMES][SAMPLES], views[SAMPLES];
    struct v2v_estimator *estimator = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    assert_ok(v2v_estimator_create(&estimator, method, &problem, NULL));
    for (int i = 0; i < FRAMES * SAMPLES; i++) {
        scaled[i / SAMPLES][i % SAMPLES] = frames[i / SAMPLES][i % SAMPLES] - 100;
    }
    for (int t = 0; t < FRAMES; t++) {
        float *volume = expected[0][t];
        fuse(views, scaled, t);
        assert_ok(method->run(estimator, &volume, views, NULL));
    }
    v2v_estimator_destroy(&estimator);
}

static int setup(const char *name, int64_t neighbours)
{
    assert_ok(v2v_estimator_find(&method, name));
    psf = small_psf();
    v2v_config_defaults(&config);
    config.model.width = config.model.features = 4;
    config.model.volume_scale = 2;
    config.model.winograd = 0;
    config.deconv.iterations = 2;
    config.recon.neighbours = neighbours;
    config.parallel.split = V2V_SPLIT_SLABS; /* the same bits at any number of ranks */
    config.parallel.transform = V2V_TRANSFORM_OWN;
    for (int64_t i = 0; i < FRAMES * SAMPLES; i++) { /* whole counts: exact in float32 */
        frames[i / SAMPLES][i % SAMPLES] = (float)(100 + v2v_random_below(3, 0, (uint64_t)i, 64));
    }
    memset(expected, 0, sizeof expected);
    if (method->is_learned) {
        expect_of_network();
    } else {
        expect_of_deconvolution();
    }
    for (int b = 0; b < (method->is_learned ? 2 : 1); b++) { /* something to compare */
        assert_true(v2v_sum_of_squares(&expected[b][0][0], FRAMES * VOXELS) > 0);
    }
    return 0;
}

static int setup_learned(void **state)
{
    (void)state;
    return setup("learned", 0);
}

static int setup_rld(void **state)
{
    (void)state;
    return setup("rld", 0);
}

static int setup_frl(void **state)
{
    (void)state;
    return setup("frl", 0);
}

static int setup_tv(void **state)
{
    (void)state;
    return setup("tv", 0);
}

static int setup_fused(void **state)
{
    (void)state;
    return setup("rld", 2);
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

static struct v2v_recording *recording_file(const char *folder)
{
    const struct v2v_recording_info info = {
        .frames = FRAMES, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    return small_recording(folder, &frames[0][0], &info);
}

/** Of frame t of a file, by the method. */
static void assert_projected(struct v2v_recon *recon, const char *path, int64_t t)
{
    static float volume[VOXELS], views[SAMPLES];
    const struct v2v_input_settings settings = {.slices = SLICES};
    struct v2v_volume *volumes = NULL;
    assert_ok(v2v_volume_open(&volumes, path, &settings, test_world()));
    assert_ok(v2v_volume_read(volumes, volume, t, 0, SLICES));
    assert_ok(v2v_recon_project(recon, views, volumes, t));
    assert_small_views(views, volume, &psf, HEIGHT, WIDTH);
    v2v_volume_close(&volumes);
}

/** Reconstruct into `path`. */
static enum v2v_status reconstruct(const char *folder, const char *path,
                                   struct v2v_grid_shape shape)
{
    enum v2v_status rc = V2V_OK;
    char weights[1024];
    struct v2v_recon *recon = NULL;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_recording *recording = recording_file(folder);
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .weights = weights, .height = HEIGHT, .width = WIDTH};
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = HEIGHT, .width = WIDTH};
    const int branches = method->is_learned && strstr(path, ".tif") == NULL;
    const unsigned datasets = branches ? 7u << V2V_VOLUME_MEAN : 1u << V2V_VOLUME_MEAN;
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "these frames"};
    snprintf(weights, sizeof weights, "%s/weights.h5", folder);
    if (method->is_learned) {
        weights_file(weights);
    }
    config.parallel.branches = shape.branches;
    config.parallel.shards = shape.shards;
    assert_ok(v2v_recon_create(&recon, method, &problem, FRAMES, test_world()));
    assert_ok(v2v_volume_resume(&writer, path, &info, datasets, &task, 1, test_world()));
    V2V_TRY(v2v_recon_run(recon, recording, &scaling, writer, branches, NULL));
    V2V_TRY(v2v_volume_finish(&writer));
    if (method->project != NULL) {
        assert_projected(recon, path, FRAMES / 2);
    }
done:
    if (rc == V2V_STOPPED) {
        v2v_volume_suspend(&writer);
    }
    v2v_volume_abandon(&writer);
    v2v_recon_destroy(&recon);
    v2v_recording_close(&recording);
    return rc;
}

/* One network on one machine with one thread count repeats its bits; what may differ is the
 * division by the gain, exact for a power of two, and with slabs of rows the round-off of another
 * tiling: 18 layers' sums of up to 1500 products, 6e-8 each, of voxels of this size: their root is
 * below 1e-5 of it. */
static void assert_dataset(const char *path, const char *dataset, const float *reference, int slabs)
{
    int64_t count = 0;
    double *values = test_h5_read(path, dataset, &count);
    double bound = slabs > 1 && method->is_learned ? 1e-5 : 0.0;
    double size = sqrt(v2v_sum_of_squares(reference, FRAMES * VOXELS) / (FRAMES * VOXELS));
    assert_int_equal(count, FRAMES * VOXELS);
    for (int64_t i = 0; i < count; i++) {
        if (!(fabs(values[i] - (double)reference[i]) <= bound * size)) {
            fail_msg("%s: voxel %lld is %.9g, one rank makes it %.9g", dataset, (long long)i,
                     values[i], (double)reference[i]);
        }
    }
    test_release(values);
}

static void assert_volumes(const char *path, int slabs)
{
    static float result[FRAMES * VOXELS];
    for (int64_t i = 0; i < FRAMES * VOXELS; i++) {
        const float first = (&expected[0][0][0])[i], second = (&expected[1][0][0])[i];
        result[i] = config.recon.combine == V2V_COMBINE_MAX ? fmaxf(first, second)
                                                            : 0.5f * first + 0.5f * second;
    }
    if (method->is_learned) {
        assert_dataset(path, "/branch1", &expected[0][0][0], slabs);
        assert_dataset(path, "/branch2", &expected[1][0][0], slabs);
    }
    assert_dataset(path, "/volume", method->is_learned ? result : &expected[0][0][0], slabs);
    int64_t count = 0;
    double *done = test_h5_read(path, "/done", &count);
    assert_int_equal(count, FRAMES);
    for (int64_t t = 0; t < count; t++) {
        assert_true(done[t] != 0);
    }
    test_release(done);
}

static void compare(int branches, int shards)
{
    char path[1024];
    const char *folder = test_folder(test_world());
    snprintf(path, sizeof path, "%s/volume.h5", folder);
    assert_ok(reconstruct(folder, path, (struct v2v_grid_shape){branches, shards}));
    assert_volumes(path, shards);
}

static void frames_shared_by_ranks_give_one_ranks_volumes(void **state)
{
    (void)state;
    compare(1, 1);
}

static void branches_shared_by_ranks_give_one_ranks_volumes(void **state)
{
    (void)state;
    if (v2v_comm_size(test_world()) < 2) {
        test_skip("one rank shares nothing");
    }
    compare(2, 1);
}

static void the_larger_voxel_of_two_branches_is_taken_where_asked(void **state)
{
    (void)state;
    config.recon.combine = V2V_COMBINE_MAX;
    compare(1, 1);
    if (v2v_comm_size(test_world()) >= 2) {
        compare(2, 1);
    }
    config.recon.combine = V2V_COMBINE_MEAN;
}

/* Two pieces of 32 rows, the second one with padding: a third rank has none. */
static void rows_shared_by_ranks_give_one_ranks_volumes(void **state)
{
    (void)state;
    const int size = v2v_comm_size(test_world());
    for (int shards = 2; shards <= size; shards++) {
        const int most = method->is_learned ? 2 : 1;
        for (int branches = 1; branches <= most && branches * shards <= size; branches++) {
            compare(branches, shards);
        }
    }
}

static struct v2v_grid_shape paired(void)
{
    const int is_pair = v2v_comm_size(test_world()) % 2 == 0 && method->is_learned;
    return (struct v2v_grid_shape){is_pair ? 2 : 1, 1};
}

/* Three ranks leave one idle. */
static struct v2v_grid_shape with_an_idle_rank(void)
{
    return v2v_comm_size(test_world()) == 3 ? (struct v2v_grid_shape){1, 2} : paired();
}

static const struct v2v_estimator_ops *whole; /* the method, where one stands before it */
static int64_t runs;                          /* frames of this rank */
static const char *failing;                   /* the folder where fail_with is at work */

/* A NaN on the last rank. */
static enum v2v_status run_broken(struct v2v_estimator *estimator, float *const *volume,
                                  const float *views, const struct v2v_monitor *monitor)
{
    enum v2v_status rc = whole->run(estimator, volume, views, monitor);
    const int last = v2v_comm_size(test_world()) - 1;
    runs++;
    for (int o = 0; o < 2 && v2v_comm_rank(test_world()) == last; o++) {
        if (v2v_estimator_holds(estimator, o)) {
            volume[o][0] = NAN;
        }
    }
    return rc;
}

static void limit_files(rlim_t bytes)
{
    struct rlimit limit;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    limit.rlim_cur = bytes < limit.rlim_max ? bytes : limit.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

/* What all ranks end with where `run` stands before the method: no file, nor a part of one, after
 * `most` frames of a rank. */
static enum v2v_status fail_with(enum v2v_status (*run)(struct v2v_estimator *, float *const *,
                                                        const float *, const struct v2v_monitor *),
                                 const char *name, struct v2v_grid_shape shape, int64_t most)
{
    char path[1024], temporary[V2V_PATH_BYTES];
    const char *folder = failing = test_folder(test_world());
    snprintf(path, sizeof path, "%s/%s", folder, name);
    whole = method;
    struct v2v_estimator_ops own = *method;
    own.run = run;
    method = &own;
    runs = 0;
    const enum v2v_status rc = reconstruct(folder, path, shape);
    method = whole;
    limit_files(RLIM_INFINITY);
    v2v_par_barrier(test_world());
    assert_ok(v2v_file_temporary(temporary, path));
    assert_false(v2v_file_exists(path) || v2v_file_exists(temporary));
    assert_true(runs <= most);
    return rc;
}

/* Ranks learn of it a round later. */
static void a_nan_of_one_rank_ends_all_and_names_the_frame(void **state)
{
    (void)state;
    static const char *const names[] = {"volume.h5", "volume.tif"};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(fail_with(run_broken, names[i], paired(), 2), V2V_E_NUMERIC);
        assert_non_null(strstr(v2v_status_message(), "NaN or Inf at slice"));
        assert_non_null(strstr(v2v_status_message(), "frame "));
    }
}

/* No file of rank 0, which writes the TIFF, grows beyond three of a frame's six pages. */
enum { MOST_BYTES = 3 * PIXELS * (int)sizeof(float) };

static enum v2v_status run_to_a_full_disk(struct v2v_estimator *estimator, float *const *volume,
                                          const float *views, const struct v2v_monitor *monitor)
{
    runs++;
    if (v2v_comm_rank(test_world()) == 0) {
        limit_files(MOST_BYTES);
    }
    return whole->run(estimator, volume, views, monitor);
}

static void a_tiff_that_cannot_be_written_ends_all_in_its_round(void **state)
{
    (void)state;
    (void)signal(SIGXFSZ, SIG_IGN); /* writing fails instead */
    assert_int_equal(fail_with(run_to_a_full_disk, "volume.tif", with_an_idle_rank(), 1), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "volume.tif"));
    assert_non_null(strstr(v2v_status_message(), "page "));
}

/* Some ticks after it was written: clocks of file systems have some hundred a second. */
static void write_into_recording(void)
{
    const struct timespec ticks = {.tv_nsec = 50 * 1000 * 1000};
    char path[1024];
    snprintf(path, sizeof path, "%s/recording.h5", failing);
    nanosleep(&ticks, NULL);
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    assert_int_equal(fseek(file, -4, SEEK_END), 0);
    assert_int_equal(fputs("late", file) >= 0 && fclose(file) == 0, 1);
}

/* The first frame of rank 0 is computed when another program writes into the recording. */
static enum v2v_status run_while_written_to(struct v2v_estimator *estimator, float *const *volume,
                                            const float *views, const struct v2v_monitor *monitor)
{
    if (v2v_comm_rank(test_world()) == 0 && runs++ == 0) {
        write_into_recording();
    }
    return whole->run(estimator, volume, views, monitor);
}

static void a_recording_that_changes_meanwhile_makes_no_volume(void **state)
{
    (void)state;
    assert_int_equal(fail_with(run_while_written_to, "volume.h5", paired(), FRAMES), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "recording.h5: changed while it was read"));
}

static int64_t stop_at; /* the frame that ends an attempt */

static enum v2v_status run_until(struct v2v_estimator *estimator, float *const *volume,
                                 const float *views, const struct v2v_monitor *monitor)
{
    if (estimator->frame >= stop_at) {
        return V2V_FAIL(V2V_STOPPED, "frame %lld is too much", (long long)stop_at);
    }
    runs++;
    return whole->run(estimator, volume, views, monitor);
}

static void an_interrupted_run_goes_on_with_the_frames_that_are_missing(void **state)
{
    (void)state;
    char path[1024];
    const char *folder = test_folder(test_world());
    const struct v2v_grid_shape shape = {1, v2v_comm_size(test_world())};
    whole = method;
    struct v2v_estimator_ops interrupted = *method;
    interrupted.run = run_until;
    method = &interrupted;
    snprintf(path, sizeof path, "%s/volume.h5", folder);
    stop_at = 2;
    assert_int_equal(reconstruct(folder, path, shape), V2V_STOPPED);
    stop_at = FRAMES;
    runs = 0;
    assert_ok(reconstruct(folder, path, shape));
    assert_int_equal(runs, FRAMES - 2);
    assert_volumes(path, shape.shards);
}

/* The request stays, so that every attempt ends after its first frames: those of the rank that is
 * asked, and two more of a rank that doesn't know of it yet. */
static void a_request_to_one_rank_stops_all_and_attempts_end_with_the_whole_volume(void **state)
{
    (void)state;
    char path[1024];
    const char *folder = test_folder(test_world());
    int attempts = 1;
    snprintf(path, sizeof path, "%s/volume.h5", folder);
    if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
        v2v_stop_install();
        raise(SIGUSR1); /* for good: this test stays the last one */
    }
    enum v2v_status rc = reconstruct(folder, path, with_an_idle_rank());
    assert_int_equal(rc, V2V_STOPPED);
    for (; rc == V2V_STOPPED && attempts < FRAMES; attempts++) {
        rc = reconstruct(folder, path, with_an_idle_rank());
    }
    assert_ok(rc);
    assert_volumes(path, with_an_idle_rank().shards);
}

/* Ranks take a frame each where the limit lets them: by half a byte, with the averaged views. */
static void averaged_views_count_in_what_a_rank_may_hold(void **state)
{
    (void)state;
    char text[4096];
    struct v2v_grid_work work;
    struct v2v_recon *recon = NULL;
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    const int64_t floats = v2v_fusion_floats(config.recon.neighbours, VIEWS, HEIGHT, WIDTH);
    const int64_t ranks = v2v_comm_size(test_world());
    if (ranks < 2) {
        test_skip("one rank shares nothing");
    }
    assert_ok(method->describe_work(&work, &problem));
    int64_t held = (int64_t)v2v_mem_held();
    v2v_par_max_i64(test_world(), &held, 1);
    const int64_t both = work.bytes + floats * (int64_t)sizeof(float) + held;
    config.parallel.branches = config.parallel.shards = 0;
    for (int is_less = 0; is_less < 2; is_less++) {
        config.parallel.max_mem_gb = 1e-9 * ((double)both + (is_less ? -0.5 : 0.5));
        test_capture_begin();
        assert_ok(v2v_recon_create(&recon, method, &problem, ranks, test_world()));
        test_capture_end(text, sizeof text);
        v2v_recon_destroy(&recon);
        if (v2v_comm_rank(test_world()) == 0) {
            assert_int_equal(strstr(text, " x 1 branch x 1 shard ranks") != NULL, !is_less);
        }
    }
}

int main(int argc, char **argv)
{
#define WITH(test, method) cmocka_unit_test_setup_teardown(test, setup_##method, teardown)
#define WITH_ALL(test)                                                                             \
    WITH(test, learned), WITH(test, rld), WITH(test, frl), WITH(test, tv), WITH(test, fused)
    const struct CMUnitTest tests[] = {
        WITH_ALL(frames_shared_by_ranks_give_one_ranks_volumes),
        WITH(branches_shared_by_ranks_give_one_ranks_volumes, learned),
        WITH(the_larger_voxel_of_two_branches_is_taken_where_asked, learned),
        WITH_ALL(rows_shared_by_ranks_give_one_ranks_volumes),
        WITH_ALL(a_nan_of_one_rank_ends_all_and_names_the_frame),
        WITH(a_recording_that_changes_meanwhile_makes_no_volume, learned),
        WITH(a_recording_that_changes_meanwhile_makes_no_volume, rld),
        WITH(a_tiff_that_cannot_be_written_ends_all_in_its_round, learned),
        WITH(a_tiff_that_cannot_be_written_ends_all_in_its_round, tv),
        WITH_ALL(an_interrupted_run_goes_on_with_the_frames_that_are_missing),
        WITH(averaged_views_count_in_what_a_rank_may_hold, fused),
        WITH(a_request_to_one_rank_stops_all_and_attempts_end_with_the_whole_volume, learned),
    };
    return test_mpi_main(tests, argc, argv);
}
