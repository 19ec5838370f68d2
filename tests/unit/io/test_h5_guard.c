#include "support.h"

#include "h5_files.h"
#include "io/h5_guard.h"
#include "v2v3d/io/file.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static char path[512];

static void look_happily(const char *file)
{
    assert_string_equal(file, "a.h5");
}

static void look_and_crash(const char *file)
{
    (void)file;
    abort();
}

static void look_and_fail(const char *file)
{
    (void)file;
    _exit(1);
}

static void a_crash_of_the_child_is_bad_input(void **state)
{
    (void)state;
    assert_ok(v2v_h5_guard_with("a.h5", look_happily));
    assert_int_equal(v2v_h5_guard_with("a.h5", look_and_crash), V2V_E_INPUT);
    assert_string_equal(v2v_status_message(), "a.h5: is damaged: HDF5 crashed on it (signal 6)");
    assert_int_equal(v2v_h5_guard_with("a.h5", look_and_fail), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "a.h5: is damaged"));
}

static void look_at_limits(const char *file)
{
    struct rlimit core, space, time;
    (void)file;
    getrlimit(RLIMIT_CORE, &core);
    getrlimit(RLIMIT_AS, &space);
    getrlimit(RLIMIT_CPU, &time);
#ifdef __SANITIZE_ADDRESS__
    space.rlim_cur = 0; /* is not bounded there */
#endif
    _exit(!(core.rlim_max == 0 && space.rlim_cur != RLIM_INFINITY && time.rlim_cur <= 60));
}

static void the_child_is_bounded(void **state)
{
    (void)state;
    assert_ok(v2v_h5_guard_with("a.h5", look_at_limits));
}

static pid_t only_child(void)
{
    char text[64] = "";
    snprintf(path, sizeof path, "/proc/self/task/%d/children", (int)getpid());
    FILE *file = fopen(path, "re");
    const size_t got = file != NULL ? fread(text, 1, sizeof text - 1, file) : 0;
    if (file != NULL) {
        fclose(file);
    }
    text[got] = '\0';
    return (pid_t)strtol(text, NULL, 10);
}

/* What is no HDF5 file is for the caller to refuse. */
static void a_helper_looks_until_it_is_stopped(void **state)
{
    (void)state;
    assert_int_equal(only_child(), 0);
    v2v_file_guard_start();
    const pid_t helper = only_child();
    if (helper == 0) {
        test_skip("/proc does not tell a process' children");
    }
    snprintf(path, sizeof path, "%s/a.h5", test_folder(NULL));
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .type = TEST_H5_U16,
                                              .storage = TEST_H5_CHECKED,
                                              .rank = 4,
                                              .shape = {1, 1, 8, 8}});
    char kept[sizeof path];
    memcpy(kept, path, sizeof path);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(kill(helper, SIGUSR1), 0); /* as schedulers do to all of a job */
        assert_ok(v2v_h5_guard(kept));
        assert_ok(v2v_h5_guard("no such file"));
    }
    assert_int_equal(kill(helper, SIGKILL), 0);
    assert_ok(v2v_h5_guard(kept)); /* by itself */
    v2v_file_guard_stop();
    assert_int_equal(waitpid(helper, NULL, 0), helper);
    v2v_file_guard_start();
    const pid_t another = only_child();
    assert_true(another > 0);
    v2v_file_guard_stop();
    assert_int_equal(waitpid(another, NULL, 0), another);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_crash_of_the_child_is_bad_input),
        cmocka_unit_test(the_child_is_bounded),
        cmocka_unit_test(a_helper_looks_until_it_is_stopped),
    };
    return cmocka_run_group_tests_name("h5_guard", tests, NULL, NULL);
}
