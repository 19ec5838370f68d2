/* Frames that are written while the next ones are computed: that they are, in which order, and what
 * a write that fails costs. The program's own calls of pwrite come here first. */
#include "small_optics.h"
#include "small_recording.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/random.h"
#include "v2v3d/recon/recon.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { HEIGHT = 24, WIDTH = 20, FRAMES = 5 };
enum { PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };
enum { FRAME_BYTES = VOXELS * (int)sizeof(float), WRITES_A_FRAME = 3 };

/* A write waits so long at most for what shall happen meanwhile, and for what must not, s. */
#define PATIENCE 20.0
#define TEMPTATION 0.05

static const struct v2v_scaling scaling = {.offset = 0, .gain = 1};
static float frames[FRAMES][SAMPLES], reference[FRAMES * VOXELS];
static struct v2v_config config;
static struct v2v_psf_file psf;
static const struct v2v_estimator_ops *whole;

/* ---- what the thread that writes is seen to do ---- */

static pthread_t owner;
static struct {
    int wants_overlap;  /* a frame's data wait until the next frame is begun */
    int failing;        /* this write fails, from 1; 0: none */
    atomic_int begun;   /* frames whose computing began on this rank */
    int own;            /* frames that this rank has to make */
    int writes;         /* by the thread so far .. */
    atomic_int data;    /* .. and how many of them were a frame's data */
    int ahead;          /* frames begun while the one before the last was not on the disk */
    int marks;          /* frames marked */
    int late, unsynced; /* waited in vain; not on the disk when it returns */
    int early;          /* marks before the data were written */
} seen;

static void await_begun(int count, double patience)
{
    const struct timespec pause = {.tv_nsec = 1000 * 1000};
    const double began = v2v_clock_now();
    while (seen.begun < count && v2v_clock_now() - began < patience) {
        nanosleep(&pause, NULL);
    }
}

/* A frame is in work when the one before it is on its way, and no other: run_observed counts. */
static void await_next_frame(void)
{
    const int wanted = seen.data + 1 < seen.own ? seen.data + 2 : seen.own;
    await_begun(wanted, PATIENCE);
    seen.late += seen.begun < wanted;
    if (wanted < seen.own) {
        await_begun(wanted + 1, TEMPTATION);
    }
}

static ssize_t observe(int file, const void *data, size_t bytes, off_t at)
{
    seen.unsynced += (fcntl(file, F_GETFL) & O_DSYNC) == 0;
    if (++seen.writes == seen.failing) {
        errno = EIO;
        return -1;
    }
    if (bytes == FRAME_BYTES && seen.wants_overlap) {
        await_next_frame();
    }
    const ssize_t written = syscall(SYS_pwrite64, file, data, bytes, at);
    seen.data += bytes == FRAME_BYTES;
    seen.marks += bytes == 1;
    seen.early += bytes == 1 && seen.marks > seen.data;
    return written;
}

ssize_t pwrite(int file, const void *data, size_t bytes, off_t at)
{
    return pthread_equal(pthread_self(), owner) ? syscall(SYS_pwrite64, file, data, bytes, at)
                                                : observe(file, data, bytes, at);
}

/* ---- runs ---- */

static enum v2v_status run_observed(struct v2v_estimator *estimator, float *const *volume,
                                    const float *views, const struct v2v_monitor *monitor)
{
    seen.ahead += ++seen.begun > seen.data + 2;
    return whole->run(estimator, volume, views, monitor);
}

static int setup(void **state)
{
    (void)state;
    owner = pthread_self();
    assert_ok(v2v_estimator_find(&whole, "rld"));
    psf = small_psf();
    v2v_config_defaults(&config);
    config.deconv.iterations = 2;
    config.parallel.shards = 1; /* every rank makes frames of its own */
    for (int64_t i = 0; i < FRAMES * SAMPLES; i++) {
        frames[i / SAMPLES][i % SAMPLES] = (float)v2v_random_below(3, 0, (uint64_t)i, 64);
    }
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return 0;
}

static enum v2v_status deconvolve(const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_comm *world = test_world();
    struct v2v_recon *recon = NULL;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_recording_info recorded = {
        .frames = FRAMES, .views = VIEWS, .height = HEIGHT, .width = WIDTH};
    struct v2v_recording *recording = small_recording(test_folder(world), &frames[0][0], &recorded);
    const struct v2v_problem problem = {
        .config = &config, .psf = &psf, .height = HEIGHT, .width = WIDTH};
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = HEIGHT, .width = WIDTH};
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "these frames"};
    struct v2v_estimator_ops observed = *whole;
    observed.run = run_observed;
    seen.own = (FRAMES - v2v_comm_rank(world) + v2v_comm_size(world) - 1) / v2v_comm_size(world);
    assert_ok(v2v_recon_create(&recon, &observed, &problem, FRAMES, world));
    assert_ok(v2v_volume_resume(&writer, path, &info, 1u << V2V_VOLUME_MEAN, &task, 1, world));
    V2V_TRY(v2v_recon_run(recon, recording, &scaling, writer, 0, NULL));
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_recon_destroy(&recon); /* nothing of it is lent any more */
    v2v_recording_close(&recording);
    v2v_volume_suspend(&writer);
    return rc;
}

static void read_into(float *volumes, const char *path)
{
    int64_t count = 0;
    double *values = test_h5_read(path, "/volume", &count);
    assert_int_equal(count, FRAMES * VOXELS);
    for (int64_t i = 0; i < count; i++) {
        volumes[i] = (float)values[i];
    }
    test_release(values);
}

static void frames_are_written_while_the_next_ones_are_computed(void **state)
{
    (void)state;
    char path[1024];
    snprintf(path, sizeof path, "%s/volume.h5", test_folder(test_world()));
    memset(&seen, 0, sizeof seen);
    seen.wants_overlap = 1;
    assert_ok(deconvolve(path));
    assert_int_equal(seen.begun, seen.own);
    assert_int_equal(seen.data, seen.own);
    assert_int_equal(seen.marks, seen.own);
    assert_int_equal(seen.late, 0);
    assert_int_equal(seen.ahead, 0);
    assert_int_equal(seen.early, 0);
    assert_int_equal(seen.unsynced, 0);
    read_into(reference, path);
}

/* The n-th write of one rank fails: all end, the frames that are marked are sound, and a second run
 * makes the others. */
static void fail_once(int rank, int nth)
{
    static float volumes[FRAMES * VOXELS];
    char path[1024];
    snprintf(path, sizeof path, "%s/volume_%d_%d.h5", test_folder(test_world()), rank, nth);
    memset(&seen, 0, sizeof seen);
    seen.failing = v2v_comm_rank(test_world()) == rank ? nth : 0;
    assert_int_equal(deconvolve(path), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), ".h5: writing failed: Input/output error"));
    int64_t marks = seen.marks;
    memset(&seen, 0, sizeof seen);
    assert_ok(deconvolve(path));
    marks += seen.marks;
    v2v_par_sum_i64(test_world(), &marks, 1);
    assert_int_equal(marks, FRAMES); /* none is made twice */
    read_into(volumes, path);
    assert_memory_equal(volumes, reference, sizeof volumes);
}

static void a_write_that_fails_ends_all_and_costs_no_other_frame(void **state)
{
    (void)state;
    const int ranks = v2v_comm_size(test_world());
    for (int rank = 0; rank < ranks; rank++) {
        const int own = (FRAMES - rank + ranks - 1) / ranks;
        for (int nth = 1; nth <= own * WRITES_A_FRAME; nth++) {
            fail_once(rank, nth);
        }
    }
}

int main(int argc, char **argv)
{
#define WITH(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
    const struct CMUnitTest tests[] = {
        WITH(frames_are_written_while_the_next_ones_are_computed),
        WITH(a_write_that_fails_ends_all_and_costs_no_other_frame),
    };
    return test_mpi_main(tests, argc, argv);
}
