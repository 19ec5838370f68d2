#include "capture.h"
#include "support.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void memory_is_zeroed_aligned_and_counted(void **state)
{
    (void)state;
    for (int64_t count = 0; count < 300; count += 7) {
        size_t before = v2v_mem_held();
        float *x = NULL;
        assert_ok(V2V_ALLOC(x, "test.small", count));
        assert_int_equal((uintptr_t)x % 64, 0);
        assert_int_equal(v2v_mem_held() - before, (size_t)count * sizeof *x);
        assert_true(v2v_mem_peak() >= v2v_mem_held());
        for (int64_t i = 0; i < count; i++) {
            assert_true(x[i] == 0.0f);
            x[i] = 1.0f; /* so that a second use of the place is seen */
        }
        v2v_mem_free(x);
        assert_int_equal(v2v_mem_held(), before);
    }
    v2v_mem_free(NULL);
}

/* Sizes about those from which on memory comes in large pages, and about whole numbers of them. */
static void large_memory_is_zeroed_aligned_and_counted(void **state)
{
    (void)state;
    static const int64_t mib = 1 << 20, about[] = {1, 2, 4, 6, 9, 64}, beside[] = {-1, 0, 1};
    for (size_t i = 0; i < sizeof about / sizeof *about; i++) {
        for (size_t k = 0; k < sizeof beside / sizeof *beside; k++) {
            const int64_t bytes = about[i] * mib + beside[k];
            const size_t before = v2v_mem_held();
            unsigned char *x = NULL;
            assert_ok(V2V_ALLOC(x, "test.large", bytes));
            assert_int_equal((uintptr_t)x % (bytes < mib ? 64 : V2V_PAGE_BYTES), 0);
            assert_int_equal(v2v_mem_held() - before, (size_t)bytes);
            for (int64_t b = 0; b < bytes; b++) {
                if (x[b] != 0) {
                    fail_msg("%lld bytes: %d at %lld", (long long)bytes, x[b], (long long)b);
                }
                x[b] = 1;
            }
            v2v_mem_free(x);
            assert_int_equal(v2v_mem_held(), before);
        }
    }
}

static void impossible_sizes_fail_with_the_label(void **state)
{
    (void)state;
    size_t before = v2v_mem_held();
    static const struct {
        int64_t count;
        size_t size;
    } cases[] = {{-1, 4}, {INT64_MAX, 4}, {INT64_MAX, 2}, {INT64_MAX, 1}, {INT64_MIN, 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        v2v_status_set_message("", "");
        assert_null(v2v_mem_alloc("test.large", cases[i].count, cases[i].size));
        assert_non_null(strstr(v2v_status_message(), "test.large"));
        assert_int_equal(v2v_mem_held(), before);
    }
}

static void limit_refuses_what_passes_it(void **state)
{
    (void)state;
    size_t held = v2v_mem_held();
    assert_true(v2v_mem_room() == SIZE_MAX);
    v2v_mem_set_limit(held + 1000);
    assert_int_equal(v2v_mem_room(), 1000);
    void *fits = v2v_mem_alloc("test.limit", 1000, 1);
    assert_non_null(fits);
    assert_null(v2v_mem_alloc("test.limit", 1, 1));
    assert_non_null(strstr(v2v_status_message(), "limit"));
    v2v_mem_free(fits);
    fits = v2v_mem_alloc("test.limit", 1, 1);
    assert_non_null(fits);
    assert_int_equal(v2v_mem_room(), 999);
    v2v_mem_set_limit(0);
    void *more = v2v_mem_alloc("test.limit", 100000, 1);
    assert_non_null(more);
    v2v_mem_free(fits);
    v2v_mem_free(more);
}

static void report_names_labels_by_peak_largest_first(void **state)
{
    (void)state;
    char text[4096];
    v2v_mem_free(v2v_mem_alloc("test.second", 2 << 20, 1));
    v2v_mem_free(v2v_mem_alloc("test.first", 3 << 20, 1));
    test_capture_begin();
    v2v_log_configure(V2V_LOG_INFO, 0);
    v2v_mem_report();
    test_capture_end(text, sizeof text);
    const char *first = strstr(text, "3.0 MiB  test.first");
    const char *second = strstr(text, "2.0 MiB  test.second");
    assert_non_null(first);
    assert_non_null(second);
    assert_true(first < second);
}

enum { THREADS = 4, ROUNDS = 2000 };

static void *take_and_give(void *failures)
{
    for (int i = 0; i < ROUNDS; i++) {
        char *a = v2v_mem_alloc("test.thread", 100 + i, 1);
        char *b = v2v_mem_alloc("test.thread", 50, 2);
        *(int *)failures += a == NULL || b == NULL || a[99 + i] != 0;
        v2v_mem_free(a);
        v2v_mem_free(b);
    }
    return NULL;
}

static void threads_share_the_account(void **state)
{
    (void)state;
    pthread_t thread[THREADS];
    int failures[THREADS] = {0};
    size_t before = v2v_mem_held();
    for (int i = 0; i < THREADS; i++) {
        assert_int_equal(pthread_create(&thread[i], NULL, take_and_give, &failures[i]), 0);
    }
    for (int i = 0; i < THREADS; i++) {
        assert_int_equal(pthread_join(thread[i], NULL), 0);
        assert_int_equal(failures[i], 0);
    }
    assert_int_equal(v2v_mem_held(), before);
}

static char many_labels[400][16];

static void more_labels_than_the_table_holds_are_gathered(void)
{
    for (int i = 0; i < 400; i++) {
        snprintf(many_labels[i], sizeof many_labels[i], "label.%d", i);
        v2v_mem_free(v2v_mem_alloc(many_labels[i], 1 << 20, 1));
    }
    v2v_mem_report();
    if (v2v_mem_held() != 0) {
        abort();
    }
}

static void free_foreign_memory(void)
{
    static _Alignas(64) char foreign[256];
    v2v_mem_free(foreign + 128);
}

static void more_labels_than_the_table_holds_do_no_harm(void **state)
{
    (void)state;
    static char text[1 << 16];
    assert_int_equal(
        test_in_child(more_labels_than_the_table_holds_are_gathered, text, sizeof text), 0);
    assert_non_null(strstr(text, "(other labels)"));
}

static void freeing_foreign_memory_is_a_bug(void **state)
{
    (void)state;
    char text[1024];
    assert_int_equal(test_in_child(free_foreign_memory, text, sizeof text), 128 + SIGABRT);
    assert_non_null(strstr(text, "memory.c:"));
}

static void product_is_checked(void **state)
{
    (void)state;
    assert_int_equal(v2v_mem_product(3, 4, 5), 60);
    assert_int_equal(v2v_mem_product(0, INT64_MAX, INT64_MAX), 0);
    assert_int_equal(v2v_mem_product(INT64_MAX, INT64_MAX, 0), 0);
    assert_true(v2v_mem_product(INT64_MAX, 1, 1) == INT64_MAX);
    assert_int_equal(v2v_mem_product(INT64_MAX, 2, 1), -1);
    assert_int_equal(v2v_mem_product((int64_t)1 << 31, (int64_t)1 << 31, 2), -1);
    assert_int_equal(v2v_mem_product(-1, -1, 1), -1);
    assert_int_equal(v2v_mem_product(0, 1, -1), -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(memory_is_zeroed_aligned_and_counted),
        cmocka_unit_test(large_memory_is_zeroed_aligned_and_counted),
        cmocka_unit_test(impossible_sizes_fail_with_the_label),
        cmocka_unit_test(limit_refuses_what_passes_it),
        cmocka_unit_test(report_names_labels_by_peak_largest_first),
        cmocka_unit_test(threads_share_the_account),
        cmocka_unit_test(more_labels_than_the_table_holds_do_no_harm),
        cmocka_unit_test(freeing_foreign_memory_is_a_bug),
        cmocka_unit_test(product_is_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
