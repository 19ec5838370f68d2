/* The guard's limits: these tests take its whole 10 s of processor time or 60 s of waiting, or try
 * to take all memory. */
#include "capture.h"
#include "support.h"

#include "io/h5_guard.h"
#include "v2v3d/base/clock.h"

#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void wait_for_ever(const char *path)
{
    while (path != NULL) {
        pause();
    }
}

static void compute_for_ever(const char *path)
{
    volatile const char *letter = path;
    while (*letter != '\0') {
    }
}

static void take_a_terabyte(const char *path)
{
    void *memory = malloc((size_t)1 << 40);
    (void)path;
    if (memory == NULL) {
        _exit(1);
    }
    free(memory);
}

/* The parent sleeps as long as this child lives: it sees only how the child ended. */
static void compute_unwatched(const char *path)
{
    int ends[2];
    const pid_t parent = getppid();
    if (pipe(ends) != 0) {
        _exit(1);
    }
    const pid_t waker = fork();
    if (waker == 0) {
        char byte;
        dup2(ends[0], STDIN_FILENO);
        close_range(STDERR_FILENO + 1, ~0U, 0); /* the guard's pipe is to end with the child */
        const ssize_t got = read(STDIN_FILENO, &byte, 1); /* 0 when the child is gone */
        kill(parent, SIGCONT);
        _exit(got == 0 ? 0 : 1);
    }
    if (waker < 0) {
        _exit(1);
    }
    kill(parent, SIGSTOP);
    compute_for_ever(path);
}

static void guard_unwatched(void)
{
    const enum v2v_status rc = v2v_h5_guard_with("a.h5", compute_unwatched);
    fprintf(stderr, "%s", v2v_status_message());
    _exit(rc == V2V_E_INPUT ? 0 : 1);
}

/* Not bad input: the disk may be slow, and frames that are done are kept. */
static void a_child_that_waits_for_ever_is_given_up_after_60_s(void **state)
{
    (void)state;
    const double began = v2v_clock_now();
    assert_int_equal(v2v_h5_guard_with("a.h5", wait_for_ever), V2V_E_IO);
    assert_non_null(strstr(v2v_status_message(), "a.h5: cannot be looked at"));
    assert_true(v2v_clock_now() - began > 59.9); /* two clocks: what is slow has all of them */
}

static void a_child_that_computes_for_ever_is_bad_input_after_10_s(void **state)
{
    (void)state;
    const double began = v2v_clock_now();
    assert_int_equal(v2v_h5_guard_with("a.h5", compute_for_ever), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "a.h5: is damaged: HDF5 looked at it for more"));
    assert_true(v2v_clock_now() - began > 9.9); /* what is sound has all of them */
}

static void processor_time_ends_a_child_that_nobody_watches(void **state)
{
    (void)state;
    char text[V2V_MESSAGE_BYTES];
    assert_int_equal(test_in_child(guard_unwatched, text, sizeof text), 0);
    assert_non_null(strstr(text, "a.h5: is damaged: HDF5 looked at it for more"));
}

static void a_child_cannot_take_all_memory(void **state)
{
    (void)state;
#ifdef __SANITIZE_ADDRESS__
    test_skip("with the address sanitizer the guard sets no such limit");
#endif
    assert_int_equal(v2v_h5_guard_with("a.h5", take_a_terabyte), V2V_E_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_child_that_waits_for_ever_is_given_up_after_60_s),
        cmocka_unit_test(a_child_that_computes_for_ever_is_bad_input_after_10_s),
        cmocka_unit_test(processor_time_ends_a_child_that_nobody_watches),
        cmocka_unit_test(a_child_cannot_take_all_memory),
    };
    return cmocka_run_group_tests_name("h5_guard", tests, NULL, NULL);
}
