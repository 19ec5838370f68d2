#include "v2v3d/base/stop.h"

#include <signal.h>
#include <stddef.h>
#include <time.h>

/* Written by the signal handler. */
static volatile sig_atomic_t requested;

/* When, milliseconds of a clock that wraps around. */
static volatile sig_atomic_t asked_ms;

/* Signals that belong together: timeout(1) sends one to the process and one to its group. */
enum { ONE_ASKING_MS = 1000 };

static unsigned now_ms(void)
{
    struct timespec now = {0};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (unsigned)now.tv_sec * 1000u + (unsigned)(now.tv_nsec / 1000000);
}

static void ask(void)
{
    if (!requested) {
        asked_ms = (sig_atomic_t)now_ms();
    }
    requested = 1;
}

static void on_signal(int number)
{
    (void)number;
    ask();
}

void v2v_stop_install(void)
{
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(SIGUSR1, &action, NULL);
    sigaction(SIGUSR2, &action, NULL);
}

/* What comes a second after the first signal ends the process as it would have without a handler.
 */
static void on_ending(int number)
{
    if (requested && now_ms() - (unsigned)asked_ms >= ONE_ASKING_MS) {
        signal(number, SIG_DFL);
        raise(number);
    }
    ask();
}

void v2v_stop_heed_ending(void)
{
    struct sigaction action = {.sa_handler = on_ending, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
}

int v2v_stop_requested(void)
{
    return requested != 0;
}
