#include "v2v3d/base/stop.h"

#include <signal.h>
#include <stddef.h>

/* Written by the signal handler. */
static volatile sig_atomic_t requested;

static void on_signal(int number)
{
    (void)number;
    requested = 1;
}

void v2v_stop_install(void)
{
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(SIGUSR1, &action, NULL);
    sigaction(SIGUSR2, &action, NULL);
}

/* The first asks, the next ends the process as it would have without a handler. */
static void on_ending(int number)
{
    if (requested) {
        signal(number, SIG_DFL);
        raise(number);
    }
    requested = 1;
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
