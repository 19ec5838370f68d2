/* A fault on one rank ends the write on all of them, leaves nothing behind, and the next write
 * succeeds. Each rank has a fault of its own; it fires once. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/volume.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FRAMES = 4, SLICES = 4, IMAGE = 12 };

static enum v2v_status write_volume(const char *path)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = 3, .width = 4};
    struct v2v_volume_writer *writer = NULL;
    float slices[SLICES * IMAGE];
    const struct v2v_part part =
        v2v_par_part(SLICES, v2v_comm_size(test_world()), v2v_comm_rank(test_world()));
    V2V_TRY(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int i = 0; i < SLICES * IMAGE; i++) {
            slices[i] = (float)(t * SLICES * IMAGE + i);
        }
        V2V_TRY(v2v_volume_write(writer, V2V_VOLUME_MEAN, slices + part.first * IMAGE, t,
                                 part.first, part.count));
        V2V_TRY(v2v_volume_mark_done(writer, t, test_world()));
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    return rc;
}

static void every_fault_ends_all_ranks_and_leaves_nothing(void **state)
{
    (void)state;
#ifndef V2V_FAULTS
    test_skip("this build has no fault points");
#endif
    if (getenv("V2V_FAULT") == NULL) {
        test_skip("V2V_FAULT plans no fault");
    }
    char path[512], temporary[V2V_PATH_BYTES];
    const size_t held = v2v_mem_held();
    int failures = 0;
    enum v2v_status rc = V2V_E_IO;
    snprintf(path, sizeof path, "%s/vol.h5", test_folder(test_world()));
    assert_ok(v2v_file_temporary(temporary, path));
    while (rc != V2V_OK && failures <= v2v_comm_size(test_world())) {
        rc = write_volume(path);
        v2v_par_barrier(test_world());
        if (rc != V2V_OK) {
            failures++;
            assert_int_equal(rc, V2V_E_IO);
            assert_non_null(strstr(v2v_status_message(), "injected fault"));
            /* The others may look when rank 0 is at the next attempt already. */
            assert_false(v2v_comm_rank(test_world()) == 0 &&
                         (v2v_file_exists(path) || v2v_file_exists(temporary)));
        }
        assert_int_equal(v2v_mem_held(), held);
    }
    assert_ok(rc);
    assert_int_equal(failures, v2v_comm_size(test_world()));
    struct v2v_volume *volume = NULL;
    float slices[SLICES * IMAGE];
    assert_ok(v2v_volume_open(&volume, path, NULL, test_world()));
    assert_ok(v2v_volume_read(volume, slices, FRAMES - 1, 0, SLICES));
    assert_true(slices[SLICES * IMAGE - 1] == (float)(FRAMES * SLICES * IMAGE - 1));
    v2v_volume_close(&volume);
}

int main(int argc, char **argv)
{
    static const char *const plans[] = {"h5.write:0:3", "h5.create:1:2", "h5.flush:2:5",
                                        "h5.write:3:1"};
    test_plan_faults(plans);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_fault_ends_all_ranks_and_leaves_nothing),
    };
    return test_mpi_main(tests, argc, argv);
}
