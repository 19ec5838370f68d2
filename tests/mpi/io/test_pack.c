/* A packed volume is the same file at any number of ranks; a fault on one rank in the pass ends all
 * of them, and the frames stay to go on with. */
#include "support.h"

#include "io/file_internal.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/volume.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Fewer frames than a round of four ranks has left, more than one round of two. */
enum { FRAMES = 5, SLICES = 3, IMAGE = 12 };

static const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "0123456789abcdef"};

/* @param before_end is called when all frames are there; may be NULL */
static enum v2v_status write_volume(const char *path, const struct v2v_volume_storage *storage,
                                    void (*before_end)(const char *path),
                                    const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = 3, .width = 4, .storage = *storage};
    struct v2v_volume_writer *writer = NULL;
    float frame[SLICES * IMAGE];
    V2V_TRY(v2v_volume_resume(&writer, path, &info, 1, &task, 1, comm));
    for (int64_t first = 0; first < FRAMES; first += v2v_comm_size(comm)) {
        const int64_t t = first + v2v_comm_rank(comm);
        const int is_mine = t < FRAMES && !v2v_volume_is_done(writer, t);
        for (int i = 0; i < SLICES * IMAGE; i++) {
            frame[i] = (float)((t * SLICES * IMAGE + i) * 37 % 101);
        }
        /* a TIFF waits for all ranks */
        V2V_TRY(v2v_volume_put(writer, V2V_VOLUME_MEAN, frame, is_mine ? t : first, 0,
                               is_mine ? SLICES : 0));
        if (is_mine) {
            V2V_TRY(v2v_volume_mark_done(writer, t, NULL));
        }
    }
    if (before_end != NULL) {
        before_end(path);
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_suspend(&writer);
    return rc;
}

static const struct {
    const char *ending;
    struct v2v_volume_storage storage;
} kinds[] = {
    {"h5", {.sample = V2V_SAMPLE_UINT16}},
    {"h5", {.sample = V2V_SAMPLE_UINT16, .peak = 50.0, .deflate = 2}},
    {"h5", {.deflate = 2}},
    {"tif", {.sample = V2V_SAMPLE_UINT16}},
};

static void the_file_is_that_of_one_rank(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        char shared[512], alone[512];
        snprintf(shared, sizeof shared, "%s/shared%zu.%s", test_folder(test_world()), i,
                 kinds[i].ending);
        snprintf(alone, sizeof alone, "%s/alone%zu.%s", test_folder(test_world()), i,
                 kinds[i].ending);
        assert_ok(write_volume(shared, &kinds[i].storage, NULL, test_world()));
        if (v2v_comm_rank(test_world()) == 0) {
            assert_ok(write_volume(alone, &kinds[i].storage, NULL, NULL));
            assert_same_bytes(shared, alone);
        }
        v2v_par_barrier(test_world());
    }
}

static void a_fault_in_the_pass_ends_all_ranks_and_costs_no_frame(void **state)
{
    (void)state;
#ifndef V2V_FAULTS
    test_skip("this build has no fault points");
#endif
    if (getenv("V2V_FAULT") == NULL) {
        test_skip("V2V_FAULT plans no fault");
    }
    char path[512], part[V2V_PATH_BYTES], packed[V2V_PATH_BYTES];
    const size_t held = v2v_mem_held();
    int failures = 0;
    enum v2v_status rc = V2V_E_IO;
    snprintf(path, sizeof path, "%s/vol.h5", test_folder(test_world()));
    assert_ok(v2v_file_temporary(part, path));
    assert_ok(v2v_file_packed(packed, path));
    while (rc != V2V_OK && failures <= v2v_comm_size(test_world())) {
        rc = write_volume(path, &kinds[1].storage, NULL, test_world());
        v2v_par_barrier(test_world());
        failures += rc != V2V_OK;
        if (rc != V2V_OK) {
            assert_int_equal(rc, V2V_E_IO);
            assert_non_null(strstr(v2v_status_message(), "injected fault"));
        }
        if (rc != V2V_OK && v2v_comm_rank(test_world()) == 0) {
            assert_true(v2v_file_exists(part));
            assert_false(v2v_file_exists(packed) || v2v_file_exists(path));
        }
        v2v_par_barrier(test_world());
        assert_int_equal(v2v_mem_held(), held);
    }
    assert_ok(rc);
    assert_int_equal(failures, v2v_comm_size(test_world()));
}

/* A file cannot be renamed to a folder. */
static void take_its_name(const char *path)
{
    if (v2v_comm_rank(test_world()) == 0) {
        assert_int_equal(mkdir(path, 0777), 0);
    }
}

static void a_file_that_cannot_get_its_name_costs_no_frame(void **state)
{
    (void)state;
    static const struct v2v_volume_storage plain;
    const size_t packs = sizeof kinds / sizeof kinds[0];
    for (size_t i = 0; i <= packs; i++) {
        char path[512];
        struct v2v_volume_left left;
        const struct v2v_volume_storage *storage = i < packs ? &kinds[i].storage : &plain;
        snprintf(path, sizeof path, "%s/named%zu.%s", test_folder(test_world()), i,
                 i < packs ? kinds[i].ending : "h5");
        assert_int_equal(write_volume(path, storage, take_its_name, test_world()), V2V_E_IO);
        assert_non_null(strstr(v2v_status_message(), "cannot be renamed"));
        assert_ok(v2v_volume_left(&left, path, task.text));
        assert_true(left.done == FRAMES && left.is_same);
        v2v_par_barrier(test_world());
        if (v2v_comm_rank(test_world()) == 0) {
            assert_int_equal(rmdir(path), 0);
        }
        assert_ok(write_volume(path, storage, NULL, test_world()));
    }
}

/* Whatever is written there next, and however. */
static void what_a_killed_pass_left_is_cleared(void **state)
{
    (void)state;
    static const struct v2v_volume_storage plain;
    const size_t packs = sizeof kinds / sizeof kinds[0];
    for (size_t i = 0; i < packs; i++) {
        for (int is_packed = 0; is_packed <= 1; is_packed++) {
            char path[512], packed[V2V_PATH_BYTES];
            snprintf(path, sizeof path, "%s/left%zu_%d.%s", test_folder(test_world()), i, is_packed,
                     kinds[i].ending);
            assert_ok(v2v_file_packed(packed, path));
            if (v2v_comm_rank(test_world()) == 0) {
                assert_ok(v2v_file_write_text(packed, "half a file"));
            }
            v2v_par_barrier(test_world());
            assert_ok(
                write_volume(path, is_packed ? &kinds[i].storage : &plain, NULL, test_world()));
            assert_true(v2v_file_exists(path));
            assert_false(v2v_file_exists(packed));
        }
    }
}

/* Its floats could be written, 2.6 GB: the pass could not take them. */
static void slices_too_large_for_the_pass_are_refused_before_it(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    char path[512], part[V2V_PATH_BYTES];
    const struct v2v_volume_info info = {.frames = 1,
                                         .slices = 1,
                                         .height = 1 << 15,
                                         .width = 20000,
                                         .storage = {.sample = V2V_SAMPLE_UINT16}};
    snprintf(path, sizeof path, "%s/large.h5", test_folder(test_world()));
    assert_ok(v2v_file_temporary(part, path));
    const enum v2v_status rc = v2v_volume_create(&writer, path, &info, 1, NULL, 0, test_world());
    v2v_volume_abandon(&writer);
    assert_int_equal(rc, V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "too large to be packed"));
    assert_false(v2v_file_exists(part));
}

int main(int argc, char **argv)
{
    /* An attempt that fails does so in the first round, where every rank passes the fault point
     * once: each rank has an attempt of its own. */
    static const char *const plans[] = {"volume.pack:0:1", "volume.pack:1:2", "volume.pack:2:3",
                                        "volume.pack:3:4"};
    test_plan_faults(plans);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fault_in_the_pass_ends_all_ranks_and_costs_no_frame),
        cmocka_unit_test(the_file_is_that_of_one_rank),
        cmocka_unit_test(a_file_that_cannot_get_its_name_costs_no_frame),
        cmocka_unit_test(what_a_killed_pass_left_is_cleared),
        cmocka_unit_test(slices_too_large_for_the_pass_are_refused_before_it),
    };
    return test_mpi_main(tests, argc, argv);
}
