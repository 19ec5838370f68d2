#include "capture.h"
#include "support.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

enum { TEXT_BYTES = 8192 };

static int setup(void **state)
{
    (void)state;
    v2v_log_configure(V2V_LOG_INFO, 0);
    v2v_log_set_rank(0, 1);
    return 0;
}

static void levels_above_the_chosen_one_are_silent(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    test_capture_begin();
    v2v_log(V2V_LOG_DEBUG, "d%d", 1);
    v2v_log(V2V_LOG_INFO, "i%d", 2);
    v2v_log(V2V_LOG_WARNING, "w%d", 3);
    v2v_log(V2V_LOG_ERROR, "e%d", 4);
    v2v_log_configure(V2V_LOG_ERROR, 0);
    v2v_log(V2V_LOG_WARNING, "not this");
    v2v_log_configure(V2V_LOG_DEBUG, 0);
    v2v_log(V2V_LOG_DEBUG, "d5");
    test_capture_end(text, sizeof text);
    assert_string_equal(text, "i2\nwarning: w3\nerror: e4\ndebug: d5\n");
}

static void other_ranks_print_warnings_and_errors_with_their_rank(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    test_capture_begin();
    v2v_log_set_rank(2, 3);
    v2v_log(V2V_LOG_INFO, "not this");
    v2v_log(V2V_LOG_WARNING, "careful");
    v2v_log(V2V_LOG_ERROR, "broken");
    test_capture_end(text, sizeof text);
    assert_string_equal(text, "warning (rank 2): careful\nerror (rank 2): broken\n");
}

static void line_stays_one_line_and_long_text_is_cut(void **state)
{
    (void)state;
    char text[TEXT_BYTES], lengthy[5000];
    memset(lengthy, 'x', sizeof lengthy - 1);
    lengthy[sizeof lengthy - 1] = '\0';
    test_capture_begin();
    v2v_log(V2V_LOG_INFO, "a\nb\033[31mc");
    v2v_log(V2V_LOG_ERROR, "%s", lengthy);
    test_capture_end(text, sizeof text);
    assert_int_equal(strncmp(text, "a b?[31mc\nerror: xxx", 20), 0);
    assert_true(strlen(text) < 2100 && text[strlen(text) - 1] == '\n');
    assert_ptr_equal(strchr(strchr(text, '\n') + 1, '\n'), text + strlen(text) - 1);
}

static void closed_stderr_costs_nothing(void **state)
{
    (void)state;
    int saved = dup(STDERR_FILENO);
    close(STDERR_FILENO);
    v2v_log(V2V_LOG_ERROR, "to nobody");
    assert_true(dup2(saved, STDERR_FILENO) >= 0);
    close(saved);
}

static void progress_without_terminal_is_one_last_line(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    struct v2v_progress progress;
    test_capture_begin();
    v2v_progress_begin(&progress, "frames", 2, 10);
    for (int64_t done = 3; done <= 10; done++) {
        v2v_progress_step(&progress, done, "loss 0.5");
    }
    v2v_progress_end(&progress);
    test_capture_end(text, sizeof text);
    assert_int_equal(strncmp(text, "frames 10/10 100%, ", 19), 0);
    assert_non_null(strstr(text, "0:00 left, loss 0.5\n"));
    assert_ptr_equal(strchr(text, '\n'), text + strlen(text) - 1);
}

static void progress_without_terminal_prints_a_line_after_ten_seconds(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    struct v2v_progress progress;
    test_capture_begin();
    v2v_progress_begin(&progress, "steps", 0, 4);
    progress.started -= 11.0; /* as if they had passed */
    progress.last_printed -= 11.0;
    v2v_progress_step(&progress, 1, NULL);
    v2v_progress_step(&progress, 2, NULL);
    test_capture_end(text, sizeof text);
    assert_int_equal(strncmp(text, "steps 1/4  25%, 0.0909/s, 0:11 elapsed, 0:33 left\n", 50), 0);
    assert_ptr_equal(strchr(text, '\n'), text + strlen(text) - 1);
}

/* Of 33 seconds that are left by the rate, 4 are allowed. */
static void progress_knows_a_limit_of_time(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    struct v2v_progress progress;
    test_capture_begin();
    v2v_progress_begin(&progress, "steps", 0, 4);
    progress.most_s = 15.0;
    progress.started -= 11.0;
    progress.last_printed -= 11.0;
    v2v_progress_step(&progress, 1, NULL);
    test_capture_end(text, sizeof text);
    assert_non_null(strstr(text, "0:11 elapsed, 0:04 left\n"));
}

static void progress_of_nothing_and_of_other_ranks_is_harmless(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    struct v2v_progress progress = {0};
    test_capture_begin();
    v2v_progress_end(&progress); /* it never began */
    v2v_progress_begin(&progress, "nothing", 0, 0);
    v2v_progress_end(&progress);
    v2v_log_set_rank(1, 2);
    v2v_progress_begin(&progress, "not this", 0, 5);
    v2v_progress_end(&progress);
    test_capture_end(text, sizeof text);
    assert_int_equal(strncmp(text, "nothing 0/0 100%", 16), 0);
    assert_null(strstr(text, "not this"));
}

/** Draw a bar, log a line in the middle, end: on a pseudo terminal. */
static void draw_on_terminal(void)
{
    struct v2v_progress progress;
    v2v_progress_begin(&progress, "frames", 0, 10);
    progress.last_printed -= 1.0;
    v2v_progress_step(&progress, 5, NULL);
    v2v_log(V2V_LOG_INFO, "a line");
    v2v_progress_end(&progress);
    v2v_log(V2V_LOG_INFO, "after");
}

/** A pseudo terminal hands its text on piece by piece, some time later. */
static void read_until(int master, const char *end, char *text, size_t bytes)
{
    struct pollfd ready = {.fd = master, .events = POLLIN};
    size_t used = 0;
    text[0] = '\0';
    while (strstr(text, end) == NULL && used + 1 < bytes && poll(&ready, 1, 5000) == 1) {
        ssize_t got = read(master, text + used, bytes - 1 - used);
        if (got <= 0) {
            return;
        }
        used += (size_t)got;
        text[used] = '\0';
    }
}

static void log_line_on_a_terminal_clears_the_bar_and_redraws_it(void **state)
{
    (void)state;
    char text[TEXT_BYTES];
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0) {
        test_skip("no pseudo terminal here");
    }
    int terminal = open(ptsname(master), O_RDWR | O_NOCTTY);
    struct termios mode;
    assert_int_equal(tcgetattr(terminal, &mode), 0);
    cfmakeraw(&mode);
    assert_int_equal(tcsetattr(terminal, TCSANOW, &mode), 0);
    int saved = dup(STDERR_FILENO);
    assert_true(dup2(terminal, STDERR_FILENO) >= 0);
    draw_on_terminal();
    assert_true(dup2(saved, STDERR_FILENO) >= 0);
    read_until(master, "after\n", text, sizeof text);
    close(saved);
    close(terminal);
    close(master);

    assert_ptr_equal(strstr(text, "\r\033[Kframes [....................] 0/10   0%"), text);
    const char *half = strstr(text, "\r\033[Kframes [##########..........] 5/10  50%");
    assert_non_null(half);
    const char *line = strstr(half, "\r\033[Ka line\nframes [##########");
    assert_non_null(line);
    const char *last = strstr(line, "left\r\033[K");
    assert_non_null(last);
    last = strstr(last, "frames [##########..........] 5/10");
    assert_non_null(last);
    const char *after = strchr(last, '\n');
    assert_non_null(after);
    assert_string_equal(after, "\nafter\n");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(levels_above_the_chosen_one_are_silent, setup),
        cmocka_unit_test_setup(other_ranks_print_warnings_and_errors_with_their_rank, setup),
        cmocka_unit_test_setup(line_stays_one_line_and_long_text_is_cut, setup),
        cmocka_unit_test_setup(closed_stderr_costs_nothing, setup),
        cmocka_unit_test_setup(progress_without_terminal_is_one_last_line, setup),
        cmocka_unit_test_setup(progress_without_terminal_prints_a_line_after_ten_seconds, setup),
        cmocka_unit_test_setup(progress_knows_a_limit_of_time, setup),
        cmocka_unit_test_setup(progress_of_nothing_and_of_other_ranks_is_harmless, setup),
        cmocka_unit_test_setup(log_line_on_a_terminal_clears_the_bar_and_redraws_it, setup),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
