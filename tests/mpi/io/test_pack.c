/* A packed volume is the same file at any number of ranks; a fault on one rank in the pass ends all
 * of them, and the frames stay to go on with. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/volume.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Fewer frames than a round of four ranks has left, more than one round of two. */
enum { FRAMES = 5, SLICES = 3, IMAGE = 12 };

static const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "0123456789abcdef"};

static enum v2v_status write_volume(const char *path, const struct v2v_volume_storage *storage,
                                    const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = 3, .width = 4, .storage = *storage};
    struct v2v_volume_writer *writer = NULL;
    float frame[SLICES * IMAGE];
    V2V_TRY(v2v_volume_resume(&writer, path, &info, 1, &task, 1, comm));
    for (int64_t t = v2v_comm_rank(comm); t < FRAMES; t += v2v_comm_size(comm)) {
        for (int i = 0; i < SLICES * IMAGE; i++) {
            frame[i] = (float)((t * SLICES * IMAGE + i) * 37 % 101);
        }
        if (!v2v_volume_is_done(writer, t)) {
            V2V_TRY(v2v_volume_put(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
            V2V_TRY(v2v_volume_mark_done(writer, t, NULL));
        }
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_suspend(&writer);
    return rc;
}

static void assert_same_bytes(const char *one, const char *other)
{
    FILE *files[] = {fopen(one, "rb"), fopen(other, "rb")};
    assert_true(files[0] != NULL && files[1] != NULL);
    int bytes[2];
    do {
        bytes[0] = fgetc(files[0]);
        bytes[1] = fgetc(files[1]);
        assert_int_equal(bytes[0], bytes[1]);
    } while (bytes[0] != EOF);
    assert_int_equal(fclose(files[0]), 0);
    assert_int_equal(fclose(files[1]), 0);
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
        assert_ok(write_volume(shared, &kinds[i].storage, test_world()));
        if (v2v_comm_rank(test_world()) == 0) {
            assert_ok(write_volume(alone, &kinds[i].storage, NULL));
            assert_same_bytes(shared, alone);
        }
        v2v_par_barrier(test_world());
    }
}

static void a_fault_in_the_pass_ends_all_ranks_and_costs_no_frame(void **state)
{
    (void)state;
#ifndef V2V_FAULTS
    skip();
#endif
    if (getenv("V2V_FAULT") == NULL) {
        skip();
    }
    char path[512], part[V2V_PATH_BYTES], packed[V2V_PATH_BYTES];
    const size_t held = v2v_mem_held();
    int failures = 0;
    enum v2v_status rc = V2V_E_IO;
    snprintf(path, sizeof path, "%s/vol.h5", test_folder(test_world()));
    snprintf(part, sizeof part, "%s.v2v3d-part", path);
    snprintf(packed, sizeof packed, "%s.v2v3d-packed", path);
    while (rc != V2V_OK && failures <= v2v_comm_size(test_world())) {
        rc = write_volume(path, &kinds[1].storage, test_world());
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

int main(int argc, char **argv)
{
    /* As in test_faults.c. An attempt that fails does so in the first round, where every rank
     * passes the fault point once: each rank has an attempt of its own. */
    static const char *const plans[] = {"volume.pack:0:1", "volume.pack:1:2", "volume.pack:2:3",
                                        "volume.pack:3:4"};
    const char *rank = getenv("OMPI_COMM_WORLD_RANK");
    if (rank != NULL && rank[0] >= '0' && rank[0] <= '3' && rank[1] == '\0') {
        setenv("V2V_FAULT", plans[rank[0] - '0'], 1);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fault_in_the_pass_ends_all_ranks_and_costs_no_frame),
        cmocka_unit_test(the_file_is_that_of_one_rank),
    };
    return test_mpi_main(tests, argc, argv);
}
