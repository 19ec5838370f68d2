/* Writes that a thread does, as the file shows them afterwards. */
#include "io/write_behind.h"
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { PAGE = V2V_PAGE_BYTES, BYTES = 260 * PAGE };

static char path[600];
static unsigned char *data, *expected, *found; /* [BYTES], each begins at a page */

/* ---- the thread's own calls come here ---- */

static struct {
    int refuses; /* bool: the file system takes other pages only */
    int fails;   /* bool: the disk */
    int direct, buffered, unsynced;
} seen;

ssize_t pwrite(int file, const void *from, size_t bytes, off_t at)
{
    const int flags = fcntl(file, F_GETFL);
    if (seen.fails || ((flags & O_DIRECT) && seen.refuses)) {
        errno = seen.fails ? EIO : EINVAL;
        return -1;
    }
    seen.direct += (flags & O_DIRECT) != 0;
    seen.buffered += (flags & O_DIRECT) == 0;
    seen.unsynced += (flags & O_DSYNC) == 0;
    return syscall(SYS_pwrite64, file, from, bytes, at);
}

static int setup(void **state)
{
    (void)state;
    assert_ok(V2V_ALLOC(data, "test", BYTES));
    assert_ok(V2V_ALLOC(expected, "test", BYTES));
    assert_ok(V2V_ALLOC(found, "test", BYTES));
    assert_int_equal((uintptr_t)data % PAGE, 0);
    for (int64_t i = 0; i < BYTES; i++) {
        data[i] = (unsigned char)(255.0 * v2v_random_uniform(1, 0, (uint64_t)i));
    }
    return 0;
}

static int drop(void **state)
{
    (void)state;
    v2v_mem_free(data);
    v2v_mem_free(expected);
    v2v_mem_free(found);
    return 0;
}

static struct v2v_write_behind *begin(const char *folder)
{
    struct v2v_write_behind *behind = NULL;
    snprintf(path, sizeof path, "%s/behind-%ld", folder, (long)getpid());
    FILE *file = fopen(path, "we");
    assert_non_null(file);
    assert_int_equal(fclose(file), 0);
    memset(&seen, 0, sizeof seen);
    memset(expected, 0, BYTES);
    assert_ok(v2v_write_behind_create(&behind, path, "named"));
    return behind;
}

static void put(struct v2v_write_behind *behind, int64_t first, int64_t bytes, int64_t at)
{
    assert_ok(v2v_write_behind_put(
        behind,
        &(struct v2v_piece){.data = data + first, .bytes = bytes, .at = at, .fault = "h5.write"}));
    memcpy(expected + at, data + first, (size_t)bytes);
}

static void assert_file(void)
{
    FILE *file = fopen(path, "re");
    assert_non_null(file);
    assert_int_equal(fread(found, 1, BYTES, file), BYTES);
    assert_int_equal(fclose(file), 0);
    assert_memory_equal(found, expected, BYTES);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(seen.unsynced, 0);
}

/* Of a file in this folder, all kinds of pieces; one may lie over what is there. */
static void write_pieces(const char *folder, int refuses)
{
    struct v2v_write_behind *behind = begin(folder);
    const unsigned char little[] = {0xef, 0xcd, 0xab, 0x89, 0x67, 0x45, 0x23, 0x01};
    seen.refuses = refuses;
    put(behind, 0, BYTES, 0);           /* whole pages */
    put(behind, 5, 3 * PAGE, 2 * PAGE); /* not from one */
    put(behind, 0, PAGE, 7 * PAGE + 7); /* not to one */
    put(behind, PAGE, PAGE - 8, 0);     /* a part of one */
    assert_ok(v2v_write_behind_put(behind, &(struct v2v_piece){.number = 0x0123456789abcdefU,
                                                               .bytes = 8,
                                                               .at = 9 * PAGE + 3,
                                                               .fault = "h5.mark"}));
    memcpy(expected + 9 * PAGE + 3, little, sizeof little);
    put(behind, 3 * PAGE, 2 * PAGE, 20 * PAGE);
    assert_ok(v2v_write_behind_wait(behind));
    v2v_write_behind_destroy(&behind);
    assert_file();
}

static void every_piece_lies_where_it_belongs(void **state)
{
    (void)state;
    write_pieces(test_folder(NULL), 0);
    if (seen.direct == 0) {
        print_message("this file system writes no pages without keeping them\n");
    } else {
        assert_int_equal(seen.direct, 2);
    }
    assert_int_equal(seen.direct + seen.buffered, 6);
}

static void where_pages_cannot_go_directly_they_are_written_all_the_same(void **state)
{
    (void)state;
    write_pieces(test_folder(NULL), 1);
    assert_int_equal(seen.direct, 0);
    assert_int_equal(seen.buffered, 6);
    if (access("/dev/shm", W_OK) == 0) { /* a file system in memory */
        write_pieces("/dev/shm", 0);
        assert_int_equal(seen.direct + seen.buffered, 6);
    }
}

static void nothing_is_written_behind_a_failure_which_every_call_tells(void **state)
{
    (void)state;
    struct v2v_write_behind *behind = begin(test_folder(NULL));
    const struct v2v_piece next = {.data = data, .bytes = PAGE, .at = 0, .fault = "h5.write"};
    seen.fails = 1;
    assert_ok(v2v_write_behind_put(behind, &next));
    assert_int_equal(v2v_write_behind_wait(behind), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "named: writing failed: Input/output error"));
    seen.fails = 0;
    v2v_status_set_message("", "");
    assert_int_equal(v2v_write_behind_put(behind, &next), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "named: writing failed"));
    assert_int_equal(v2v_write_behind_wait(behind), V2V_E_IO);
    v2v_write_behind_destroy(&behind);
    assert_int_equal(seen.direct + seen.buffered, 0);
    assert_int_equal(unlink(path), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_piece_lies_where_it_belongs),
        cmocka_unit_test(where_pages_cannot_go_directly_they_are_written_all_the_same),
        cmocka_unit_test(nothing_is_written_behind_a_failure_which_every_call_tells),
    };
    return cmocka_run_group_tests(tests, setup, drop);
}
