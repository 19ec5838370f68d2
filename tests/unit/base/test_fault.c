#include "capture.h"
#include "support.h"

#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/stop.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The plan is read once a process: every case runs in a child. The exit code has a bit for each
 * passage that failed. */
static const char *plan;
static int rank_of_child;

static void pass_the_site_six_times(void)
{
    int failed = 0;
    setenv("V2V_FAULT", plan, 1);
    v2v_fault_set_rank(rank_of_child);
    for (int i = 0; i < 6; i++) {
        enum v2v_status rc = V2V_FAULT_POINT("io.write");
        failed |= (rc != V2V_OK) << i;
        if (rc != V2V_OK && (rc != V2V_E_IO || strstr(v2v_status_message(), "io.write") == NULL)) {
            _exit(255);
        }
    }
    _exit(failed);
}

static void allocate_three_times(void)
{
    int failed = 0;
    setenv("V2V_FAULT", "mem:0:2", 1);
    for (int i = 0; i < 3; i++) {
        char *x = NULL;
        failed |= (V2V_ALLOC(x, "test.fault", 10) != V2V_OK) << i;
        v2v_mem_free(x);
    }
    _exit(v2v_mem_held() == 0 ? failed : 255);
}

static void check(const char *text, int rank, int expected)
{
    char said[256];
    plan = text;
    rank_of_child = rank;
    assert_int_equal(test_in_child(pass_the_site_six_times, said, sizeof said), expected);
}

static int skip_without_faults(void)
{
#ifdef V2V_FAULTS
    return 0;
#else
    print_message("built without V2V_FAULTS\n");
    return 1;
#endif
}

static void nth_passage_on_the_rank_fails(void **state)
{
    (void)state;
    if (skip_without_faults()) {
        skip();
    }
    check("", 0, 0);
    check("io.write:0:1", 0, 1 << 0);
    check("io.write:0:3", 0, 1 << 2);
    check("io.write:0:7", 0, 0);
    check("io.write:1:3", 0, 0);
    check("io.write:1:3", 1, 1 << 2);
    check("io.read:0:1", 0, 0);
    check("io.write:0:5+", 0, (1 << 4) | (1 << 5));
}

static void malformed_plan_is_named_and_injects_nothing(void **state)
{
    (void)state;
    static const char *const bad[] = {"io.write",      "io.write:0",     "io.write:0:0",
                                      "io.write:0:1x", "io.write:0:1+x", ":0:1"};
    if (skip_without_faults()) {
        skip();
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char said[256];
        plan = bad[i];
        rank_of_child = 0;
        assert_int_equal(test_in_child(pass_the_site_six_times, said, sizeof said), 0);
        assert_non_null(strstr(said, bad[i]));
    }
}

static void nth_allocation_fails(void **state)
{
    (void)state;
    char said[256];
    if (skip_without_faults()) {
        skip();
    }
    assert_int_equal(test_in_child(allocate_three_times, said, sizeof said), 1 << 1);
}

static void raise_and_report(void)
{
    v2v_stop_install();
    int before = v2v_stop_requested();
    raise(plan[0] == '1' ? SIGUSR1 : SIGUSR2);
    _exit(10 * before + v2v_stop_requested());
}

static void signals_set_the_stop_flag(void **state)
{
    (void)state;
    char said[256];
    plan = "1";
    assert_int_equal(test_in_child(raise_and_report, said, sizeof said), 1);
    plan = "2";
    assert_int_equal(test_in_child(raise_and_report, said, sizeof said), 1);
    assert_int_equal(v2v_stop_requested(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nth_passage_on_the_rank_fails),
        cmocka_unit_test(malformed_plan_is_named_and_injects_nothing),
        cmocka_unit_test(nth_allocation_fails),
        cmocka_unit_test(signals_set_the_stop_flag),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
