/* Counts that pass int, and writes that pass one round of messages. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/volume.h"

#include <stdio.h>
#include <sys/statvfs.h>

#define MEAN_ONLY (1u << V2V_VOLUME_MEAN)

static char path[512];

/* 0 when the test's folder has less room than that. */
static int use(double bytes)
{
    struct statvfs disk;
    snprintf(path, sizeof path, "%s/vol.h5", test_folder(test_world()));
    int64_t short_of_room = 1;
    const char *folder = test_folder(test_world());
    if (statvfs(folder, &disk) == 0 && (double)disk.f_bavail * (double)disk.f_frsize > bytes) {
        short_of_room = 0;
    }
    v2v_par_max_i64(test_world(), &short_of_room, 1);
    if (short_of_room) {
        print_message("%s has less than %.0f GB of room\n", folder, bytes * 1e-9);
    }
    return !short_of_room;
}

/* 90 x 40 x 800 x 800 = 2.3e9 elements; only its last slice is written, the file has holes. */
static void the_last_slice_of_a_dataset_above_two_to_31_is_in_its_place(void **state)
{
    (void)state;
    const struct v2v_volume_info info = {.frames = 90, .slices = 40, .height = 800, .width = 800};
    const int64_t image = INT64_C(800) * 800;
    const int last = v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    float *slice = NULL;
    if (!use(1.2e10)) {
        skip();
    }
    assert_ok(V2V_ALLOC(slice, "test", image));
    for (int64_t i = 0; i < image; i++) {
        slice[i] = (float)i;
    }
    assert_ok(v2v_volume_create(&writer, path, &info, MEAN_ONLY, NULL, 0, test_world()));
    assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, slice, 89, 39, last ? 1 : 0));
    assert_ok(v2v_volume_finish(&writer));
    for (int64_t i = 0; i < image; i++) {
        slice[i] = -1.0f;
    }
    assert_ok(v2v_volume_open(&volume, path, NULL, test_world()));
    assert_ok(v2v_volume_read(volume, slice, 89, 39, 1));
    for (int64_t i = 0; i < image; i++) {
        assert_true(slice[i] == (float)i);
    }
    assert_ok(v2v_volume_read(volume, slice, 89, 38, 1));
    assert_true(slice[0] == 0.0f && slice[image - 1] == 0.0f);
    v2v_volume_close(&volume);
    v2v_mem_free(slice);
}

/* Slices of 64 MB: rank 0 brings five, the others bring one or none. */
static void ranks_need_not_bring_equally_much(void **state)
{
    (void)state;
    enum { SIDE = 4000, SLICES = 8 };
    const int64_t image = (int64_t)SIDE * SIDE;
    const struct v2v_volume_info info = {
        .frames = 1, .slices = SLICES, .height = SIDE, .width = SIDE};
    const int rank = v2v_comm_rank(test_world());
    const int64_t first = rank == 0 ? 0 : 4 + rank, count = rank == 0 ? 5 : rank % 2;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    float *slices = NULL;
    if (!use(1e9)) {
        skip();
    }
    assert_ok(V2V_ALLOC(slices, "test", (count > 0 ? count : 1) * image));
    for (int64_t z = 0; z < count; z++) {
        for (int64_t i = 0; i < image; i++) {
            slices[z * image + i] = (float)(first + z + 1) + (float)(i % 8) * 0.125f;
        }
    }
    assert_ok(v2v_volume_create(&writer, path, &info, MEAN_ONLY, NULL, 0, test_world()));
    assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, slices, 0, first, count));
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&volume, path, NULL, test_world()));
    for (int64_t z = 0; z < 5; z++) {
        assert_ok(v2v_volume_read(volume, slices, 0, z, 1));
        assert_true(slices[0] == (float)(z + 1) && slices[image - 1] == (float)(z + 1) + 0.875f);
    }
    if (v2v_comm_size(test_world()) > 1) {
        assert_ok(v2v_volume_read(volume, slices, 0, 5, 1));
        assert_true(slices[image / 2] == 6.0f);
    }
    v2v_volume_close(&volume);
    v2v_mem_free(slices);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_last_slice_of_a_dataset_above_two_to_31_is_in_its_place),
        cmocka_unit_test(ranks_need_not_bring_equally_much),
    };
    return test_mpi_main(tests, argc, argv);
}
