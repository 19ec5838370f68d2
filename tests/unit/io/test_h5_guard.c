#include "support.h"

#include "io/h5_guard.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static enum v2v_status look_happily(const void *argument)
{
    return *(const int *)argument == 7 ? V2V_OK : V2V_E_INTERNAL;
}

static enum v2v_status look_and_refuse(const void *argument)
{
    (void)argument;
    return V2V_FAIL(V2V_E_INPUT, "a.h5: /views: is no good");
}

static enum v2v_status look_and_crash(const void *argument)
{
    (void)argument;
    abort();
}

static enum v2v_status look_and_leave(const void *argument)
{
    (void)argument;
    _exit(0);
}

static void the_childs_verdict_and_message_become_the_callers(void **state)
{
    (void)state;
    assert_ok(v2v_h5_guard("a.h5", look_happily, &(int){7}));
    v2v_status_set_message("", "");
    assert_int_equal(v2v_h5_guard("a.h5", look_and_refuse, NULL), V2V_E_INPUT);
    assert_string_equal(v2v_status_message(), "a.h5: /views: is no good");
    assert_non_null(strstr(v2v_status_place(), "test_h5_guard.c:"));
}

static void a_crash_of_the_child_is_bad_input(void **state)
{
    (void)state;
    assert_int_equal(v2v_h5_guard("a.h5", look_and_crash, NULL), V2V_E_INPUT);
    assert_string_equal(v2v_status_message(), "a.h5: is damaged: HDF5 crashed on it (signal 6)");
    assert_int_equal(v2v_h5_guard("a.h5", look_and_leave, NULL), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "a.h5: is damaged"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_childs_verdict_and_message_become_the_callers),
        cmocka_unit_test(a_crash_of_the_child_is_bad_input),
    };
    return cmocka_run_group_tests_name("h5_guard", tests, NULL, NULL);
}
