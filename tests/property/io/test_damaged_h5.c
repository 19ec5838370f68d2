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

static void write_damaged(const char *bytes, size_t size)
{
    FILE *file = fopen(damaged, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
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
    write_damaged(copy, size);
}

/* 1 when all of it could be read, 0 when it was refused. @param intact set to whether every pixel
 * has its place's number mod 100; or NULL */
static int read_all(int *intact)
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
            for (int64_t i = 0; rc == V2V_OK && intact != NULL && i < count; i++) {
                *intact &= views[i] == (float)((t * count + i) % 100);
            }
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
            refused += !read_all(NULL);
            const double took = v2v_clock_now() - began;
            slowest = took > slowest ? took : slowest;
        }
        print_message("%d of %d refused, slowest %.2f s\n", refused, MUTATIONS, slowest);
        assert_true(refused > 0 && refused < MUTATIONS);
        assert_true(slowest < 65.0); /* the guard's 10 s, on a busy machine its minute */
    }
    assert_int_equal(v2v_mem_held(), 0);
}

enum { CHUNK_BYTES = 8 * 8 * 2, RANK = 4 };

static uint32_t number_at(const char *bytes, int width)
{
    uint32_t value = 0;
    for (int i = width - 1; i >= 0; i--) {
        value = value << 8 | (unsigned char)bytes[i];
    }
    return value;
}

static void put_number(char *bytes, uint32_t value)
{
    for (int i = 0; i < 4; i++) {
        bytes[i] = (char)(value >> (8 * i));
    }
}

/* Set what the index records of chunk `number`: its stored bytes, and which filters it was written
 * without. The index is a B-tree of version 1 (HDF5 file format, III.A.1): "TREE", type 1, level,
 * entries, two addresses; then keys (bytes, filters, RANK + 1 offsets) and addresses in turn. */
static void record(size_t size, int number, uint32_t bytes, uint32_t left_out)
{
    enum { HEAD = 24, ENTRY = 8 + 8 * (RANK + 1) + 8 };
    char copy[MOST_BYTES];
    int patched = 0;
    memcpy(copy, content, size);
    for (size_t at = 0; at + HEAD < size; at++) {
        if (memcmp(copy + at, "TREE", 4) != 0 || copy[at + 4] != 1 || copy[at + 5] != 0) {
            continue;
        }
        const int entries = (int)number_at(copy + at + 6, 2);
        if (number < entries) {
            char *key = copy + at + HEAD + (size_t)number * ENTRY;
            put_number(key, bytes);
            put_number(key + 4, left_out);
            patched++;
        }
    }
    assert_int_equal(patched, 1);
    write_damaged(copy, size);
}

/* HDF5 1.10 copies whole chunks out of what it read or decoded, however short that is. */
static void a_chunk_of_a_wrong_size_is_refused_or_read_to_the_bit(void **state)
{
    (void)state;
    static const enum test_h5_storage storages[] = {TEST_H5_CHUNKED, TEST_H5_CHECKED,
                                                    TEST_H5_DEFLATED};
    static const uint32_t sizes[] = {
        0, 1, 16, CHUNK_BYTES - 1, CHUNK_BYTES + 8, 1 << 16, 0x7fffffff, 0xfffffff0};
    enum { SIZES = sizeof sizes / sizeof sizes[0] };
    snprintf(damaged, sizeof damaged, "%s/damaged.h5", test_folder(NULL));
    snprintf(path, sizeof path, "%s/rec.h5", test_folder(NULL));
    for (int s = 0; s < 3; s++) {
        int refused = 0, intact = 1;
        remove(path);
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                                  .type = TEST_H5_U16,
                                                  .storage = storages[s],
                                                  .rank = RANK,
                                                  .shape = {4, 3, 8, 8}});
        const size_t size = load();
        write_damaged(content, size);
        assert_true(read_all(&intact) && intact);
        for (int i = 0; i < 2 * SIZES; i++) {
            intact = 1;
            record(size, i % 3 * 5, sizes[i / 2], i % 2 == 0 ? 0 : UINT32_MAX);
            if (!read_all(&intact)) {
                refused++;
            } else if (!intact) {
                fail_msg("storage %d: chunk %d of %u bytes, %s filters, has wrong pixels", s,
                         i % 3 * 5, sizes[i / 2], i % 2 == 0 ? "with" : "without");
            }
        }
        print_message("%d of %d refused\n", refused, 2 * SIZES);
        assert_true(refused > SIZES);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_chunk_of_a_wrong_size_is_refused_or_read_to_the_bit),
        cmocka_unit_test(damaged_recordings_are_read_or_refused_but_never_crash),
    };
    return cmocka_run_group_tests_name("damaged_h5", tests, NULL, NULL);
}
