#include "capture.h"
#include "support.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/** The example of base/status.h. */
static enum v2v_status header_example(void)
{
    enum v2v_status rc = V2V_OK;
    float *x = NULL;
    V2V_TRY(V2V_ALLOC(x, "example", 1000));
    for (int64_t i = 0; i < 1000; i++) {
        x[i] = (float)v2v_random_normal(7, 0, (uint64_t)i);
    }
    if (x[0] != x[0]) {
        V2V_TRY(V2V_FAIL(V2V_E_NUMERIC, "sample 0 is NaN"));
    }
done:
    v2v_mem_free(x);
    return rc;
}

static void header_example_works(void **state)
{
    (void)state;
    assert_ok(header_example());
}

static void exit_codes_are_those_of_the_design(void **state)
{
    (void)state;
    static const int expected[V2V_STATUS_COUNT] = {
        [V2V_OK] = 0,        [V2V_STOPPED] = 85,   [V2V_E_USAGE] = 2, [V2V_E_CONFIG] = 78,
        [V2V_E_INPUT] = 65,  [V2V_E_BUSY] = 75,    [V2V_E_IO] = 74,   [V2V_E_NUMERIC] = 70,
        [V2V_E_MEMORY] = 70, [V2V_E_INTERNAL] = 70};
    for (int s = 0; s < V2V_STATUS_COUNT; s++) {
        assert_int_equal(v2v_status_exit_code((enum v2v_status)s), expected[s]);
        assert_true(strlen(v2v_status_name((enum v2v_status)s)) > 0);
    }
    assert_int_equal(v2v_status_exit_code((enum v2v_status)99), 70);
    assert_string_equal(v2v_status_name((enum v2v_status) - 1), "unknown");
}

static void newest_failure_is_the_record(void **state)
{
    (void)state;
    assert_int_equal(V2V_FAIL(V2V_E_IO, "first %d", 1), V2V_E_IO);
    int line = __LINE__ + 1;
    assert_int_equal(V2V_FAIL(V2V_E_INPUT, "second %d", 2), V2V_E_INPUT);
    char place[64];
    snprintf(place, sizeof place, "test_status.c:%d", line);
    assert_string_equal(v2v_status_message(), "second 2");
    assert_non_null(strstr(v2v_status_place(), place));
}

static void record_can_be_wrapped_into_its_successor(void **state)
{
    (void)state;
    (void)V2V_FAIL(V2V_E_IO, "inner");
    (void)V2V_FAIL(V2V_E_IO, "outer: %s", v2v_status_message());
    assert_string_equal(v2v_status_message(), "outer: inner");
    v2v_status_set_message(v2v_status_message(), v2v_status_place());
    assert_string_equal(v2v_status_message(), "outer: inner");
}

static void long_message_is_cut_at_its_bytes(void **state)
{
    (void)state;
    char text[2 * V2V_MESSAGE_BYTES];
    memset(text, 'x', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    (void)V2V_FAIL(V2V_E_IO, "%s", text);
    assert_int_equal(strlen(v2v_status_message()), V2V_MESSAGE_BYTES - 1);
}

static void *fail_elsewhere(void *seen)
{
    *(int *)seen = v2v_status_message()[0] != '\0';
    (void)V2V_FAIL(V2V_E_IO, "of the other thread");
    return NULL;
}

static void record_belongs_to_its_thread(void **state)
{
    (void)state;
    pthread_t thread;
    int seen = -1;
    (void)V2V_FAIL(V2V_E_IO, "mine");
    assert_int_equal(pthread_create(&thread, NULL, fail_elsewhere, &seen), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_int_equal(seen, 0);
    assert_string_equal(v2v_status_message(), "mine");
}

static void break_an_assertion(void)
{
    int two = 2;
    v2v_log_set_rank(3, 4);
    V2V_ASSERT(two == 3);
}

static void leave_with_70(void)
{
    _exit(70);
}

static void break_an_assertion_with_hook(void)
{
    v2v_status_on_bug(leave_with_70);
    break_an_assertion();
}

static void bug_names_rank_place_and_condition_and_aborts(void **state)
{
    (void)state;
    char text[512];
    assert_int_equal(test_in_child(break_an_assertion, text, sizeof text), 128 + SIGABRT);
    assert_non_null(strstr(text, "rank 3"));
    assert_non_null(strstr(text, "test_status.c:"));
    assert_non_null(strstr(text, "two == 3"));
    assert_int_equal(test_in_child(break_an_assertion_with_hook, text, sizeof text), 70);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_works),
        cmocka_unit_test(exit_codes_are_those_of_the_design),
        cmocka_unit_test(newest_failure_is_the_record),
        cmocka_unit_test(record_can_be_wrapped_into_its_successor),
        cmocka_unit_test(long_message_is_cut_at_its_bytes),
        cmocka_unit_test(record_belongs_to_its_thread),
        cmocka_unit_test(bug_names_rank_place_and_condition_and_aborts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
