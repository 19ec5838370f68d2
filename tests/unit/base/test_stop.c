/* Signals that ask a process to stop: the first is heeded by who polls, one that comes a second
 * later ends it. */
#include "support.h"

#include "v2v3d/base/stop.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

/* Polls until it was asked, says so, and then polls no more. */
static void stubborn(int says)
{
    v2v_stop_install();
    v2v_stop_heed_ending();
    if (write(says, "r", 1) != 1) {
        _exit(2);
    }
    while (!v2v_stop_requested()) {
        usleep(1000);
    }
    if (write(says, "a", 1) != 1) {
        _exit(2);
    }
    for (;;) {
        pause();
    }
}

enum { AT_ONCE_US = 20000, LATER_US = 1100000 };

static void the_first_asks_and_a_later_one_ends(void **state)
{
    (void)state;
    static const struct {
        int first, then;
    } signals[] = {{SIGTERM, SIGTERM}, {SIGINT, SIGINT}, {SIGUSR1, SIGTERM}};
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        int ends[2], status = 0;
        char word = 0;
        assert_int_equal(pipe(ends), 0);
        const pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            stubborn(ends[1]);
        }
        assert_int_equal(read(ends[0], &word, 1), 1);
        assert_int_equal(kill(child, signals[i].first), 0);
        assert_int_equal(read(ends[0], &word, 1), 1);
        assert_int_equal(word, 'a');
        assert_int_equal(kill(child, signals[i].then), 0); /* as timeout(1) sends two */
        usleep(AT_ONCE_US);
        assert_int_equal(waitpid(child, &status, WNOHANG), 0);
        usleep(LATER_US);
        assert_int_equal(kill(child, signals[i].then), 0);
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status) && WTERMSIG(status) == signals[i].then);
        close(ends[0]);
        close(ends[1]);
    }
}

static void a_user_signal_only_asks(void **state)
{
    (void)state;
    v2v_stop_install();
    assert_false(v2v_stop_requested());
    assert_int_equal(raise(SIGUSR1), 0);
    assert_int_equal(raise(SIGUSR2), 0);
    assert_true(v2v_stop_requested());
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_first_asks_and_a_later_one_ends),
        cmocka_unit_test(a_user_signal_only_asks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
