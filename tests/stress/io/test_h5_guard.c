/* The guard's limits: these tests take its whole 10 s, or try to take all memory. */
#include "support.h"

#include "io/h5_guard.h"
#include "v2v3d/base/clock.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static enum v2v_status wait_for_ever(const void *argument)
{
    const int *go_on = argument;
    while (*go_on) {
        pause();
    }
    return V2V_OK;
}

static enum v2v_status compute_for_ever(const void *argument)
{
    volatile const int *go_on = argument;
    while (*go_on) {
    }
    return V2V_OK;
}

static enum v2v_status take_a_terabyte(const void *argument)
{
    (void)argument;
    void *memory = malloc((size_t)1 << 40);
    const int refused = memory == NULL;
    free(memory);
    return refused ? V2V_FAIL(V2V_E_INPUT, "no terabyte") : V2V_OK;
}

static void assert_late(enum v2v_status (*look)(const void *))
{
    const int go_on = 1;
    const double began = v2v_clock_now();
    assert_int_equal(v2v_h5_guard("a.h5", look, &go_on), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "a.h5: is damaged: HDF5 looked at it for more"));
    assert_true(v2v_clock_now() - began < 15.0); /* 10 s, and a busy machine */
}

static void a_child_that_waits_for_ever_is_bad_input_after_10_s(void **state)
{
    (void)state;
    assert_late(wait_for_ever);
}

static void a_child_that_computes_for_ever_is_bad_input_after_10_s(void **state)
{
    (void)state;
    assert_late(compute_for_ever);
}

static void a_child_cannot_take_all_memory(void **state)
{
    (void)state;
#ifdef __SANITIZE_ADDRESS__
    skip(); /* the guard sets no such limit here */
#endif
    assert_int_equal(v2v_h5_guard("a.h5", take_a_terabyte, NULL), V2V_E_INPUT);
    assert_string_equal(v2v_status_message(), "no terabyte");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_child_that_waits_for_ever_is_bad_input_after_10_s),
        cmocka_unit_test(a_child_that_computes_for_ever_is_bad_input_after_10_s),
        cmocka_unit_test(a_child_cannot_take_all_memory),
    };
    return cmocka_run_group_tests_name("h5_guard", tests, NULL, NULL);
}
