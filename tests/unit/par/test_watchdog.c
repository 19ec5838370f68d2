/** The watchdog alone, and in jobs of two ranks that this program starts out of itself: the first
 *  argument then names what the ranks do. */
#include "capture.h"
#include "support.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/par/watchdog.h"

#include <string.h>
#include <unistd.h>

static void nap(double seconds)
{
    double end = v2v_clock_now() + seconds;
    while (v2v_clock_now() < end) {
        usleep(1000);
    }
}

static void wait_too_long(void)
{
    v2v_watchdog_arm(0.1, "a collective write");
    nap(10.0);
}

static void rearm_in_time(void)
{
    for (int i = 0; i < 10; i++) {
        v2v_watchdog_arm(0.5, "a step");
        nap(0.1);
    }
    v2v_watchdog_disarm();
    nap(0.7);
    v2v_watchdog_arm(0.1, "a step");
    v2v_watchdog_arm(0.0, "nothing"); /* 0: off */
    nap(0.3);
    v2v_watchdog_arm(1e300, "for ever");
    nap(0.1);
    _exit(3);
}

static void say_a_long_name(void)
{
    static char name[1000];
    memset(name, 'x', sizeof name - 1);
    v2v_watchdog_arm(0.05, name);
    nap(10.0);
}

static void late_rank_says_what_it_waited_in_and_exits_74(void **state)
{
    (void)state;
    char text[1024];
    double start = v2v_clock_now();
    assert_int_equal(test_in_child(wait_too_long, text, sizeof text), 74);
    assert_true(v2v_clock_now() - start < 5.0);
    assert_string_equal(text, "error (rank 0): no progress for 0.1 s in a collective write; the "
                              "watchdog ends the job\n");
    assert_int_equal(test_in_child(say_a_long_name, text, sizeof text), 74);
    assert_non_null(strstr(text, "xxxx"));
}

static void watchdog_that_is_rearmed_or_off_is_silent(void **state)
{
    (void)state;
    char text[1024];
    assert_int_equal(test_in_child(rearm_in_time, text, sizeof text), 3);
    assert_string_equal(text, "");
}

struct job {
    const char *what;
    int exit_code;
    const char *said;
};

static void job_ends_whatever_one_of_its_ranks_does(void **state)
{
    (void)state;
    static const struct job jobs[] = {
        {"skip", 74, "no progress for 0.5 s in a sum over ranks"},
        {"abort", 65, ""},
        {"bug", 70, "error (rank 1): bug in v2v3d"},
        {"good", 0, ""},
    };
    for (size_t j = 0; j < sizeof jobs / sizeof jobs[0]; j++) {
        char text[1 << 14];
        double start = v2v_clock_now();
        int code = test_own_job(2, jobs[j].what, text, sizeof text);
        if (code != jobs[j].exit_code || strstr(text, jobs[j].said) == NULL) {
            fail_msg("%s: exit code %d: %s", jobs[j].what, code, text);
        }
        assert_true(v2v_clock_now() - start < 60.0);
    }
}

/** What a rank of a job does. */
static int be_a_rank(const char *what, int *argc, char ***argv)
{
    struct v2v_comm *world = NULL;
    double x = 1.0;
    int two = 2;
    if (v2v_par_init(&world, argc, argv) != V2V_OK) {
        return 1;
    }
    v2v_watchdog_arm(20.0, "the start of a rank");
    v2v_par_barrier(world);
    int rank = v2v_comm_rank(world);
    if (rank == 1 && strcmp(what, "abort") == 0) {
        v2v_par_abort(65);
    }
    V2V_ASSERT(rank == 0 || two == 3 || strcmp(what, "bug") != 0);
    if (rank == 0 || strcmp(what, "skip") != 0) {
        if (strcmp(what, "skip") == 0) {
            v2v_watchdog_arm(0.5, "a sum over ranks");
        }
        v2v_par_sum_f64(world, &x, 1);
    } else {
        nap(30.0);
    }
    v2v_watchdog_disarm();
    v2v_par_finalize(&world);
    return x == 2.0 && v2v_mem_held() == 0 ? 0 : 1;
}

int main(int argc, char **argv)
{
    if (argc > 1) {
        return be_a_rank(argv[1], &argc, &argv);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(late_rank_says_what_it_waited_in_and_exits_74),
        cmocka_unit_test(watchdog_that_is_rearmed_or_off_is_silent),
        cmocka_unit_test(job_ends_whatever_one_of_its_ranks_does),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
