/* Damaged HDF5 input: whatever bytes change, an open either succeeds or is
 * refused in one line that names the file; it never crashes and never hangs. */
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/recording.h"

#include <stdio.h>
#include <string.h>

enum { MOST_BYTES = 65536, MUTATIONS = 100, SEED = 20 };

static char path[512], damaged[512];
static char content[MOST_BYTES];

static size_t load(void)
{
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(content, 1, MOST_BYTES, file);
    assert_int_equal(fclose(file), 0);
    assert_true(size > 0 && size < MOST_BYTES);
    return size;
}

/* Up to 8 random bytes replaced, half of the time by the values that break sizes and addresses. */
static void mutate(size_t size, uint64_t number)
{
    static const unsigned char extreme[] = {0x00, 0x01, 0x7f, 0x80, 0xff};
    char copy[MOST_BYTES];
    memcpy(copy, content, size);
    const int64_t changes = 1 + v2v_random_below(SEED, number, 0, 8);
    for (int64_t i = 0; i < changes; i++) {
        const uint64_t draw = 1 + 4 * (uint64_t)i;
        const int64_t at = v2v_random_below(SEED, number, draw, (int64_t)size);
        copy[at] = v2v_random_below(SEED, number, draw + 1, 2)
                       ? (char)extreme[v2v_random_below(SEED, number, draw + 2, 5)]
                       : (char)v2v_random_below(SEED, number, draw + 3, 256);
    }
    FILE *file = fopen(damaged, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(copy, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* 1 when all of it could be read, 0 when it was refused. */
static int read_all(void)
{
    struct v2v_recording *recording = NULL;
    enum v2v_status rc =
        v2v_recording_open(&recording, damaged, &(struct v2v_input_settings){0}, NULL);
    if (rc == V2V_OK) {
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        const int64_t image = v2v_mem_product(info->height, info->width, 1);
        const int64_t count = v2v_mem_product(info->views, image, 1);
        /* A damaged shape may well be larger than the memory: that is no crash either. */
        float *views = count < (1 << 20) ? v2v_mem_alloc("test", count, sizeof *views) : NULL;
        for (int64_t t = 0; rc == V2V_OK && views != NULL && t < info->frames && t < 100; t++) {
            rc = v2v_recording_read(recording, views, t);
        }
        v2v_mem_free(views);
        v2v_recording_close(&recording);
    }
    if (rc != V2V_OK) {
        assert_int_equal(rc, V2V_E_INPUT);
        assert_non_null(strstr(v2v_status_message(), damaged));
        assert_null(strchr(v2v_status_message(), '\n'));
    }
    return rc == V2V_OK;
}

static void damaged_recordings_are_read_or_refused_but_never_crash(void **state)
{
    (void)state;
    static const enum test_h5_storage storages[] = {TEST_H5_CHECKED, TEST_H5_DEFLATED,
                                                    TEST_H5_CONTIGUOUS};
    snprintf(damaged, sizeof damaged, "%s/damaged.h5", test_folder(NULL));
    for (uint64_t s = 0; s < sizeof storages / sizeof storages[0]; s++) {
        int refused = 0;
        double slowest = 0.0;
        snprintf(path, sizeof path, "%s/rec.h5", test_folder(NULL));
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                                  .type = TEST_H5_U16,
                                                  .storage = storages[s],
                                                  .rank = 4,
                                                  .shape = {4, 3, 8, 8}});
        test_h5_text(path, "/views", "axes", "tvyx");
        test_h5_numbers(path, "/views", "pixel_size_um", (double[]){0.5}, 1);
        const size_t size = load();
        for (uint64_t n = 0; n < MUTATIONS; n++) {
            const double began = v2v_clock_now();
            mutate(size, s * MUTATIONS + n);
            refused += !read_all();
            const double took = v2v_clock_now() - began;
            slowest = took > slowest ? took : slowest;
        }
        print_message("%d of %d refused, slowest %.2f s\n", refused, MUTATIONS, slowest);
        assert_true(refused > 0 && refused < MUTATIONS);
        assert_true(slowest < 15.0); /* the guard's 10 s, and a busy machine */
    }
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(damaged_recordings_are_read_or_refused_but_never_crash),
    };
    return cmocka_run_group_tests_name("damaged_h5", tests, NULL, NULL);
}
