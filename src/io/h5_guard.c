#include "io/h5_guard.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/log.h"
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define GUARD_SECONDS 10 /* RELIABILITY.md, promise P6 */
/* On top of what the process holds already: chunks of up to 2 GiB and their decoding. */
#define GUARD_BYTES ((rlim_t)6 << 30)

/* What the child sends back through the pipe. */
struct verdict {
    enum v2v_status status;
    char message[V2V_MESSAGE_BYTES];
    char place[128];
};

#ifndef __SANITIZE_ADDRESS__
/* Virtual size of this process in bytes, 0 when unknown. */
static rlim_t virtual_size(void)
{
    unsigned long long pages = 0;
    FILE *statm = fopen("/proc/self/statm", "r");
    if (statm == NULL) {
        return 0;
    }
    if (fscanf(statm, "%llu", &pages) != 1) {
        pages = 0;
    }
    fclose(statm);
    return (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
}
#endif

static void set_limit(int resource, rlim_t value, rlim_t most)
{
    struct rlimit limit;
    if (getrlimit(resource, &limit) == 0 &&
        (limit.rlim_max == RLIM_INFINITY || most < limit.rlim_max)) {
        limit = (struct rlimit){.rlim_cur = value, .rlim_max = most};
        setrlimit(resource, &limit);
    }
}

static void restrain_child(void)
{
    /* Open MPI and the sanitizers print stacks on these; the parent reports them in one line. */
    static const int crashes[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL};
    for (size_t i = 0; i < sizeof crashes / sizeof crashes[0]; i++) {
        signal(crashes[i], SIG_DFL);
    }
    set_limit(RLIMIT_CORE, 0, 0);
    /* SIGXCPU tells the parent why; with both limits equal the kernel sends SIGKILL at once. */
    set_limit(RLIMIT_CPU, GUARD_SECONDS, GUARD_SECONDS + 1);
#ifndef __SANITIZE_ADDRESS__ /* its shadow memory is terabytes of address space */
    const rlim_t held = virtual_size();
    if (held > 0) {
        set_limit(RLIMIT_AS, held + GUARD_BYTES, held + GUARD_BYTES);
    }
#endif
}

static _Noreturn void be_child(int out, enum v2v_status (*look)(const void *), const void *argument)
{
    struct verdict verdict = {.status = V2V_OK};
    restrain_child();
    verdict.status = look(argument);
    snprintf(verdict.message, sizeof verdict.message, "%s", v2v_status_message());
    snprintf(verdict.place, sizeof verdict.place, "%s", v2v_status_place());
    /* Below PIPE_BUF (4096 bytes): written whole or not at all. */
    const ssize_t sent = write(out, &verdict, sizeof verdict);
    _exit(sent == (ssize_t)sizeof verdict ? 0 : 1);
}

/* 1: the verdict is here; 0: the child ended without one, or its time is over (*late). */
static int receive(struct verdict *verdict, int in, int *late)
{
    const double end = v2v_clock_now() + GUARD_SECONDS;
    *late = 0;
    for (;;) {
        const double left = end - v2v_clock_now();
        struct pollfd waiting = {.fd = in, .events = POLLIN};
        const int ready = left > 0.0 ? poll(&waiting, 1, (int)(left * 1000.0) + 1) : 0;
        if (ready > 0) {
            return read(in, verdict, sizeof *verdict) == (ssize_t)sizeof *verdict;
        }
        if (ready == 0 || errno != EINTR) {
            *late = 1;
            return 0;
        }
    }
}

enum v2v_status v2v_h5_guard(const char *path, enum v2v_status (*look)(const void *),
                             const void *argument)
{
    struct verdict verdict = {.status = V2V_OK};
    int ends[2], late = 0, how = 0;
    const pid_t child = pipe(ends) == 0 ? fork() : -1;
    if (child < 0) {
        v2v_log(V2V_LOG_WARNING, "%s: is read without a look from a child process first: %s", path,
                strerror(errno));
        return V2V_OK;
    }
    if (child == 0) {
        close(ends[0]);
        be_child(ends[1], look, argument);
    }
    close(ends[1]);
    const int received = receive(&verdict, ends[0], &late);
    close(ends[0]);
    if (!received) {
        kill(child, SIGKILL);
    }
    while (waitpid(child, &how, 0) < 0 && errno == EINTR) {
    }
    if (received) {
        if (verdict.status != V2V_OK) {
            v2v_status_set_message(verdict.message, verdict.place);
        }
        return verdict.status;
    }
    if (late || (WIFSIGNALED(how) && WTERMSIG(how) == SIGXCPU)) {
        return V2V_FAIL(V2V_E_INPUT, "%s: is damaged: HDF5 looked at it for more than %d s", path,
                        GUARD_SECONDS);
    }
    return V2V_FAIL(V2V_E_INPUT, "%s: is damaged: HDF5 crashed on it (signal %d)", path,
                    WIFSIGNALED(how) ? WTERMSIG(how) : 0);
}
