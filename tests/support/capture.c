#include "capture.h"

#include "support.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

static FILE *capture;
static int saved = -1;

void test_capture_begin(void)
{
    fflush(stderr);
    capture = tmpfile();
    saved = dup(STDERR_FILENO);
    assert_non_null(capture);
    assert_true(saved >= 0 && dup2(fileno(capture), STDERR_FILENO) >= 0);
}

void test_capture_end(char *text, size_t bytes)
{
    fflush(stderr);
    assert_true(dup2(saved, STDERR_FILENO) >= 0);
    close(saved);
    rewind(capture);
    size_t got = fread(text, 1, bytes - 1, capture);
    text[got] = '\0';
    fclose(capture);
}

int test_in_child(void (*act)(void), char *text, size_t bytes)
{
    int status = 0;
    fflush(NULL);
    test_capture_begin();
    pid_t child = fork();
    if (child == 0) {
        act();
        _exit(0);
    }
    pid_t ended = child > 0 ? waitpid(child, &status, 0) : -1;
    test_capture_end(text, bytes);
    assert_true(ended == child);
    return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

int test_own_job(int ranks, const char *argument, char *text, size_t bytes)
{
    char self[512], command[1024], launch[128] = "";
    if (ranks > 1 && system("command -v mpirun > /dev/null") != 0) {
        test_skip("no mpirun here");
    }
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    assert_true(length > 0);
    self[length] = '\0';
    if (ranks > 1) {
        snprintf(launch, sizeof launch,
                 "mpirun --allow-run-as-root --oversubscribe --bind-to none -n %d", ranks);
    }
    snprintf(command, sizeof command, "%s '%s' %s 2>&1", launch, self, argument);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    size_t got = fread(text, 1, bytes - 1, pipe);
    text[got] = '\0';
    int status = pclose(pipe);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}
